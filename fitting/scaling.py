"""Column scaling: z-score what varies, leave out what does not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# A column whose spread is below this share of its size carries only rounding: it is a constant.
_CONSTANT_SHARE = 1e-12


@dataclass(frozen=True)
class Scaling:
    """Mean and standard deviation of the columns that vary.

    columns: indices of the varying columns, ascending, shape (d,).
    mean, std: of those columns, in their own units, shape (d,); every std is above zero.
    """

    columns: NDArray[np.intp]
    mean: NDArray[np.float64]
    std: NDArray[np.float64]

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> "Scaling":
        """Measure a matrix of shape (n, k); constant columns are left out (their covariance would be singular)."""
        mean = values.mean(axis=0)
        std = values.std(axis=0)
        columns = np.flatnonzero(std > _CONSTANT_SHARE * np.maximum(np.abs(mean), np.finfo(np.float64).tiny))
        return cls(columns, mean[columns], std[columns])

    def apply(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The varying columns of (n, k) as z-scores, shape (n, d)."""
        scaled: NDArray[np.float64] = (values[:, self.columns] - self.mean) / self.std
        return scaled


def scale_target(target: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """z-score of a target of shape (n,), with its mean and its scale (1 for a constant target)."""
    scaling = Scaling.of(target[:, np.newaxis])
    mean = float(target.mean())
    std = float(scaling.std[0]) if scaling.columns.size else 1.0
    return (target - mean) / std, mean, std
