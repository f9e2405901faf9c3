"""The model, its complexity and its inputs chosen by cross-validation over groups of rows."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from fitting.blas import one_thread
from fitting.choice import FOLDS, Candidate, Choice, choose, without_columns
from fitting.estimator import CompensationEstimator, require
from fitting.linear import LinearCompensation
from fitting.ls_svm import LeastSquaresSVM
from fitting.polynomial import PolynomialCompensation
from fitting.rbf import RadialBasisSpline
from fitting.takagi_sugeno import TakagiSugeno
from fitting.training import TrainingRecord

_RULES = (2, 4, 6, 8, 12)
_DEGREES = (2, 3, 5)


class AutomaticCompensation(CompensationEstimator):
    """The simplest of several models that is not clearly worse than the best on whole groups left out.

    Parameters
    ----------
    candidates: (name, estimator) pairs; None takes Takagi-Sugeno rules tied and free in several numbers, polynomials,
        the LS-SVM and the radial basis spline.
    folds: into which the groups are dealt.
    rate: whether the last column of X is the rate the gyro gave. It is never dropped; the other columns, the
        temperatures, must earn their place: every candidate is tried without them as well (of the default ones, the
        simple), and a record without temperature effect gets a model without temperature. False for a bias run.
    random_state: of the candidates that have one.

    Attributes
    ----------
    chosen_: name of the model kept; without_: columns it ignores. scores_: one row a candidate (`Choice.table`).
    best_estimator_: fitted on all rows, and what a model file holds; n_parameters_: its. model_, training_: see
    `CompensationEstimator`.

    The candidates tune themselves on the rows of a fold; what is grouped is the choice between them.
    """

    def __init__(
        self,
        candidates: Sequence[tuple[str, Any]] | None = None,
        folds: int = FOLDS,
        rate: bool = True,
        random_state: Any = 0,
    ) -> None:
        self.candidates = candidates
        self.folds = folds
        self.rate = rate
        self.random_state = random_state

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "AutomaticCompensation":
        """Fit to X (n >= 2, k) and y (n,); groups: label of each row, (n,), whose rows are left out together."""
        whole = isinstance(self.folds, int | np.integer) and self.folds >= 2
        require(whole, self, "folds", self.folds, "a whole number of at least 2")
        require(
            self.candidates is None or len(self.candidates) > 0, self, "candidates", self.candidates, "at least one"
        )
        inputs, target = self._checked(X, y)
        kept = 1 if self.rate else 0
        droppable = tuple(range(max(0, inputs.shape[1] - kept)))
        choice = choose(self._families(droppable), inputs, target, groups, self.folds)
        choice, best = _fitted(choice, inputs, target)
        seen = choice.chosen.candidate
        self.choice_, self.scores_ = choice, choice.table()
        self.chosen_, self.without_ = seen.name, seen.without
        self.best_estimator_, self.n_parameters_ = best, getattr(best, "n_parameters_", None)
        self._keep(best.model_, inputs, target)
        return self

    def _families(self, droppable: tuple[int, ...]) -> list[list[Candidate]]:
        if self.candidates is None:
            families, simple = self._default_families()
        else:
            families = [[Candidate(name, self._seeded(estimator))] for name, estimator in self.candidates]
            simple = families
        if droppable:
            label = "temperature" if self.rate else "any input"
            families = families + [
                [Candidate(f"{one.name}, without {label}", one.estimator, droppable) for one in family]
                for family in simple
            ]
        return families

    def _default_families(self) -> tuple[list[list[Candidate]], list[list[Candidate]]]:
        """All families, and those tried without temperature."""
        rules = [
            [
                Candidate(f"T-S, {c} rules, {how}", TakagiSugeno(c, structure=how, random_state=self.random_state))
                for c in _RULES
            ]
            for how in ("tied", "free")
        ]
        powers = [Candidate("linear", LinearCompensation())]
        powers += [Candidate(f"polynomial of degree {degree}", PolynomialCompensation(degree)) for degree in _DEGREES]
        kernels = [
            [Candidate("LS-SVM", LeastSquaresSVM(stretch=False))],
            [Candidate("radial basis spline", RadialBasisSpline())],
        ]
        return [*rules, powers, *kernels], [powers, rules[1][:2]]

    def _seeded(self, estimator: Any) -> Any:
        if "random_state" in estimator.get_params():
            return type(estimator)(**{**estimator.get_params(deep=False), "random_state": self.random_state})
        return estimator


def _fitted(choice: Choice, inputs: NDArray[np.float64], target: NDArray[np.float64]) -> tuple[Choice, Any]:
    """The first of the good whose fit on all rows is as good there as its folds were on rows left out, fitted.

    A fit that is worse has ended in another optimum than those of the folds.
    """
    for score in choice.good:
        without = score.candidate.without
        best = clone(score.candidate.estimator).fit(without_columns(inputs, without), target)
        best.training_ = TrainingRecord.of(inputs, target, best.model_.predict(inputs))
        rms = float(np.sqrt(np.mean((best.model_.predict(inputs) - target) ** 2)))
        if not rms > score.rms:
            break
    return replace(choice, good=choice.good[choice.good.index(score) :]), best
