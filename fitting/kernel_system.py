"""Kernel least squares with an unpenalised part, and its exact leave-one-out errors, for every ridge at once.

    minimise |y - K a - P b|^2 + ridge a'K a   with P'a = 0,   that is   [K + ridge I, P; P', 0] [a; b] = [y; 0]

is the dual of the least-squares support vector machine (P = 1, ridge = 1/gamma; Suykens and Vandewalle, 1999), a
smoothing radial basis interpolator (P = polynomials) and the mean of a Gaussian process with an unknown trend.
With N a basis of the complement of P and N'K N = U diag(s) U', W = N U: a = W (W'y / (s + ridge)), and the upper left
block of the inverse is C = W diag(1/(s + ridge)) W'. The error of a row predicted from the others is a_i / C_ii
(Cawley and Talbot, Neural Networks 17, 2004), of a group of rows the solution of C_GG e = a_G. One decomposition
serves every ridge, and P is as if estimated anew each time.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

# Directions of P below this share of the largest are dependent on the others: duplicate rows, fewer rows than terms.
_DEPENDENT = 1e-10


@dataclass(frozen=True)
class Tuned:
    """A ridge and the mean square of the errors left out that it gives."""

    ridge: float
    error: float


class KernelSystem:
    """kernel: (n, n), positive semidefinite on the complement of trend; trend: P, (n, q), of any rank."""

    def __init__(self, kernel: NDArray[np.float64], trend: NDArray[np.float64]) -> None:
        self.kernel, self.trend = kernel, trend
        left, singular, _ = np.linalg.svd(trend, full_matrices=False)
        span = left[:, singular > _DEPENDENT * singular[0]]
        inside = kernel @ span
        # The complement alone, with P's own directions moved above all others, where they are told from them.
        projected = kernel - inside @ span.T
        projected -= span @ (span.T @ projected)
        top = 2.0 * max(float(np.trace(projected)), 0.0) + 1.0
        projected += top * (span @ span.T)
        values, vectors = scipy.linalg.eigh(projected, overwrite_a=True, check_finite=False, driver="evd")
        rank = len(kernel) - span.shape[1]
        self.values = np.maximum(values[:rank], 0.0)
        self.vectors = np.asarray(vectors[:, :rank])

    def shrink(self, ridges: NDArray[np.float64]) -> NDArray[np.float64]:
        """1 / (s + ridge), (rank, ridges); a ridge below rounding is raised to it."""
        smallest = np.finfo(np.float64).eps * max(float(self.values.max(initial=0.0)), np.finfo(np.float64).tiny)
        return np.asarray(1.0 / (self.values[:, np.newaxis] + np.maximum(ridges, smallest)))

    def freedom(self, ridge: float) -> float:
        """Degrees of freedom: the trace of the matrix that takes targets to fitted values, P included."""
        return float(len(self.kernel) - ridge * self.shrink(np.array([ridge])).sum())

    def weights(self, targets: NDArray[np.float64], ridges: NDArray[np.float64]) -> NDArray[np.float64]:
        """a for every ridge, (n, ridges); targets: (n,)."""
        rotated = self.vectors.T @ targets
        return np.asarray(self.vectors @ (rotated[:, np.newaxis] * self.shrink(ridges)))

    def solve(self, targets: NDArray[np.float64], ridge: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """a (n,) and b (q,) for one ridge; b is the shortest of equals where P is not of full rank."""
        weights = self.weights(targets, np.array([ridge]))[:, 0]
        rest = targets - self.kernel @ weights - ridge * weights
        return weights, np.asarray(np.linalg.lstsq(self.trend, rest, rcond=_DEPENDENT)[0])

    @cached_property
    def _squared(self) -> NDArray[np.float64]:
        return np.asarray(self.vectors * self.vectors)

    def left_out(self, targets: NDArray[np.float64], ridges: NDArray[np.float64]) -> NDArray[np.float64]:
        """y_i minus its prediction from all other rows, (n, ridges); 0/0, where a row is needed for P, is infinite."""
        diagonal = self._squared @ self.shrink(ridges)
        weights = self.weights(targets, ridges)
        usable = diagonal > _DEPENDENT * diagonal.max(axis=0, initial=0.0)
        return np.divide(weights, diagonal, out=np.full_like(weights, np.inf), where=usable)

    def groups_left_out(
        self, targets: NDArray[np.float64], ridges: NDArray[np.float64], groups: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """y_i minus its prediction from all rows of other groups, (n, ridges); groups: (n,), numbers from 0."""
        shrink, weights = self.shrink(ridges), self.weights(targets, ridges)
        errors = np.empty_like(weights)
        for group in range(int(groups.max()) + 1):
            rows = groups == group
            own = self.vectors[rows]
            blocks = np.array([(own * column) @ own.T for column in shrink.T])
            try:
                errors[rows] = np.linalg.solve(blocks, weights[rows].T[:, :, np.newaxis])[:, :, 0].T
            except np.linalg.LinAlgError:  # the group is needed for P
                errors[rows] = np.inf
        return errors

    def tune(
        self, targets: NDArray[np.float64], ridges: NDArray[np.float64], groups: NDArray[np.intp] | None = None
    ) -> Tuned:
        """The ridge with the smallest mean square of left-out errors, of rows or of groups."""
        if groups is None:
            errors = self.left_out(targets, ridges)
        else:
            errors = self.groups_left_out(targets, ridges, groups)
        squares = np.mean(errors**2, axis=0)
        best = int(np.argmin(np.where(np.isfinite(squares), squares, np.inf)))
        return Tuned(float(ridges[best]), float(squares[best]))
