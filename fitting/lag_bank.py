"""Bias against temperature and its history: Chebyshev polynomial plus lag bank, by ridge (`bp`, `rlg`).

The published networks see temperature and slope only and stop near 80 % improvement; what they miss is state (fitting
notes, section 6). This model is linear in its parameters, so it is fitted in milliseconds and has one solution.
"""

from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.blas import one_thread
from fitting.lag_bank_model import Guard, LagBankModel, LagBankTerms
from fitting.lag_bank_ridge import RIDGES, Choice, choose, is_worth, solve
from fitting.linear import LinearModel
from fitting.scaling import Scaling, scale_target
from fitting.training import TrainingRecord, unit_variance

Array = NDArray[np.float64]

# Leverage allowed, in units of the largest in training: below 1.5 another cycle's rows are flagged, above 3 a cycle's
# other half is not (twins of `bp` and `rlg`, 20 units each).
_LEVERAGE = 2.0


class LagBankCompensation(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Bias from features of temperature and history as `ThermalHistory` gives them; rows are independent here.

    X (n, k): temperature in degC in the first column, then whatever else acts; y, shape (n,): the bias.

    Parameters
    ----------
    degree: of the Chebyshev polynomial in temperature; 'auto': up to max_degree.
    cross: whether the other features also enter times the temperature (dn/dT and quadratic effects of a lagging
        temperature); 'auto': whichever is better.
    ridge: penalty in units of the number of rows for terms of unit variance; 'auto' chooses.
    margin: room beyond the training box, in ranges of a feature, before a row counts as outside; outside, and where its
        leverage is twice the largest in training, a fallback is used that is linear in the features.

    'auto' is decided by generalised cross-validation, or, if `fit` is given groups, at groups left out.

    Attributes: degree_, cross_, ridge_, freedom_ (effective number of parameters); has_effect_: whether the features
    explain more than noise would; without effect the model is the mean. coefficients_, coefficients_u_: of the terms,
    the latter standard uncertainties for white residuals, NaN if no degree of freedom is left; constant_; model_;
    training_.
    """

    def __init__(
        self,
        degree: int | Literal["auto"] = "auto",
        cross: bool | Literal["auto"] = "auto",
        ridge: float | Literal["auto"] = "auto",
        max_degree: int = 8,
        margin: float = 0.1,
    ) -> None:
        self.degree = degree
        self.cross = cross
        self.ridge = ridge
        self.max_degree = max_degree
        self.margin = margin

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "LagBankCompensation":
        """Fit to X (n >= 2, k) and y (n,); groups (n,): labels of records or dwells to be left out in turn.

        ValueError for a bad parameter or for values that are not finite.
        """
        self._check()
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        target = np.asarray(target, dtype=np.float64)
        labels = None if groups is None else _labels(groups, len(target))
        terms = self._most_terms(inputs)
        scaled_target, _, _ = scale_target(target)
        design = terms.design(inputs)
        choice = choose(design, scaled_target, self._candidates(terms, len(target)), self._ridges(), labels)
        self.has_effect_ = is_worth(choice, design, scaled_target)
        if not self.has_effect_:
            choice = Choice(np.empty(0, dtype=np.intp), choice.ridge, choice.score, 1.0)
        self._keep(inputs, target, scaled_target, terms, design, choice)
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Bias for X (n, k), shape (n,); rows outside the training box by the fallback. ValueError if not finite."""
        check_is_fitted(self, "model_")
        return self.model_.predict(validate_data(self, X, dtype=np.float64, reset=False))

    def inside(self, X: ArrayLike) -> NDArray[np.bool_]:
        """Which rows lie in the training box (with its margin) and are not guarded, shape (n,)."""
        check_is_fitted(self, "model_")
        return self.model_.inside(validate_data(self, X, dtype=np.float64, reset=False))

    def _check(self) -> None:
        whole = (int, np.integer)
        if not isinstance(self.max_degree, whole) or self.max_degree < 1:
            raise ValueError(f"LagBankCompensation: max_degree is {self.max_degree!r}; allowed: a whole number from 1.")
        if self.degree != "auto" and (not isinstance(self.degree, whole) or self.degree < 0):
            raise ValueError(f"LagBankCompensation: degree is {self.degree!r}; allowed: 'auto' or 0, 1, 2 ...")
        if self.cross not in (True, False, "auto"):
            raise ValueError(f"LagBankCompensation: cross is {self.cross!r}; allowed: True, False, 'auto'.")
        if self.ridge != "auto" and not (isinstance(self.ridge, int | float) and 0.0 <= self.ridge < np.inf):
            raise ValueError(f"LagBankCompensation: ridge is {self.ridge!r}; allowed: 'auto' or a number from 0.")
        if not 0.0 <= self.margin < np.inf:
            raise ValueError(f"LagBankCompensation: margin is {self.margin!r}; allowed: a finite number from 0.")

    def _most_terms(self, inputs: Array) -> LagBankTerms:
        """All terms that may be chosen from; constant features have none."""
        scaling = Scaling.of(inputs)
        varies = bool((scaling.columns == 0).any())
        low, high = float(inputs[:, 0].min()), float(inputs[:, 0].max())
        others = scaling.columns > 0
        degree = self.max_degree if self.degree == "auto" else int(self.degree)
        return LagBankTerms(
            0.5 * (low + high),
            0.5 * (high - low) if varies else 0.0,
            degree if varies else 0,
            scaling.columns[others],
            scaling.mean[others],
            scaling.std[others],
            bool(self.cross) and varies,
        )

    def _candidates(self, terms: LagBankTerms, n_rows: int) -> list[NDArray[np.intp]]:
        """Sets of columns of the design, simple ones first; where rows are few, only sets they can carry."""
        degrees = range(min(1, terms.degree), terms.degree + 1) if self.degree == "auto" else [terms.degree]
        crosses = [False, True] if self.cross == "auto" and terms.cross else [terms.cross]
        lags = len(terms.columns)
        first, all_columns = terms.degree, np.arange(terms.count)
        # A quadratic of a lagging temperature brings T^2 together with the products: no products without it.
        sets = [
            np.concatenate([all_columns[:degree], all_columns[first : first + lags * (2 if cross else 1)]])
            for cross in crosses
            for degree in degrees
            if self.degree != "auto" or not cross or degree >= min(2, terms.degree)
        ]
        small = [columns for columns in sets if 2 * (len(columns) + 1) <= n_rows]
        return small or sets[:1]

    def _ridges(self) -> Array:
        return RIDGES if self.ridge == "auto" else np.array([float(self.ridge)])

    def _keep(
        self, inputs: Array, target: Array, scaled_target: Array, most: LagBankTerms, design: Array, choice: Choice
    ) -> None:
        """Solve for the chosen columns; keep them as terms in the units of X and y, with guard and fallback."""
        _, mean, std = scale_target(target)
        lags = len(most.columns)
        self.ridge_, self.freedom_ = choice.ridge / len(target), choice.freedom
        self.degree_ = int(np.sum(choice.columns < most.degree))
        self.cross_ = bool((choice.columns >= most.degree + lags).any())
        self.terms_ = most.chosen(self.degree_, self.cross_, lags if self.has_effect_ else 0)
        constant, solution = solve(design, scaled_target, choice)
        self.constant_, self.coefficients_ = mean + std * constant, std * solution.theta
        guard = _guard(inputs, design[:, choice.columns], choice.ridge, self.margin)
        plain = std * self._fallback(most, design, scaled_target, inputs.shape[1])
        plain[0] += mean
        self.model_ = LagBankModel(self.terms_, self.constant_, self.coefficients_, guard, LinearModel(plain))
        prediction = self.model_.predict(inputs)
        self.training_ = TrainingRecord.of(inputs, target, prediction)
        variance = unit_variance(prediction - target, int(np.ceil(choice.freedom)))
        self.coefficients_u_ = np.sqrt(np.maximum(solution.unit_covariance.diagonal(), 0.0) * variance)

    def _fallback(self, most: LagBankTerms, design: Array, target: Array, n_features: int) -> Array:
        """Coefficients (k + 1,) of a ridge fit linear in the features, for the z-scored target; zero without effect."""
        coefficients = np.zeros(n_features + 1)
        if not self.has_effect_:
            return coefficients
        first = min(1, most.degree)
        columns = np.concatenate([np.arange(first), most.degree + np.arange(len(most.columns))])
        constant, solution = solve(design, target, choose(design, target, [columns], self._ridges()))
        features = np.concatenate([np.zeros(first, dtype=np.intp), most.columns])
        scale = np.concatenate([np.full(first, most.half_range), most.std])
        middle = np.concatenate([np.full(first, most.middle), most.mean])
        coefficients[features + 1] = solution.theta / scale
        coefficients[0] = constant - middle @ coefficients[features + 1]
        return coefficients


def _guard(inputs: Array, design: Array, ridge: float, margin: float) -> Guard:
    """Box of the features with its margin, and the leverage ellipsoid of the chosen terms."""
    low, high = inputs.min(axis=0), inputs.max(axis=0)
    room, centre = margin * (high - low), design.mean(axis=0)
    deviations = design - centre
    size = design.shape[1]
    gram = deviations.T @ deviations
    least = 1e-12 * float(gram.trace()) + float(np.finfo(np.float64).tiny)
    root = scipy.linalg.cholesky(gram + max(ridge, least) * np.eye(size), lower=True)
    whitening = scipy.linalg.solve_triangular(root, np.eye(size), lower=True)
    largest = float(np.max(np.sum((deviations @ whitening.T) ** 2, axis=1), initial=0.0))
    return Guard(low - room, high + room, centre, whitening / np.sqrt(_LEVERAGE * largest if largest > 0.0 else 1.0))


def _labels(groups: ArrayLike, n_rows: int) -> NDArray[np.intp]:
    values = np.asarray(groups)
    if values.shape != (n_rows,):
        raise ValueError(
            f"LagBankCompensation: groups has shape {values.shape}; allowed: one label a row, ({n_rows},)."
        )
    names, labels = np.unique(values, return_inverse=True)
    if len(names) < 2:
        raise ValueError("LagBankCompensation: groups holds one label only; leave-out needs two or more, or None.")
    return np.asarray(labels, dtype=np.intp)


def blocks(n_rows: int, count: int = 8) -> NDArray[np.intp]:
    """Labels of `count` stretches of equal length along a record, (n,): groups for a single record that drifts."""
    return np.asarray(np.arange(n_rows) * count // max(n_rows, 1), dtype=np.intp)


def summary(model: LagBankCompensation) -> dict[str, Any]:
    """What was chosen, for a table: degree, cross terms, ridge, effective parameters."""
    check_is_fitted(model, "model_")
    return {
        "degree": model.degree_,
        "cross": model.cross_,
        "ridge": model.ridge_,
        "effective_parameters": model.freedom_,
        "has_effect": model.has_effect_,
    }
