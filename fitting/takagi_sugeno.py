"""Takagi-Sugeno compensation model as a scikit-learn regressor, as published and with jointly optimised rules."""

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.antecedents import Found, SearchSettings, search_joint, search_published
from fitting.blas import one_thread
from fitting.choice import Candidate, Choice, choose
from fitting.consequents import (
    OnlineLeastSquares,
    RecursiveLeastSquares,
    Solution,
    SquareRootLeastSquares,
    batch,
)
from fitting.joint import common_inputs, shared_slopes
from fitting.rules import Antecedents, RuleModel
from fitting.scaling import Scaling, scale_target
from fitting.training import TrainingRecord, unit_variance

_SEARCHES = {"joint": search_joint, "gustafson_kessel": search_published}
# Fitting notes, section 4: a random partition can take 250 sweeps. A joint walk is flat after some hundred steps.
_DEFAULT_MAX_ITER = {"joint": 120, "gustafson_kessel": 500}
_AUTOMATIC_RULES = (2, 4, 6, 8, 12)
_ONLINE: dict[str, type[RecursiveLeastSquares] | type[SquareRootLeastSquares]] = {
    "recursive": RecursiveLeastSquares,
    "square_root": SquareRootLeastSquares,
}


class TakagiSugeno(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Fuzzy rules with Gaussian antecedents and linear consequents (reference experiment `ts`).

    X has shape (n, k), in the campaign [temperature_degc, rate_dps as the gyro gave it]; y, shape (n,), is the true
    rate. Columns are z-scored inside; constant columns are left out.

    Parameters
    ----------
    n_rules: number of rules, or 'auto': by cross-validation over groups of rows (`fitting.choice`), as many as pay off.
    antecedents: 'joint' (variable projection) or 'gustafson_kessel' (the published clustering in product space).
    structure: 'free': each rule has sets and slopes of its own, unless rules with shared sets are nearly as good;
        'tied' (joint only): the sets of an input are shared and of one width, and all inputs but the last, the rate,
        act with one slope in all rules; 'auto' (joint only): the better of both in the cross-validation. Tied rules
        have half the freedom, and win where errors are common to a dwell.
    consequents: 'batch' (QR), 'recursive' (the published recursion) or 'square_root' (its information form); the last
        two start from P(0) = 1e6 I and ignore `ridge`.
    n_starts: starts tried (`fitting.starts`). Of published ones the one is kept that predicts held-out temperature
        blocks best; of joint ones the two with the lowest training error go on, and the better of them at held-out
        blocks replaces the best model with shared sets if it halves that model's error there. Never chosen by J.
    fuzziness: the exponent m of the clustering. tol: its stop, ||U_i - U_(i-1)|| < tol.
    max_iter: sweeps of the clustering (None: 500) or steps of the joint walk (None: 120), for each start.
    ridge: on the consequents of the z-scored problem.
    random_state: of the clustering starts.

    Attributes (all in the units of X and y)
    ----------------------------------------
    centres_, widths_: (rules, d), rules sorted by temperature, then rate; columns_: the d columns used, (d,).
    consequents_: (rules, d + 1), a_j0 and the slopes; consequents_u_: their standard uncertainties given the
        antecedents and white residuals, NaN if there are no more rows than consequents.
    scaling_: mean and std of the columns used; target_mean_, target_std_: of y.
    sets_: fuzzy sets per input if rules share them, as in (2, 2), else None; tied_: whether the structure is 'tied'.
    n_rules_: rules used; n_parameters_: free numbers among antecedents and consequents; choice_: what the
        cross-validation found (`fitting.choice.Choice`), None if nothing was left to it.
    n_iter_, converged_: of the run that was kept. training_: hash, ranges and residuals of the training data.
    """

    def __init__(
        self,
        n_rules: int | Literal["auto"] = 4,
        antecedents: Literal["joint", "gustafson_kessel"] = "joint",
        consequents: Literal["batch", "recursive", "square_root"] = "batch",
        n_starts: int = 5,
        fuzziness: float = 2.0,
        tol: float = 1e-4,
        max_iter: int | None = None,
        ridge: float = 1e-8,
        random_state: Any = 0,
        structure: Literal["free", "tied", "auto"] = "free",
    ) -> None:
        self.n_rules = n_rules
        self.antecedents = antecedents
        self.consequents = consequents
        self.n_starts = n_starts
        self.fuzziness = fuzziness
        self.tol = tol
        self.max_iter = max_iter
        self.ridge = ridge
        self.random_state = random_state
        self.structure = structure

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "TakagiSugeno":
        """Fit to X (n >= 2, k) and y (n,). ValueError for a bad parameter or for values that are not finite.

        groups: label of each row, (n,), whose rows are left out together when something is 'auto'; without them the
        blocks of the first input (`fitting.choice.groups_of`).
        """
        self._check()
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        target = np.asarray(target, dtype=np.float64)
        settings, self.choice_ = self._chosen(inputs, target, groups)
        self.scaling_ = Scaling.of(inputs)
        scaled_target, self.target_mean_, self.target_std_ = scale_target(target)
        scaled = self.scaling_.apply(inputs)
        found = self._search(scaled, scaled_target, settings)
        antecedents = found.antecedents.ordered()
        self.n_iter_, self.converged_, self.sets_ = found.n_iter, found.converged, found.sets
        self.tied_, self.n_rules_ = found.tied, len(antecedents.centres)
        slopes = shared_slopes(self.n_rules_, scaled.shape[1], common_inputs(scaled.shape[1]) if found.tied else ())
        self.n_parameters_ = slopes.shape[1] + _antecedent_parameters(antecedents, found)
        solution = self._solve(antecedents.regressors(scaled) @ slopes, scaled_target)
        self._set_model(antecedents, Solution(slopes @ solution.theta, slopes @ solution.unit_covariance @ slopes.T))
        prediction = self.model_.predict(inputs)
        self.training_ = TrainingRecord.of(inputs, target, prediction)
        self.consequents_u_ *= np.sqrt(unit_variance(prediction - target, slopes.shape[1]))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Compensated rate of X (n, k), shape (n,). ValueError for values that are not finite."""
        check_is_fitted(self, "model_")
        inputs = validate_data(self, X, dtype=np.float64, reset=False)
        return self.model_.predict(inputs)

    def _check(self) -> None:
        _one_of("antecedents", self.antecedents, tuple(_SEARCHES))
        _one_of("consequents", self.consequents, ("batch", *_ONLINE))
        _one_of("structure", self.structure, ("free", "tied", "auto"))
        if self.structure != "free" and self.antecedents != "joint":
            raise ValueError(f"TakagiSugeno: structure is {self.structure!r}; allowed for clustered rules: 'free'.")
        whole = [("n_starts", self.n_starts), ("max_iter", self._max_iter)]
        if self.n_rules != "auto":
            whole.append(("n_rules", self.n_rules))
        for name, value in whole:
            if not isinstance(value, int | np.integer) or value < 1:
                raise ValueError(f"TakagiSugeno: {name} is {value!r}; allowed: a whole number of at least 1.")
        if not self.fuzziness > 1.0:
            raise ValueError(f"TakagiSugeno: fuzziness is {self.fuzziness!r}; allowed: above 1 (the paper takes 2).")
        if not (self.tol >= 0.0 and self.ridge >= 0.0):
            raise ValueError(f"TakagiSugeno: tol is {self.tol!r} and ridge {self.ridge!r}; allowed: 0 or more.")

    @property
    def _max_iter(self) -> int:
        return _DEFAULT_MAX_ITER[self.antecedents] if self.max_iter is None else self.max_iter

    def _chosen(
        self, inputs: NDArray[np.float64], target: NDArray[np.float64], groups: ArrayLike | None
    ) -> tuple[SearchSettings, Choice | None]:
        """Settings with everything decided, and how it was."""
        rules = _AUTOMATIC_RULES if self.n_rules == "auto" else (self.n_rules,)
        structures = ("tied", "free") if self.structure == "auto" else (self.structure,)
        first, choice = (rules[0], structures[0]), None
        if len(rules) * len(structures) > 1:
            families = [
                [
                    Candidate(f"{c} rules, {structure}", clone(self).set_params(n_rules=c, structure=structure))
                    for c in rules
                ]
                for structure in structures
            ]
            choice = choose(families, inputs, target, groups)
            best = choice.estimator
            first = (best.n_rules, best.structure)
        n_rules, structure = first
        settings = SearchSettings(
            n_rules, self.n_starts, self.fuzziness, self.tol, self._max_iter, self.ridge, structure == "tied"
        )
        return settings, choice

    def _search(self, scaled: NDArray[np.float64], target: NDArray[np.float64], settings: SearchSettings) -> Found:
        if not scaled.shape[1]:  # nothing varies: one rule that is at home everywhere
            return Found(Antecedents(np.zeros((1, 0)), np.ones((1, 0))), 1, True)
        seed = check_random_state(self.random_state).randint(2**31 - 1)
        return _SEARCHES[self.antecedents](scaled, target, settings, np.random.default_rng(seed))

    def _solve(self, regressors: NDArray[np.float64], target: NDArray[np.float64]) -> Solution:
        if self.consequents == "batch":
            return batch(regressors, target, self.ridge)
        solver: OnlineLeastSquares = _ONLINE[self.consequents](regressors.shape[1])
        solver.update(regressors, target)
        return solver.solution()

    def _set_model(self, antecedents: Antecedents, solution: Solution) -> None:
        """Take rules and consequents from z-scores to the units of X and y."""
        n_rules, size = len(antecedents.centres), antecedents.centres.shape[1] + 1
        to_units = np.diag(np.concatenate([[1.0], 1.0 / self.scaling_.std])) * self.target_std_
        to_units[0, 1:] = -self.target_std_ * self.scaling_.mean / self.scaling_.std
        self.consequents_ = solution.theta.reshape(n_rules, size) @ to_units.T
        self.consequents_[:, 0] += self.target_mean_
        blocks = solution.unit_covariance.reshape(n_rules, size, n_rules, size)
        own = blocks[np.arange(n_rules), :, np.arange(n_rules), :]
        variances = np.einsum("ab,jbc,ac->ja", to_units, own, to_units) / self.target_std_**2
        self.consequents_u_ = np.sqrt(np.maximum(variances, 0.0))
        in_units = antecedents.in_units_of(self.scaling_)
        self.centres_, self.widths_ = in_units.centres, in_units.widths
        self.columns_ = self.scaling_.columns
        self.model_ = RuleModel(in_units, self.consequents_, self.columns_)


def _antecedent_parameters(antecedents: Antecedents, found: Found) -> int:
    """Free numbers among centres and widths."""
    if found.sets is None:
        return 2 * antecedents.centres.size
    return sum(found.sets) + (len(found.sets) if found.tied else sum(found.sets))


def _one_of(name: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise ValueError(f"TakagiSugeno: {name} is {value!r}; allowed: {', '.join(map(repr, allowed))}.")


def published() -> TakagiSugeno:
    """The paper's model: four rules, Gustafson-Kessel antecedents with m = 2, recursive least squares.

    Five random partitions are tried where the paper has one, because a run ends in any of three optima (fitting
    notes, section 4).
    """
    return TakagiSugeno(n_rules=4, antecedents="gustafson_kessel", consequents="recursive")


def joint() -> TakagiSugeno:
    """Four rules whose antecedents are optimised together with the consequents.

    They are low/high temperature x low/high rate, unless rules with sets of their own are clearly better.
    """
    return TakagiSugeno(n_rules=4, antecedents="joint", consequents="batch")


def automatic() -> TakagiSugeno:
    """As many jointly optimised rules as pay off when whole groups of rows are left out, free or tied."""
    return TakagiSugeno(n_rules="auto", structure="auto")
