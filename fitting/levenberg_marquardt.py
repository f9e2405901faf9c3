"""A compact Levenberg-Marquardt minimiser with simple bounds, for problems that give their own normal equations.

Damping after Nielsen (IMM-REP-1999-05) with Marquardt's scaling; a parameter that meets a bound stops there and the
others are solved around it.
"""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

_START_DAMPING = 1e-2
_LARGEST_DAMPING = 1e12
# Gain ratio above which a step is taken, and how many small steps in a row mean the end.
_ACCEPT, _SMALL_STEPS = 1e-4, 3


class Evaluation(Protocol):
    """What a problem knows about one point; cost is finite, or infinite where the problem is not defined."""

    @property
    def cost(self) -> float:
        """The value to minimise."""


E = TypeVar("E", bound=Evaluation)


class Problem(Protocol[E]):
    """A sum of squares f(p) = |r(p)|^2."""

    def evaluate(self, parameters: NDArray[np.float64]) -> E:
        """The cost at p (and whatever `normal_equations` wants to reuse)."""

    def normal_equations(self, evaluation: E) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """J'J and the downhill direction -J'r at an evaluated point."""


@dataclass(frozen=True)
class Optimum:
    """Where a walk stopped.

    n_iter: trial steps made. converged: nothing worth a step is left, because three successive steps gained less than
    the tolerance or the next one promises less.
    """

    parameters: NDArray[np.float64]
    cost: float
    n_iter: int
    converged: bool


class Walk(Generic[E]):
    """A walk downhill from start (p,), clipped into bounds ((p,), (p,)); it can be continued where it stopped.

    tolerance: relative gain of a step below which it counts as small.
    """

    def __init__(
        self,
        problem: Problem[E],
        start: NDArray[np.float64],
        bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
        tolerance: float = 1e-8,
    ) -> None:
        self.n_iter = 0
        self.problem, self.bounds, self.tolerance = problem, bounds, tolerance
        self.damping, self.growth = _START_DAMPING, 2.0
        self.small_steps, self.converged = 0, False
        self.parameters = np.clip(start, *bounds)
        self._stand_on(problem.evaluate(self.parameters))

    def _stand_on(self, evaluation: E) -> None:
        self.here = evaluation
        self.curvature, self.downhill = self.problem.normal_equations(evaluation)

    def _move(self) -> NDArray[np.float64] | None:
        """Solve (A + lambda diag A) s = g inside the box; None if the matrix is not positive definite.

        A parameter whose step would leave the box stops at its bound and the others are solved again around it.
        """
        below, above = (bound - self.parameters for bound in self.bounds)
        held = (below >= 0.0) & (self.downhill < 0.0) | (above <= 0.0) & (self.downhill > 0.0)
        diagonal = self.curvature.diagonal()
        floor = 1e-10 * diagonal.max(initial=0.0) + np.finfo(np.float64).tiny
        damped = self.curvature.copy()
        damped.flat[:: len(damped) + 1] += self.damping * np.maximum(diagonal, floor)
        move = np.zeros(len(damped))
        for _ in range(len(damped) + 1):
            solved = _solve_around(damped, self.downhill, held, move)
            if solved is None:
                return None
            move = np.clip(solved, below, above)
            outside = move != solved
            if not outside.any():
                break
            held = held | outside
        return move

    def advance(self, max_iter: int) -> Optimum:
        """Go on until n_iter trial steps have been made in all, or until it converges."""
        while self.n_iter < max_iter and not self.converged:
            self._step()
            self.n_iter += 1
        return Optimum(self.parameters, self.here.cost, self.n_iter, self.converged)

    def _step(self) -> None:
        """One trial step: taken if the cost falls, otherwise the damping grows."""
        move = self._move()
        if move is None or not np.isfinite(move).all():
            return self._reject()
        trial = np.clip(self.parameters + move, *self.bounds)
        predicted = float(2.0 * move @ self.downhill - move @ self.curvature @ move)
        evaluation = self.problem.evaluate(trial)
        gained = self.here.cost - evaluation.cost
        if predicted > 0.0 and gained > _ACCEPT * predicted:
            return self._accept(trial, evaluation, gained, predicted)
        if 0.0 <= predicted <= 0.01 * self.tolerance * self.here.cost:
            self.converged = True
        return self._reject()

    def _accept(self, trial: NDArray[np.float64], evaluation: E, gained: float, predicted: float) -> None:
        self.small_steps = self.small_steps + 1 if gained < self.tolerance * self.here.cost else 0
        self.converged = self.small_steps >= _SMALL_STEPS
        # From a ratio of 1 on the factor is 1/3; a prediction of next to nothing would overflow the cube.
        ratio = min(gained / predicted, 2.0)
        self.damping *= max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
        self.growth = 2.0
        self.parameters = trial
        self._stand_on(evaluation)

    def _reject(self) -> None:
        self.damping *= self.growth
        self.growth *= 2.0
        self.converged = self.converged or self.damping > _LARGEST_DAMPING


def _solve_around(
    matrix: NDArray[np.float64], target: NDArray[np.float64], held: NDArray[np.bool_], values: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Solve matrix s = target for the entries not held, the others being given; None if not positive definite."""
    if held.any():
        target = target - matrix @ np.where(held, values, 0.0)
        target[held] = values[held]
        matrix = matrix.copy()
        matrix[held, :] = 0.0
        matrix[:, held] = 0.0
        matrix[held, held] = 1.0
    factor, failed = dpotrf(matrix, lower=1)
    if failed:
        return None
    solution, _ = dpotrs(factor, target, lower=1)
    return np.asarray(solution)
