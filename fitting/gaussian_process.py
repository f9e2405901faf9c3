"""Gaussian process with one length a input, white noise and an unknown linear trend, by restricted likelihood.

y = P b + f + e with f a process of covariance a R, R = exp(-sum_k d_k^2 / (2 l_k^2)), e white of variance a lambda and
b free (Rasmussen and Williams, 2006, sections 2.7 and 5.4). With C = R + lambda I and
Q = C^-1 - C^-1 P (P'C^-1 P)^-1 P'C^-1: a = y'Q y / (n - q), and what is minimised over log l_k and log lambda is
(n - q) log a + log|C| + log|P'C^-1 P|, of gradient tr(Q dC) - (Q y)' dC (Q y) / a.
"""

from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.optimize import minimize
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.blas import one_thread
from fitting.estimator import CompensationEstimator, require_rows
from fitting.kernels import KernelModel, gaussian, monomial_powers, monomials, squared_distances
from fitting.scaling import Scaling, scale_target

# In z-scores. Noise below 1e-11 of the process cannot be told from rounding in C.
_LENGTH_LIMITS, _NOISE_LIMITS = (0.05, 100.0), (1e-11, 1e3)
_STARTS = ((1.0, 1e-6), (3.0, 1e-2))
_UNDEFINED = 1e25


@dataclass(frozen=True)
class Posterior:
    """What one set of lengths (d,) and noise gives on z-scores: the factors, weights and amplitude a."""

    lengths: NDArray[np.float64]
    noise: float
    correlation: NDArray[np.float64]  # R, (n, n)
    factor: NDArray[np.float64]  # L of C = L L', (n, n)
    trend_covariance: NDArray[np.float64]  # (P'C^-1 P)^-1, (q, q)
    projected: NDArray[np.float64]  # C^-1 P, (n, q)
    coefficients: NDArray[np.float64]  # b, (q,)
    weights: NDArray[np.float64]  # Q y, (n,)
    amplitude: float
    cost: float

    @property
    def freedom(self) -> float:
        """Effective degrees of freedom, n - lambda tr Q, the trend's included."""
        n = len(self.factor)
        inverse = scipy.linalg.solve_triangular(self.factor, np.eye(n), lower=True, check_finite=False)
        trend = np.trace(self.trend_covariance @ (self.projected.T @ self.projected))
        return float(n - self.noise * (np.sum(inverse**2) - trend))


