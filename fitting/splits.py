"""How rows are divided into those a model learns from and those it is judged on."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

DEFAULT_TRAIN_FRACTION = 0.7


class SplitNotPossible(ValueError):
    """The data are too few for this split; the message says what there is and what it would take."""


@dataclass(frozen=True)
class SplitPlan:
    """The paper's random split, and the folds of dwells left out.

    train_fraction or train_count (not both; neither: 0.7) rows of the random split are for training, drawn with seed.
    folds: number of groups of dwells. order: 'interleaved' deals dwells to folds in the order of their temperature,
    so that a fold spans the range; 'seeded' shuffles them first. ValueError for values outside what is allowed.
    """

    train_fraction: float | None = None
    train_count: int | None = None
    seed: int = 0
    folds: int = 6
    order: Literal["interleaved", "seeded"] = "interleaved"

    def __post_init__(self) -> None:
        if self.train_fraction is not None and self.train_count is not None:
            raise ValueError("split: give train_fraction or train_count, not both.")
        if self.train_fraction is not None and not 0.0 < self.train_fraction < 1.0:
            raise ValueError(
                f"split: train_fraction is {self.train_fraction!r}; allowed: between 0 and 1, both excluded."
            )
        if self.train_count is not None and self.train_count < 1:
            raise ValueError(f"split: train_count is {self.train_count!r}; allowed: a whole number of at least 1.")
        if self.folds < 2:
            raise ValueError(f"split: folds is {self.folds!r}; allowed: a whole number of at least 2.")
        if self.order not in ("interleaved", "seeded"):
            raise ValueError(f"split: order is {self.order!r}; allowed: 'interleaved', 'seeded'.")

    def random_training_rows(self, n_rows: int) -> NDArray[np.bool_]:
        """Which of n rows the random split trains on, shape (n,); `SplitNotPossible` if either side would be empty."""
        fraction = DEFAULT_TRAIN_FRACTION if self.train_fraction is None else self.train_fraction
        count = round(fraction * n_rows) if self.train_count is None else self.train_count
        if not 2 <= count < n_rows:
            raise SplitNotPossible(
                f"random split: {count} training rows of {n_rows}; it takes at least 2 to learn from and 1 to judge."
            )
        training = np.zeros(n_rows, dtype=bool)
        training[np.random.default_rng(self.seed).permutation(n_rows)[:count]] = True
        return training

    def fold_of_rows(self, groups: NDArray[np.int64], temperature_degc: NDArray[np.float64]) -> NDArray[np.intp]:
        """Fold number of every row, shape (n,); rows of one dwell share it. groups, temperature_degc: (n,).

        `SplitNotPossible` if there are fewer dwells than folds.
        """
        labels, dwell = np.unique(groups, return_inverse=True)
        if len(labels) < self.folds:
            raise SplitNotPossible(
                f"temperatures left out: {self.folds} folds need as many temperatures, there "
                f"{'is' if len(labels) == 1 else 'are'} {len(labels)}; "
                "measure at more temperatures or ask for fewer folds."
            )
        mean = np.bincount(dwell, weights=temperature_degc) / np.bincount(dwell)
        order = np.argsort(mean, kind="stable")
        if self.order == "seeded":
            order = np.random.default_rng(self.seed).permutation(len(labels))
        fold = np.empty(len(labels), dtype=np.intp)
        fold[order] = np.arange(len(labels)) % self.folds
        return fold[dwell]
