"""Ridge regression with its columns and its ridge chosen together, all from one Gram matrix: milliseconds for a cycle.

Columns are centred and the constant is not penalised. Scores: generalised cross-validation (Golub, Heath and Wahba,
1979) with the degrees of freedom inflated by 1.4, which keeps it from choosing too little ridge (Kim and Gu, 2004); or
the error at groups of rows left out in turn, for errors that are common to a record or drift within it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.consequents import Solution, batch

Array = NDArray[np.float64]
Columns = NDArray[np.intp]

INFLATION = 1.4
# In units of the number of rows, for columns of unit variance.
RIDGES = 10.0 ** np.arange(-8.0, 1.1, 0.5)
# A further candidate must be better by this share: candidates come in the order of their complexity.
_WORTH = 1e-3


@dataclass(frozen=True)
class Choice:
    """columns: of the design. ridge: in squared units of the design. score: mean squared error foreseen.

    freedom: effective number of parameters, the constant included.
    """

    columns: Columns
    ridge: float
    score: float
    freedom: float


@dataclass(frozen=True)
class _Moments:
    """Second moments of centred columns and target: gram (p, p), cross (p,), power, over n rows."""

    gram: Array
    cross: Array
    power: float
    rows: int


def choose(
    design: Array, target: Array, candidates: Sequence[Columns], ridges: Array, groups: NDArray[np.intp] | None = None
) -> Choice:
    """The best of the candidate sets of columns, and its ridge.

    design: (n, p), target: (n,). ridges: in units of n. groups: (n,), labels of what is left out together, at least
    two; None scores by generalised cross-validation. A candidate without columns is the mean alone.
    """
    centred, deviation = design - design.mean(axis=0), target - target.mean()
    moments = _Moments(centred.T @ centred, centred.T @ deviation, float(deviation @ deviation), len(target))
    folds = None if groups is None else _folds(centred, deviation, groups)
    best: Choice | None = None
    for columns in candidates:
        found = _along_ridges(moments, columns, ridges, folds)
        if best is None or found.score < best.score * (1.0 - _WORTH):
            best = found
    if best is None:
        raise ValueError("ridge: no candidate sets of columns are given.")
    return best


def is_worth(choice: Choice, design: Array, target: Array) -> bool:
    """Whether the chosen columns explain more than white noise would let them: about one error in a thousand.

    The gain in units of the residual variance is chi-square with `freedom` - 1 degrees if there is no effect; the
    allowance of five deviations and six more covers that the best of many candidates was taken.
    """
    centred, deviation = design[:, choice.columns] - design[:, choice.columns].mean(axis=0), target - target.mean()
    residual = deviation - centred @ batch(centred, deviation, choice.ridge).theta
    degrees = choice.freedom - 1.0
    left = float(residual @ residual)
    variance = left / max(len(target) - choice.freedom, 1e-9)
    gain = float(deviation @ deviation) - left
    return bool(gain > variance * (degrees + 5.0 * np.sqrt(2.0 * max(degrees, 0.0)) + 6.0))


def solve(design: Array, target: Array, choice: Choice) -> tuple[float, Solution]:
    """The constant and the solution for the chosen columns, by QR."""
    chosen = design[:, choice.columns]
    mean = chosen.mean(axis=0)
    solution = batch(chosen - mean, target - target.mean(), choice.ridge)
    return float(target.mean() - mean @ solution.theta), solution


def _along_ridges(
    moments: _Moments, columns: Columns, ridges: Array, folds: list[tuple[Array, Array]] | None
) -> Choice:
    """The best ridge for these columns."""
    penalties = ridges * moments.rows
    values, vectors = np.linalg.eigh(moments.gram[np.ix_(columns, columns)])
    values = np.maximum(values, 0.0)[:, np.newaxis]
    freedom = 1.0 + np.sum(values / (values + penalties), axis=0)
    if folds is None:
        projected = (vectors.T @ moments.cross[columns])[:, np.newaxis]
        explained = np.sum(projected**2 * (values + 2.0 * penalties) / (values + penalties) ** 2, axis=0)
        left = np.maximum(moments.power - explained, 1e-14 * moments.power)  # what rounding leaves of a perfect fit
        share = 1.0 - INFLATION * freedom / moments.rows
        scores = np.where(share > 0.0, left / moments.rows / np.where(share > 0.0, share, 1.0) ** 2, np.inf)
    else:
        scores = _left_out(moments, columns, penalties, folds) / moments.rows
    k = int(np.argmin(scores))
    return Choice(columns, float(penalties[k]), float(scores[k]), float(freedom[k]))


def _folds(centred: Array, deviation: Array, groups: NDArray[np.intp]) -> list[tuple[Array, Array]]:
    """The rows of each group: design with a column of ones in front, and target."""
    extended = np.column_stack([np.ones(len(deviation)), centred])
    return [(extended[groups == label], deviation[groups == label]) for label in np.unique(groups)]


def _left_out(moments: _Moments, columns: Columns, penalties: Array, folds: list[tuple[Array, Array]]) -> Array:
    """Sum of squared errors at each group, predicted from the others, for every penalty; Gram matrices downdated."""
    size = len(columns) + 1
    gram, cross = np.zeros((size, size)), np.zeros(size)
    gram[0, 0], gram[1:, 1:], cross[1:] = moments.rows, moments.gram[np.ix_(columns, columns)], moments.cross[columns]
    penalty = penalties[:, np.newaxis, np.newaxis] * np.diag(np.concatenate([[0.0], np.ones(size - 1)]))
    used = np.concatenate([[0], columns + 1])
    total = np.zeros(len(penalties))
    for rows, values in folds:
        held = rows[:, used]
        theta = np.linalg.solve(gram - held.T @ held + penalty, (cross - held.T @ values)[:, np.newaxis])[..., 0]
        total += np.sum((theta @ held.T - values) ** 2, axis=1)
    return total
