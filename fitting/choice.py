"""Which of several models to keep, complexity included: cross-validation over groups of rows.

Rows of one temperature dwell share errors that a random split lets a model memorise (fitting notes, section 5); so
whole groups are left out, and the simplest model is kept that is not worth less than the best: by the
one-standard-error rule (Breiman et al., 1984), with the standard error of the difference over groups, between a
tolerance below which a difference does not matter and a limit above which it does, however uncertain it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from fitting.estimator import checked_groups
from fitting.splits import SplitPlan

FOLDS = 6
# A gap between sorted values this many times the mean gap separates two dwells.
_GAP = 5.0
# Blocks taken where there are no dwells to be seen.
_BLOCKS = 12
# A candidate whose squared error on the folds so far is this many times the smallest is given up.
_HOPELESS = 9.0
# What the next larger member of a family must gain, as a share, or the family ends there.
_WORTHWHILE = 0.02
# Rms error as a multiple of the smallest: always good enough, and never. Surface A with dwell errors: without the
# first a model a hundredth worse in every dwell gives way to one far worse in a few.
_AS_GOOD, _WORSE = 1.05, 1.2


@dataclass(frozen=True)
class Candidate:
    """A model to try. estimator: unfitted, cloned for every fold. without: columns it does not get to see."""

    name: str
    estimator: Any
    without: tuple[int, ...] = ()


@dataclass(frozen=True)
class Score:
    """What one candidate did on the groups left out.

    squares: mean square error of each group, (groups,), NaN for groups not reached. rms: over all rows. excess_se:
    standard error over groups of its mean square error minus the best candidate's, 0 for the best itself, NaN if it was
    given up. n_parameters: mean over the folds. complete: False if it was given up half way.
    """

    candidate: Candidate
    squares: NDArray[np.float64]
    rms: float
    n_parameters: float
    complete: bool
    excess_se: float = float("nan")


@dataclass(frozen=True)
class Choice:
    """scores: of all candidates tried; good: those not worth less than the best, the simplest first; best."""

    scores: tuple[Score, ...]
    good: tuple[Score, ...]
    best: Score

    @property
    def chosen(self) -> Score:
        """The one kept: the simplest of the good."""
        return self.good[0]

    @property
    def estimator(self) -> Any:
        """The kept candidate, unfitted."""
        return clone(self.chosen.candidate.estimator)

    def table(self) -> list[dict[str, Any]]:
        """One row a candidate: name, rms, excess_se, n_parameters, without, complete, chosen."""
        return [
            {
                "name": score.candidate.name,
                "rms": score.rms,
                "excess_se": score.excess_se,
                "n_parameters": score.n_parameters,
                "without": score.candidate.without,
                "complete": score.complete,
                "chosen": score.candidate is self.chosen.candidate,
            }
            for score in self.scores
        ]


def groups_of(first_input: NDArray[np.float64]) -> NDArray[np.intp]:
    """Dwells as far as they can be seen: rows (n,) between clear gaps of the first input; otherwise blocks of rows.

    Group numbers from 0, ascending with the input, shape (n,).
    """
    order = np.argsort(first_input, kind="stable")
    gaps = np.diff(first_input[order])
    numbers = np.concatenate([[0], np.cumsum(gaps > _GAP * max(float(gaps.mean()), np.finfo(np.float64).tiny))])
    if numbers[-1] + 1 < _BLOCKS:
        numbers = np.arange(len(order)) * min(_BLOCKS, len(order)) // len(order)
    groups = np.empty(len(order), dtype=np.intp)
    groups[order] = numbers
    return groups


def without_columns(inputs: NDArray[np.float64], columns: tuple[int, ...]) -> NDArray[np.float64]:
    """Inputs (n, k) with some columns held at their mean: every model leaves a constant column out."""
    if not columns:
        return inputs
    held = inputs.copy()
    held[:, columns] = inputs[:, columns].mean(axis=0)
    return held


def choose(
    families: Sequence[Sequence[Candidate]],
    inputs: NDArray[np.float64],
    target: NDArray[np.float64],
    groups: ArrayLike | None = None,
    folds: int = FOLDS,
) -> Choice:
    """Try families of candidates, each in the order of its complexity, on inputs (n, k) and target (n,).

    groups: labels, (n,); without them `groups_of` the first input. A family is followed as long as its next member is
    better than all before it. With fewer than 4 rows nothing can be left out, and the first candidate is kept.
    """
    numbers = checked_groups(groups, len(target))
    if numbers is None:
        numbers = groups_of(inputs[:, 0])
    if len(target) < 4:
        only = Score(families[0][0], np.full(int(numbers.max()) + 1, np.nan), float("nan"), float("nan"), False)
        return Choice((only,), (only,), only)
    trial = _Trial(inputs, target, numbers, folds)
    scores: list[Score] = []
    for family in families:
        smallest = np.inf
        for candidate in family:
            score = trial.score(candidate)
            scores.append(score)
            if score.complete and not score.rms < (1.0 - _WORTHWHILE) * smallest:
                break
            smallest = min(smallest, score.rms)
    return _decided(scores, trial.sizes)


class _Trial:
    """Leaves groups out by folds, and gives up candidates that are far behind."""

    def __init__(
        self, inputs: NDArray[np.float64], target: NDArray[np.float64], groups: NDArray[np.intp], folds: int
    ) -> None:
        self.inputs, self.target, self.groups = inputs, target, groups
        self.sizes = np.bincount(groups)
        count = min(folds, len(self.sizes))
        self.folds = SplitPlan(folds=count).fold_of_rows(groups.astype(np.int64), inputs[:, 0])
        self.smallest = np.full(count, np.inf)

    def score(self, candidate: Candidate) -> Score:
        """The candidate's errors on groups left out."""
        squares, parameters = np.zeros(len(self.target)), []
        seen = np.zeros(len(self.target), dtype=bool)
        sums = np.full(len(self.smallest), np.inf)
        inputs = without_columns(self.inputs, candidate.without)
        for fold in range(len(self.smallest)):
            held = self.folds == fold
            model = clone(candidate.estimator).fit(inputs[~held], self.target[~held])
            squares[held] = (model.predict(inputs[held]) - self.target[held]) ** 2
            seen |= held
            parameters.append(float(getattr(model, "n_parameters_", np.nan)))
            sums[fold] = squares[seen].sum()
            if sums[fold] > _HOPELESS * self.smallest[fold] and fold + 1 < len(sums):
                break
        self.smallest = np.minimum(self.smallest, sums)
        by_group = np.bincount(self.groups, weights=squares) / self.sizes
        reached = np.bincount(self.groups[seen], minlength=len(self.sizes)) > 0
        rms = float(np.sqrt(squares[seen].mean()))
        by_group = np.where(reached, by_group, np.nan)
        return Score(candidate, by_group, rms, float(np.mean(parameters)), bool(seen.all()))


def _decided(scores: list[Score], sizes: NDArray[np.intp]) -> Choice:
    """The fewest parameters among those not clearly worse than the best."""
    best = min((score for score in scores if score.complete), key=lambda score: score.rms)
    weights = sizes / sizes.sum()
    judged = [replace(score, excess_se=_standard_error(score.squares - best.squares, weights)) for score in scores]
    best = judged[scores.index(best)]
    good = [score for score in judged if score.complete and _good_enough(score, best)]
    good.sort(key=lambda score: (score.n_parameters, score.rms))
    return Choice(tuple(judged), tuple(good), best)


def _good_enough(score: Score, best: Score) -> bool:
    if score.rms <= _AS_GOOD * best.rms:
        return True
    return score.rms <= _WORSE * best.rms and score.rms**2 <= best.rms**2 + score.excess_se


def _standard_error(differences: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Of the weighted mean of one difference a group, (groups,)."""
    mean = float(weights @ differences)
    return float(np.sqrt(np.sum((weights * (differences - mean)) ** 2)))
