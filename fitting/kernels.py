"""Models that are a sum of kernels around training rows plus a polynomial: LS-SVM, SVR, Gaussian process, RBF.

f(z) = sum_j b_j prod_k z_k^p_jk + sum_i a_i K(|z - s_i|), with z the inputs shifted and scaled.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

# Kernel values held at a time: 8 MB of float64, whatever the number of supports.
_CHUNK_VALUES = 2**20


def gaussian(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """exp(-r^2 / 2) of squared distances; works in place."""
    squares *= -0.5
    np.exp(squares, out=squares)
    return squares


def quintic(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """-r^5 of squared distances, positive definite beside polynomials of degree 2."""
    fifth: NDArray[np.float64] = -squares * squares * np.sqrt(squares)
    return fifth


KERNELS: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {"gaussian": gaussian, "quintic": quintic}


def squared_distances(rows: NDArray[np.float64], supports: NDArray[np.float64]) -> NDArray[np.float64]:
    """|row - support|^2, (n, m), of (n, d) and (m, d); by differences, so that it is exact for close points."""
    squares = np.zeros((len(rows), len(supports)))
    for k in range(rows.shape[1]):
        difference = rows[:, k, np.newaxis] - supports[:, k]
        difference *= difference
        squares += difference
    return squares


def monomial_powers(n_inputs: int, degree: int) -> NDArray[np.intp]:
    """Powers of all monomials up to a total degree, constant first, shape (m, n_inputs)."""
    rows = [
        np.bincount(np.array(chosen, dtype=np.intp), minlength=n_inputs)[:n_inputs]
        for total in range(degree + 1)
        for chosen in combinations_with_replacement(range(n_inputs), total)
    ]
    return np.array(rows, dtype=np.intp).reshape(len(rows), n_inputs)


def monomials(rows: NDArray[np.float64], powers: NDArray[np.intp]) -> NDArray[np.float64]:
    """prod_k z_k^p_jk of rows (n, d) and powers (m, d): shape (n, m)."""
    values = np.ones((len(rows), len(powers)))
    for j, power in enumerate(powers):
        for k in np.flatnonzero(power):
            values[:, j] *= rows[:, k] ** power[k]
    return values


@dataclass(frozen=True)
class KernelModel:
    """f in the units of inputs and output: output_shift + output_scale f((x - shift) / scale).

    columns: which input columns it looks at, (d,). shift, scale: of those, (d,). kernel: a name of `KERNELS`.
    supports: (m, d), scaled; weights: (m,). powers: (q, d); coefficients: (q,).
    """

    columns: NDArray[np.intp]
    shift: NDArray[np.float64]
    scale: NDArray[np.float64]
    kernel: str
    supports: NDArray[np.float64]
    weights: NDArray[np.float64]
    powers: NDArray[np.intp]
    coefficients: NDArray[np.float64]
    output_shift: float
    output_scale: float

    def scaled(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inputs (n, k) as the kernel sees them, (n, d)."""
        return np.asarray((inputs[:, self.columns] - self.shift) / self.scale)

    def predict(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output for inputs (n, k): shape (n,). Sums along rows only, so a row's result is that of any batch."""
        output = np.empty(len(inputs))
        step = max(1, _CHUNK_VALUES // max(1, len(self.supports)))
        for first in range(0, len(inputs), step):
            rows = slice(first, first + step)
            output[rows] = self._predict_chunk(self.scaled(inputs[rows]))
        return output

    def _predict_chunk(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        terms = KERNELS[self.kernel](squared_distances(scaled, self.supports))
        terms *= self.weights
        values = (monomials(scaled, self.powers) * self.coefficients).sum(axis=1) + terms.sum(axis=1)
        return np.asarray(self.output_shift + self.output_scale * values)
