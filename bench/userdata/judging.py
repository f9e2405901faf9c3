"""What a model fitted to a user's recording is worth: on rows, and on whole groups, that it did not learn from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import UserMistake
from bench.userdata.recording import Recording
from fitting.splits import SplitPlan

# Without groups a recording is cut into so many stretches of rows, which are left out like groups.
STRETCHES, FOLDS = 12, 6
RANDOM, LEFT_OUT = "random", "left_out"
# Less than this gained on rows left out is as good as nothing.
LEAST_GAIN = 0.02


@dataclass(frozen=True)
class Figures:
    """Errors in deg/s of rows held back; squares: sum of squared errors of each fold, (folds,)."""

    max_abs_dps: float
    std_dps: float
    n: int
    squares: NDArray[np.float64] = field(repr=False)

    def as_dict(self) -> dict[str, float | int]:
        """For a model file and JSON."""
        return {"max_abs_dps": self.max_abs_dps, "std_dps": self.std_dps, "n": self.n}


@dataclass(frozen=True)
class Folds:
    """Rows that belong together: groups (n,) labels; by_group (n,) fold numbers; random (n,) rows to learn from."""

    groups: NDArray[np.intp]
    by_group: NDArray[np.intp]
    random: NDArray[np.bool_]

    @classmethod
    def of(cls, recording: Recording) -> Folds:
        """Whole groups, dealt to folds in the order of their temperature; without groups, stretches of rows."""
        n = len(recording.target)
        groups = recording.groups
        if groups is None:
            groups = np.arange(n, dtype=np.intp) * min(STRETCHES, n // 2) // n
        count = int(groups.max()) + 1
        if count < 2:
            raise UserMistake(f"{recording.path}: all rows are of one group; leaving groups out takes two or more.")
        plan = SplitPlan(folds=min(FOLDS, count))
        by_group = plan.fold_of_rows(groups.astype(np.int64), recording.inputs[:, 0])
        return cls(groups, by_group, plan.random_training_rows(n))


def judge(
    make: Callable[[], Any], inputs: NDArray[np.float64], target: NDArray[np.float64], folds: Folds
) -> dict[str, Figures]:
    """Fit to some of the rows of inputs (n, k) and target (n,), and measure on the others. ValueError passes."""

    def errors(learned: NDArray[np.bool_], held: NDArray[np.bool_]) -> NDArray[np.float64]:
        model = make()
        model.fit(inputs[learned], target[learned])
        return np.asarray(model.predict(inputs[held]), dtype=np.float64) - target[held]

    numbers = range(int(folds.by_group.max()) + 1)
    left_out = [errors(folds.by_group != number, folds.by_group == number) for number in numbers]
    return {RANDOM: figures([errors(folds.random, ~folds.random)]), LEFT_OUT: figures(left_out)}


def figures(errors: list[NDArray[np.float64]]) -> Figures:
    """Of the errors of one or more folds."""
    together = np.concatenate(errors)
    squares = np.array([float(error @ error) for error in errors])
    return Figures(float(np.abs(together).max()), float(together.std()), len(together), squares)


def is_better(full: Figures, plain: Figures) -> bool:
    """Whether a model is better than one that knows less, at groups left out, beyond what chance does.

    It must gain `LEAST_GAIN`, and more than the standard error of its gain from fold to fold.
    """
    gains = plain.squares - full.squares
    scatter = float(gains.std(ddof=1)) / np.sqrt(len(gains)) if len(gains) > 1 else 0.0
    needed = (1.0 - (1.0 - LEAST_GAIN) ** 2) * float(plain.squares.sum())
    return bool(gains.sum() > needed and gains.mean() > scatter)
