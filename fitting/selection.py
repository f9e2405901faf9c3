"""Which of several candidate antecedents to keep: blocked cross-validation inside the training rows.

The training error prefers candidates that have memorised the errors common to a temperature dwell, and the
clustering objective J says nothing about the model (fitting notes, sections 4 and 5). So the rows are cut along the
first input (temperature) into blocks, whole blocks are held back, and the candidate that predicts them best is kept.
No dwell labels are needed.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fitting.consequents import batch
from fitting.rules import Antecedents

_BLOCKS, _FOLDS = 8, 4

Refine = Callable[[NDArray[np.float64], NDArray[np.float64]], Antecedents]


def blocked_folds(first_input: NDArray[np.float64]) -> NDArray[np.intp]:
    """Fold number 0..3 of every row, shape (n,): eight blocks of equal count along the input, dealt in turn."""
    ranks = np.empty(len(first_input), dtype=np.intp)
    ranks[np.argsort(first_input, kind="stable")] = np.arange(len(first_input))
    folds: NDArray[np.intp] = (ranks * _BLOCKS // len(first_input)) % _FOLDS
    return folds


def can_hold_out(n_rows: int, antecedents: Antecedents) -> bool:
    """Whether the rows are twice the unknowns (centres, widths, consequents), so that a fold can do without some."""
    n_rules, n_inputs = antecedents.centres.shape
    return bool(n_rows >= 2 * n_rules * (3 * n_inputs + 1))


def held_out_error(inputs: NDArray[np.float64], targets: NDArray[np.float64], refine: Refine, ridge: float) -> float:
    """Sum of squared errors of blocks of rows predicted from the others.

    inputs: (n, d), targets: (n,), both z-scores. refine: the candidate's antecedents, adapted to the rows it is given.
    """
    folds = blocked_folds(inputs[:, 0])
    total = 0.0
    for fold in range(_FOLDS):
        held, kept = folds == fold, folds != fold
        antecedents = refine(inputs[kept], targets[kept])
        theta = batch(antecedents.regressors(inputs[kept]), targets[kept], ridge).theta
        error = antecedents.regressors(inputs[held]) @ theta - targets[held]
        total += float(error @ error)
    return total


def training_error(
    inputs: NDArray[np.float64], targets: NDArray[np.float64], antecedents: Antecedents, ridge: float
) -> float:
    """Sum of squared errors on the rows the consequents were fitted to."""
    regressors = antecedents.regressors(inputs)
    error = regressors @ batch(regressors, targets, ridge).theta - targets
    return float(error @ error)
