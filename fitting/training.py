"""What a fitted model remembers of the data it was fitted to."""

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitting.consequents import batch
from fitting.reach import Reach
from fitting.scaling import Scaling, scale_target


@dataclass(frozen=True)
class TrainingRecord:
    """Provenance and reach of a fit.

    sha256: of the exact bytes of X, then y, as little-endian float64, X row by row.
    reach: the range of the inputs. input_mean, input_std: (k,), in the units of the inputs; std with divisor n, 0 for a
    constant column. target_mean, target_std: of y.
    slopes: of the plain linear fit of y on X, (k,), 0 for a constant column.
    max_abs_residual, std_residual: of prediction - y over the training rows, in the unit of y; std with divisor n.
    """

    sha256: str
    rows: int
    reach: Reach
    input_mean: NDArray[np.float64]
    input_std: NDArray[np.float64]
    target_mean: float
    target_std: float
    slopes: NDArray[np.float64]
    max_abs_residual: float
    std_residual: float

    @classmethod
    def of(
        cls, inputs: NDArray[np.float64], target: NDArray[np.float64], prediction: NDArray[np.float64]
    ) -> "TrainingRecord":
        """Record a fit of inputs (n, k) to target (n,)."""
        digest = hashlib.sha256()
        for values in (inputs, target):
            digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        residual = prediction - target
        scaling = Scaling.of(inputs)
        mean, std = inputs.mean(axis=0), np.zeros(inputs.shape[1])
        std[scaling.columns] = scaling.std
        return cls(
            digest.hexdigest(),
            len(target),
            Reach.of(inputs),
            mean,
            std,
            float(target.mean()),
            float(target.std()),
            _slopes(inputs, target, scaling),
            float(np.abs(residual).max()),
            float(residual.std()),
        )

    @cached_property
    def input_min(self) -> NDArray[np.float64]:
        """Lower edge of the training box, (k,)."""
        return self.reach.low

    @cached_property
    def input_max(self) -> NDArray[np.float64]:
        """Upper edge of the training box, (k,)."""
        return self.reach.high


def _slopes(inputs: NDArray[np.float64], target: NDArray[np.float64], scaling: Scaling) -> NDArray[np.float64]:
    scaled_target, _, target_std = scale_target(target)
    slopes = np.zeros(inputs.shape[1])
    if scaling.columns.size:
        scaled = batch(scaling.apply(inputs), scaled_target, 0.0).theta
        slopes[scaling.columns] = scaled * target_std / scaling.std
    return slopes


def unit_variance(residual: NDArray[np.float64], n_parameters: int) -> float:
    """Residual variance with divisor n - p; NaN where no degree of freedom is left, because then it is unknown."""
    freedom = len(residual) - n_parameters
    return float(residual @ residual) / freedom if freedom > 0 else float("nan")
