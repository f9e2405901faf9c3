"""Exact left-out errors against fits really made without the rows, and the solution against scikit-learn."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.kernel_ridge import KernelRidge

from fitting.kernel_system import KernelSystem
from fitting.kernels import gaussian, monomial_powers, monomials, quintic, squared_distances

RIDGES = np.array([1e-6, 1e-3, 1.0])


def problem(n: int = 30, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(n, 2))
    return inputs, np.sin(2.0 * inputs[:, 0]) + inputs[:, 1] + 0.1 * rng.standard_normal(n)


def kernel_of(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return gaussian(squared_distances(a, b))


def dual(
    kernel: NDArray[np.float64], trend: NDArray[np.float64], targets: NDArray[np.float64], ridge: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The whole bordered system of the textbook, solved as it stands."""
    n, q = trend.shape
    whole = np.block([[kernel + ridge * np.eye(n), trend], [trend.T, np.zeros((q, q))]])
    solution = np.linalg.solve(whole, np.concatenate([targets, np.zeros(q)]))
    return solution[:n], solution[n:]


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("ridge", RIDGES)
def test_solution_is_that_of_the_bordered_system(degree: int, ridge: float) -> None:
    inputs, targets = problem()
    kernel, trend = kernel_of(inputs, inputs), monomials(inputs, monomial_powers(2, degree))
    weights, coefficients = KernelSystem(kernel.copy(), trend).solve(targets, ridge)
    expected = dual(kernel, trend, targets, ridge)
    assert weights == pytest.approx(expected[0], rel=1e-6, abs=1e-7 / ridge * 1e-3)
    assert coefficients == pytest.approx(expected[1], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("degree", [0, 1])
def test_left_out_errors_are_those_of_fits_without_the_row(degree: int) -> None:
    inputs, targets = problem(20)
    kernel, trend = kernel_of(inputs, inputs), monomials(inputs, monomial_powers(2, degree))
    found = KernelSystem(kernel.copy(), trend).left_out(targets, RIDGES)
    for column, ridge in enumerate(RIDGES):
        for i in range(20):
            rest = np.delete(np.arange(20), i)
            weights, coefficients = dual(kernel[np.ix_(rest, rest)], trend[rest], targets[rest], ridge)
            predicted = kernel[i, rest] @ weights + trend[i] @ coefficients
            assert found[i, column] == pytest.approx(targets[i] - predicted, rel=1e-6, abs=1e-7)


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 6), st.integers(0, 10**6))
def test_groups_left_out_are_those_of_fits_without_the_group(count: int, seed: int) -> None:
    inputs, targets = problem(24, seed)
    groups = (np.random.default_rng(seed).permutation(24) % count).astype(np.intp)
    kernel, trend = kernel_of(inputs, inputs), np.ones((24, 1))
    found = KernelSystem(kernel.copy(), trend).groups_left_out(targets, RIDGES[1:], groups)
    for column, ridge in enumerate(RIDGES[1:]):
        for group in range(count):
            held = groups == group
            weights, bias = dual(kernel[np.ix_(~held, ~held)], trend[~held], targets[~held], ridge)
            predicted = kernel[np.ix_(held, ~held)] @ weights + bias[0]
            assert found[held, column] == pytest.approx(targets[held] - predicted, rel=1e-5, abs=1e-6)


def test_groups_of_one_row_are_leave_one_out() -> None:
    inputs, targets = problem(15)
    system = KernelSystem(kernel_of(inputs, inputs), np.ones((15, 1)))
    one = system.left_out(targets, RIDGES)
    assert np.allclose(system.groups_left_out(targets, RIDGES, np.arange(15)), one, rtol=1e-6)


def test_without_a_trend_it_is_kernel_ridge() -> None:
    inputs, targets = problem()
    kernel = kernel_of(inputs, inputs)
    # A trend that is one row's own leaves that row out, and gives the others no bias.
    system = KernelSystem(kernel.copy(), np.eye(30)[:, [29]])
    weights, _ = system.solve(targets, 0.01)
    oracle = KernelRidge(alpha=0.01, kernel="rbf", gamma=0.5).fit(inputs[:29], targets[:29])
    assert weights[:29] == pytest.approx(oracle.dual_coef_, rel=1e-7)
    assert weights[29] == pytest.approx(0.0, abs=1e-9)


def test_tuning_finds_the_smallest_error() -> None:
    inputs, targets = problem(40)
    system = KernelSystem(kernel_of(inputs, inputs), np.ones((40, 1)))
    ridges = 10.0 ** np.linspace(-8.0, 2.0, 21)
    errors = (system.left_out(targets, ridges) ** 2).mean(axis=0)
    found = system.tune(targets, ridges)
    assert found.ridge == ridges[np.argmin(errors)]
    assert found.error == pytest.approx(errors.min())


def test_freedom_is_the_trace_of_the_smoother() -> None:
    inputs, _ = problem(20)
    system = KernelSystem(kernel_of(inputs, inputs), np.ones((20, 1)))
    smoother = np.empty((20, 20))
    for k in range(20):
        weights, bias = system.solve(np.eye(20)[k], 0.1)
        smoother[:, k] = system.kernel @ weights + bias[0]
    assert system.freedom(0.1) == pytest.approx(np.trace(smoother))


@pytest.mark.parametrize("n", [1, 2, 5])
def test_fewer_rows_than_terms_are_fitted_exactly(n: int) -> None:
    inputs, targets = problem(n)
    trend = monomials(inputs, monomial_powers(2, 2))
    weights, coefficients = KernelSystem(quintic(squared_distances(inputs, inputs)), trend).solve(targets, 0.0)
    assert np.allclose(weights, 0.0)
    assert trend @ coefficients == pytest.approx(targets)


def test_a_row_that_the_trend_needs_has_an_infinite_error() -> None:
    inputs, targets = problem(10)
    trend = np.column_stack([np.ones(10), np.eye(10)[:, 3]])
    errors = KernelSystem(kernel_of(inputs, inputs), trend).left_out(targets, RIDGES)
    assert np.isinf(errors[3]).all() and np.isfinite(np.delete(errors, 3, axis=0)).all()