class RestrictedLikelihood:
    """The likelihood on z-scored inputs (n, d) and targets (n,); trend: P (n, q) of full rank, q < n."""

    def __init__(self, inputs: NDArray[np.float64], targets: NDArray[np.float64], trend: NDArray[np.float64]) -> None:
        self.targets, self.trend = targets, trend
        self.squares = [squared_distances(inputs[:, [k]], inputs[:, [k]]) for k in range(inputs.shape[1])]

    def posterior(self, parameters: NDArray[np.float64]) -> Posterior | None:
        """At (log l_1 ... log l_d, log lambda); None where C cannot be factorised."""
        lengths, noise = np.exp(parameters[:-1]), float(np.exp(parameters[-1]))
        n, q = self.trend.shape
        exponent = np.zeros((n, n))
        for squares, length in zip(self.squares, lengths, strict=True):
            exponent += squares / length**2
        correlation = gaussian(exponent)
        factor, failed = dpotrf(correlation + noise * np.eye(n), lower=1)
        if failed:
            return None
        projected, _ = dpotrs(factor, self.trend, lower=1)  # by solving: products with the inverse lose digits
        try:
            triangle = np.linalg.cholesky(self.trend.T @ projected)
        except np.linalg.LinAlgError:
            return None
        trend_covariance = np.asarray(scipy.linalg.cho_solve((triangle, True), np.eye(q)))
        coefficients = trend_covariance @ (projected.T @ self.targets)
        weights, _ = dpotrs(factor, self.targets - self.trend @ coefficients, lower=1)
        amplitude = max(float(self.targets @ weights) / (n - q), np.finfo(np.float64).tiny)
        determinants = np.log(np.diag(factor)).sum() + np.log(np.diag(triangle)).sum()
        cost = float((n - q) * np.log(amplitude) + 2.0 * determinants)
        return Posterior(
            lengths, noise, correlation, factor, trend_covariance, projected, coefficients, weights, amplitude, cost
        )

    def __call__(self, parameters: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Cost and gradient, for the minimiser."""
        found = self.posterior(parameters)
        if found is None or not np.isfinite(found.cost):
            return _UNDEFINED, np.zeros_like(parameters)
        inverse, _ = dpotri(found.factor, lower=1)
        inner = np.tril(inverse) + np.tril(inverse, -1).T
        inner -= found.projected @ found.trend_covariance @ found.projected.T
        inner -= np.outer(found.weights, found.weights / found.amplitude)
        gradient = np.empty(len(parameters))
        gradient[-1] = found.noise * np.trace(inner)
        inner *= found.correlation
        for k, squares in enumerate(self.squares):
            gradient[k] = np.einsum("ij,ij->", inner, squares) / found.lengths[k] ** 2
        return found.cost, gradient

    def best(self) -> Posterior:
        """The best of two descents: from a smooth and clean process, and from a smoother and noisier one."""
        limits = [np.log(_LENGTH_LIMITS)] * len(self.squares) + [np.log(_NOISE_LIMITS)]
        ends = []
        for length, noise in _STARTS:
            start = np.log([length] * len(self.squares) + [noise])
            settings: dict[str, Any] = {"method": "L-BFGS-B", "bounds": limits, "options": {"maxiter": 60}}
            end: Any = minimize(self, start, (), jac=True, **settings)
            ends.append((float(end.fun), tuple(end.x)))
        found = self.posterior(np.array(min(ends)[1]))
        if found is None:
            raise np.linalg.LinAlgError("the covariance of the Gaussian process cannot be factorised")
        return found


class GaussianProcess(CompensationEstimator):
    """Gaussian process regression; `predict(X, return_std=True)` states the standard uncertainty of each value.

    Attributes, in the units of X and y: lengths_ of the columns used, (d,); noise_std_, of one row; amplitude_std_, of
    the process; n_parameters_, effective degrees of freedom. model_, training_: see `CompensationEstimator`.
    """

    model_: KernelModel

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike) -> "GaussianProcess":
        """Fit to X (n >= 2, k) and y (n,)."""
        inputs, target = self._checked(X, y)
        require_rows(self, len(target))
        scaling = Scaling.of(inputs)
        scaled, (scaled_target, mean, std) = scaling.apply(inputs), scale_target(target)
        powers, trend = _trend(scaled)
        found = RestrictedLikelihood(scaled, scaled_target, trend).best()
        self.posterior_ = found
        self.lengths_ = found.lengths * scaling.std
        self.amplitude_std_ = std * float(np.sqrt(found.amplitude))
        self.n_parameters_ = found.freedom
        self.noise_std_ = self.amplitude_std_ * float(np.sqrt(found.noise))
        model = KernelModel(
            scaling.columns,
            scaling.mean,
            self.lengths_,
            "gaussian",
            scaled / found.lengths,
            found.weights,
            powers,
            found.coefficients * np.prod(found.lengths**powers, axis=1),
            mean,
            std,
        )
        self._keep(model, inputs, target)
        return self

    @overload
    def predict(self, X: ArrayLike) -> NDArray[np.float64]: ...
    @overload
    def predict(self, X: ArrayLike, return_std: Literal[False]) -> NDArray[np.float64]: ...
    @overload
    def predict(self, X: ArrayLike, return_std: Literal[True]) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    def predict(
        self, X: ArrayLike, return_std: bool = False
    ) -> NDArray[np.float64] | tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Output for X (n, k), (n,); with return_std also its standard uncertainty, without the noise of a row."""
        values = super().predict(X)
        return (values, self._std(X)) if return_std else values

    @one_thread()
    def _std(self, X: ArrayLike) -> NDArray[np.float64]:
        """Root of a [1 - k'C^-1 k + (p - P'C^-1 k)' (P'C^-1 P)^-1 (p - P'C^-1 k)], (n,)."""
        check_is_fitted(self, "model_")
        scaled = self.model_.scaled(validate_data(self, X, dtype=np.float64, reset=False))
        found = self.posterior_
        cross = gaussian(squared_distances(scaled, self.model_.supports))
        trend = monomials(scaled * found.lengths, self.model_.powers) - cross @ found.projected
        whitened = scipy.linalg.solve_triangular(found.factor, cross.T, lower=True, check_finite=False)
        known = np.einsum("ij,ij->j", whitened, whitened)
        unknown = np.einsum("ij,ij->i", trend @ found.trend_covariance, trend)
        return np.asarray(self.amplitude_std_ * np.sqrt(np.maximum(1.0 - known + unknown, 0.0)))


def _trend(scaled: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Powers and values of the linear trend, or of the constant where the rows are too few or too alike for it."""
    for degree in (1, 0):
        powers = monomial_powers(scaled.shape[1], degree)
        trend = monomials(scaled, powers)
        if np.linalg.matrix_rank(trend, tol=1e-8 * len(trend)) == trend.shape[1] < len(trend):
            break
    return powers, trend
