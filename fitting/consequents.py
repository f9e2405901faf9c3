"""Consequents of Takagi-Sugeno rules: linear least squares, in one batch or on line.

All three minimise sum_i (y_i - phi_i' theta)^2 + theta' theta / a. A batch solution with ridge 1/a, the recursive one
of the paper (theta(0) = 0, P(0) = a I) and the square-root information form are the same numbers but for rounding.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

# Fitting notes, section 4: a = 300 leaves theta 2e-4 off, 1e9 loses to rounding; 1e6 is best.
INITIAL_COVARIANCE = 1e6


@dataclass(frozen=True)
class Solution:
    """theta, shape (p,), and its covariance for unit residual variance, shape (p, p)."""

    theta: NDArray[np.float64]
    unit_covariance: NDArray[np.float64]


def _from_triangle(triangle: NDArray[np.float64], rotated: NDArray[np.float64]) -> Solution:
    """Solve R theta = d; the covariance is (R'R)^-1."""
    inverse = scipy.linalg.solve_triangular(triangle, np.eye(len(triangle)))
    theta = scipy.linalg.solve_triangular(triangle, rotated)
    return Solution(np.asarray(theta), np.asarray(inverse @ inverse.T))


def batch(regressors: NDArray[np.float64], targets: NDArray[np.float64], ridge: float) -> Solution:
    """Ridge least squares by QR of [Phi; sqrt(ridge) I], never by normal equations.

    regressors: (n, p); targets: (n,); ridge: at least 0, in the squared units of the regressors. Works for n < p.
    A ridge below rounding (p eps ||Phi||^2) is raised to it, so that dependent columns stay solvable.
    """
    size = regressors.shape[1]
    smallest = size * np.finfo(np.float64).eps * float(np.einsum("ij,ij->", regressors, regressors))
    root = np.sqrt(max(ridge, smallest, np.finfo(np.float64).tiny))
    stacked = np.vstack([regressors, root * np.eye(size)])
    q, r = scipy.linalg.qr(stacked, mode="economic", check_finite=False)
    return _from_triangle(r, q[: len(targets)].T @ targets)


class OnlineLeastSquares(Protocol):
    """What both on-line forms offer."""

    def update(self, regressors: NDArray[np.float64], targets: NDArray[np.float64]) -> None:
        """Take in rows (n, p) with targets (n,)."""

    def solution(self) -> Solution:
        """The least-squares solution over everything taken in so far."""


class RecursiveLeastSquares:
    """Recursive least squares as published: theta(0) = 0, P(0) = a I, one row at a time."""

    def __init__(self, size: int, initial_covariance: float = INITIAL_COVARIANCE) -> None:
        self._theta = np.zeros(size)
        self._covariance = initial_covariance * np.eye(size)

    def update(self, regressors: NDArray[np.float64], targets: NDArray[np.float64]) -> None:
        """k = P phi / (1 + phi' P phi); theta += k (y - phi' theta); P -= k (P phi)'. Rows (n, p), targets (n,)."""
        for phi, target in zip(regressors, targets, strict=True):
            direction = self._covariance @ phi
            gain = direction / (1.0 + phi @ direction)
            self._theta = self._theta + gain * (target - phi @ self._theta)
            self._covariance -= np.outer(gain, direction)

    def solution(self) -> Solution:
        """theta and P over everything taken in so far."""
        return Solution(self._theta.copy(), 0.5 * (self._covariance + self._covariance.T))


class SquareRootLeastSquares:
    """The same in information form: keeps the triangle R with R'R = P^-1 and R theta = d.

    P can never lose its positive definiteness, and rows can be taken in by blocks: the form for an on-line instrument.
    """

    def __init__(self, size: int, initial_covariance: float = INITIAL_COVARIANCE) -> None:
        self._triangle = np.eye(size) / np.sqrt(initial_covariance)
        self._rotated = np.zeros(size)

    def update(self, regressors: NDArray[np.float64], targets: NDArray[np.float64]) -> None:
        """Triangularise [R d; Phi y] again. Rows (n, p), targets (n,)."""
        size = len(self._rotated)
        upper = np.column_stack([self._triangle, self._rotated])
        stacked = np.vstack([upper, np.column_stack([regressors, targets])])
        (triangle,) = scipy.linalg.qr(stacked, mode="r", check_finite=False)
        self._triangle, self._rotated = triangle[:size, :size], triangle[:size, size]

    def solution(self) -> Solution:
        """theta and P over everything taken in so far."""
        return _from_triangle(self._triangle, self._rotated)
