"""What a fitted model remembers of the data it was fitted to."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TrainingRecord:
    """Provenance and reach of a fit.

    sha256: of the exact bytes of X, then y, as little-endian float64, X row by row.
    input_min, input_max: the training box, shape (k,), in the units of the inputs.
    max_abs_residual, std_residual: of prediction - y over the training rows, in the unit of y; std with divisor n.
    """

    sha256: str
    rows: int
    input_min: NDArray[np.float64]
    input_max: NDArray[np.float64]
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
        return cls(
            digest.hexdigest(),
            len(target),
            inputs.min(axis=0),
            inputs.max(axis=0),
            float(np.abs(residual).max()),
            float(residual.std()),
        )


def unit_variance(residual: NDArray[np.float64], n_parameters: int) -> float:
    """Residual variance with divisor n - p; NaN where no degree of freedom is left, because then it is unknown."""
    freedom = len(residual) - n_parameters
    return float(residual @ residual) / freedom if freedom > 0 else float("nan")
