"""Polynomials of a total degree, in Chebyshev polynomials of the inputs scaled to [-1, 1]."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike, NDArray

from fitting.blas import one_thread
from fitting.consequents import batch
from fitting.estimator import CompensationEstimator, require
from fitting.kernels import monomial_powers
from fitting.scaling import Scaling, scale_target
from fitting.training import unit_variance

MOST_TERMS = 2000
_CHUNK_ROWS = 4096


@dataclass(frozen=True)
class PolynomialModel:
    """sum_j c_j prod_k T_(p_jk)((x_k - middle_k) / half_k), in the unit of the output.

    columns: which input columns it looks at, (d,). middle, half: of their training range, (d,). powers: (m, d).
    coefficients: (m,).
    """

    columns: NDArray[np.intp]
    middle: NDArray[np.float64]
    half: NDArray[np.float64]
    powers: NDArray[np.intp]
    coefficients: NDArray[np.float64]

    def terms(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The polynomials of inputs (n, k), (n, m)."""
        values = np.ones((len(inputs), len(self.powers)))
        scaled = (inputs[:, self.columns] - self.middle) / self.half
        for k in range(len(self.columns)):
            values *= chebvander(scaled[:, k], int(self.powers[:, k].max()))[:, self.powers[:, k]]
        return values

    def predict(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output for inputs (n, k): shape (n,). Sums along rows only, so a row's result is that of any batch."""
        output = np.empty(len(inputs))
        for first in range(0, len(inputs), _CHUNK_ROWS):
            rows = slice(first, first + _CHUNK_ROWS)
            output[rows] = (self.terms(inputs[rows]) * self.coefficients).sum(axis=1)
        return output


class PolynomialCompensation(CompensationEstimator):
    """Least squares on all products of Chebyshev polynomials up to a total degree.

    Parameters: degree, of the sum of the powers; ridge, on the coefficients of the z-scored problem: with its default
    dependent terms share what they explain, and nothing else changes.

    Attributes: powers_ (m, d); coefficients_ (m,) and their standard uncertainties for white residuals
    coefficients_u_, in the unit of y, NaN if there are no more rows than terms; columns_: the columns used, (d,);
    n_parameters_: m. model_, training_: see `CompensationEstimator`.
    """

    model_: PolynomialModel

    def __init__(self, degree: int = 3, ridge: float = 1e-10) -> None:
        self.degree = degree
        self.ridge = ridge

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike) -> "PolynomialCompensation":
        """Fit to X (n >= 2, k) and y (n,)."""
        whole = isinstance(self.degree, int | np.integer) and self.degree >= 0
        require(whole, self, "degree", self.degree, "a whole number of at least 0")
        require(self.ridge >= 0.0, self, "ridge", self.ridge, "0 or more")
        inputs, target = self._checked(X, y)
        self.columns_ = Scaling.of(inputs).columns
        used = inputs[:, self.columns_]
        low, high = used.min(axis=0), used.max(axis=0)
        self.powers_ = _powers(len(self.columns_), self.degree)
        self.n_parameters_ = len(self.powers_)
        scaled_target, mean, std = scale_target(target)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        basis = PolynomialModel(self.columns_, middle, half, self.powers_, np.zeros(len(self.powers_)))
        solution = batch(basis.terms(inputs), scaled_target, self.ridge)
        self.coefficients_ = std * solution.theta
        self.coefficients_[0] += mean
        residual = self._keep(
            PolynomialModel(self.columns_, middle, half, self.powers_, self.coefficients_), inputs, target
        )
        variance = unit_variance(residual, len(self.powers_))
        self.coefficients_u_ = np.sqrt(variance * np.diag(solution.unit_covariance))
        return self


def _powers(n_inputs: int, degree: int) -> NDArray[np.intp]:
    """Powers of every term, constant first; ValueError if they are too many."""
    count = 1
    for k in range(1, n_inputs + 1):
        count = count * (degree + k) // k
    if count > MOST_TERMS:
        raise ValueError(
            f"PolynomialCompensation: degree {degree} of {n_inputs} inputs has {count} terms; allowed: up to "
            f"{MOST_TERMS}. Lower the degree."
        )
    return monomial_powers(n_inputs, degree)


def fifth() -> PolynomialCompensation:
    """Of total degree 5, the highest that the fitting notes compare."""
    return PolynomialCompensation(5)
