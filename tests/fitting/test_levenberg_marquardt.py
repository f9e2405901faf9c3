"""The minimiser against scipy's least_squares."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fitting.levenberg_marquardt import Walk

Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]
FREE = (np.full(2, -np.inf), np.full(2, np.inf))


@dataclass
class Point:
    cost: float
    residual: NDArray[np.float64]
    jacobian: NDArray[np.float64]


class Residuals:
    """A problem from residual and Jacobian functions."""

    def __init__(self, residual: Function, jacobian: Function) -> None:
        self.residual, self.jacobian, self.costs = residual, jacobian, list[float]()

    def evaluate(self, parameters: NDArray[np.float64]) -> Point:
        residual = self.residual(parameters)
        self.costs.append(float(residual @ residual))
        return Point(self.costs[-1], residual, self.jacobian(parameters))

    def normal_equations(self, evaluation: Point) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        jacobian = evaluation.jacobian
        return jacobian.T @ jacobian, -jacobian.T @ evaluation.residual


def rosenbrock(p: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])


def rosenbrock_jacobian(p: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([[-20.0 * p[0], 10.0], [-1.0, 0.0]])


def banana() -> Residuals:
    return Residuals(rosenbrock, rosenbrock_jacobian)


def test_reaches_the_minimum() -> None:
    found = Walk(banana(), np.array([-1.2, 1.0]), FREE).advance(200)
    assert found.converged and found.n_iter < 60
    assert found.parameters == pytest.approx([1.0, 1.0], abs=1e-6)


@pytest.mark.parametrize("upper", [0.5, 0.8, 1.5])
def test_reaches_scipys_minimum_inside_bounds(upper: float) -> None:
    bounds = (np.array([-2.0, -2.0]), np.array([upper, 2.0]))
    start = np.array([-1.2, 1.0])
    found = Walk(banana(), start, bounds).advance(300)
    expected = least_squares(rosenbrock, start, rosenbrock_jacobian, bounds=bounds, ftol=1e-14, xtol=1e-14, gtol=1e-14)
    assert found.parameters == pytest.approx(expected.x, abs=1e-4)
    assert found.cost == pytest.approx(2.0 * expected.cost, abs=1e-8)
    assert (found.parameters <= bounds[1]).all()


def test_going_on_is_the_same_as_going_at_once() -> None:
    start = np.array([-1.2, 1.0])
    walk = Walk(banana(), start, FREE)
    early = walk.advance(5)
    late = walk.advance(40)
    once = Walk(banana(), start, FREE).advance(40)
    assert early.n_iter == 5 and early.cost > late.cost
    assert np.array_equal(late.parameters, once.parameters) and late.n_iter == once.n_iter


def test_a_perfect_start_ends_at_once() -> None:
    found = Walk(banana(), np.array([1.0, 1.0]), FREE).advance(50)
    assert found.cost == 0.0 and found.converged and found.n_iter <= 2


def test_where_the_problem_is_not_defined_is_walked_around() -> None:
    def residual(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([p[0] - 3.0, p[1]]) if p[0] < 2.0 else np.array([np.inf, 0.0])

    found = Walk(Residuals(residual, lambda p: np.eye(2)), np.array([0.0, 1.0]), FREE).advance(300)
    assert 1.9 < found.parameters[0] < 2.0
    assert np.isfinite(found.cost)


def test_a_singular_problem_ends() -> None:
    flat = Residuals(lambda p: np.array([1.0, 1.0]), lambda p: np.zeros((2, 2)))
    assert Walk(flat, np.zeros(2), FREE).advance(100).converged
