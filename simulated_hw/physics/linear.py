"""Exact solution of x' = A x + b0 + b1 t, vectorised over times.

In the eigenvectors' coordinates every state is a sum of exponentials and a quadratic in time, so one step may last a
millisecond or a week. Evaluation is elementwise on purpose (no matrix product over times): the value at an instant is
the same to the last bit whatever other instants are asked for in the same call.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Above this condition of the eigenvectors the solution loses more than about 1e-5 of its size to rounding.
_WORST_CONDITION = 1e11
_ZERO_RATE = 1e-12


@dataclass(frozen=True, slots=True)
class Trajectory:
    """x(t) = Σ w_i e^(λ_i t) + Re Σ w_j e^(λ_j t) + p_0 + p_1 t + p_2 t², t in seconds since the start.

    Fields: real_rates (r,), real_weights (r, n), complex_rates (c,), complex_weights (c, n), polynomial (3, n).
    """

    real_rates: NDArray[np.float64]
    real_weights: NDArray[np.float64]
    complex_rates: NDArray[np.complex128]
    complex_weights: NDArray[np.complex128]
    polynomial: NDArray[np.float64]

    def at(self, elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """States at many instants, shape (len(elapsed_s), n)."""
        t = np.ascontiguousarray(elapsed_s, dtype=np.float64)
        column = t[:, None]
        out = (self.polynomial[2] * column + self.polynomial[1]) * column + self.polynomial[0]
        for rate, weight in zip(self.real_rates, self.real_weights, strict=True):
            out += np.exp(rate * t)[:, None] * weight
        for root, mix in zip(self.complex_rates, self.complex_weights, strict=True):
            decay, phase = np.exp(root.real * t), root.imag * t
            out += (decay * np.cos(phase))[:, None] * mix.real
            out -= (decay * np.sin(phase))[:, None] * mix.imag
        return np.asarray(out, dtype=np.float64)

    def state(self, elapsed_s: float) -> NDArray[np.float64]:
        """The state at one instant, shape (n,)."""
        p = self.polynomial
        out = p[0] + elapsed_s * (p[1] + elapsed_s * p[2]) + np.exp(elapsed_s * self.real_rates) @ self.real_weights
        if len(self.complex_rates):
            out = out + (np.exp(elapsed_s * self.complex_rates) @ self.complex_weights).real
        return np.asarray(out, dtype=np.float64)

    def project(self, combination: NDArray[np.float64]) -> "Trajectory":
        """The trajectory of y = x @ combination, combination of shape (n, k)."""
        return Trajectory(
            self.real_rates,
            self.real_weights @ combination,
            self.complex_rates,
            self.complex_weights @ combination,
            self.polynomial @ combination,
        )


class LinearSystem:
    """x' = A x + b0 + b1 t for a fixed A.

    A matrix without a full set of eigenvectors (equal time constants in a chain) has its diagonal spread by the
    smallest step of 1e-7 … 1e-3 that gives one, 1e-7 for two equal constants and 1e-5 for three: the time constants
    are then off by a few such steps, the solution stays exact.
    """

    def __init__(self, matrix: NDArray[np.float64]) -> None:
        """`matrix` is A, shape (n, n), in 1/s. Raises ValueError if no spread makes it solvable."""
        values, vectors = _eigen(np.asarray(matrix, dtype=np.float64))
        inverse = np.linalg.inv(vectors)
        upper = values.imag >= 0.0  # of a conjugate pair one, counted twice
        self._rates = values[upper]
        self._into = inverse[upper]
        self._out_of = vectors.T[upper] * np.where(values[upper].imag > 0.0, 2.0, 1.0)[:, None]
        self._still = np.abs(self._rates) <= _ZERO_RATE * max(float(np.abs(values).max()), 1e-300)

    def solve(
        self, start: NDArray[np.float64], constant: NDArray[np.float64], slope: NDArray[np.float64] | None = None
    ) -> Trajectory:
        """The trajectory from x(0) = start under b0 = constant and b1 = slope (zero if None), all of shape (n,)."""
        z, b0 = self._into @ start, self._into @ constant
        b1 = np.zeros_like(b0) if slope is None else self._into @ slope
        rate = np.where(self._still, 1.0, self._rates)
        settled = b0 / rate + b1 / rate**2
        weights = np.where(self._still, 0.0, z + settled)[:, None] * self._out_of
        modal = np.stack(
            [
                np.where(self._still, z, -settled),
                np.where(self._still, b0, -b1 / rate),
                np.where(self._still, 0.5 * b1, 0.0),
            ]
        )
        paired = self._rates.imag > 0.0
        alone = ~paired & ~self._still
        return Trajectory(
            self._rates[alone].real.copy(),
            weights[alone].real.copy(),
            self._rates[paired].copy(),
            weights[paired].copy(),
            (modal @ self._out_of).real.copy(),
        )


def _eigen(matrix: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    steps = np.arange(len(matrix), dtype=np.float64) - 0.5 * len(matrix)
    for spread in (0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3):
        values, vectors = np.linalg.eig(matrix + np.diag(np.diag(matrix) * steps * spread))
        if np.linalg.cond(vectors) < _WORST_CONDITION:
            return values.astype(np.complex128), vectors.astype(np.complex128)
    raise ValueError(f"the matrix {matrix.tolist()} has no usable eigenvectors; are two of its time constants absurd?")
