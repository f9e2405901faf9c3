"""The batch solution against numpy, and the two on-line forms against the batch."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.consequents import INITIAL_COVARIANCE, RecursiveLeastSquares, SquareRootLeastSquares, batch


def problem(seed: int, n: int = 120, size: int = 6) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    regressors = rng.normal(size=(n, size))
    return regressors, regressors @ rng.normal(size=size) + 0.01 * rng.standard_normal(n)


def test_batch_is_ridge_least_squares() -> None:
    regressors, targets = problem(0)
    normal = regressors.T @ regressors + 0.5 * np.eye(6)
    found = batch(regressors, targets, 0.5)
    assert found.theta == pytest.approx(np.linalg.solve(normal, regressors.T @ targets), rel=1e-10)
    assert np.allclose(found.unit_covariance, np.linalg.inv(normal), rtol=1e-10)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_recursive_agrees_with_batch(seed: int) -> None:
    """Reference experiment ts: 'batch least squares is the same limit; both must agree'. P(0) = 1e6 I."""
    regressors, targets = problem(seed)
    solver = RecursiveLeastSquares(6)
    solver.update(regressors, targets)
    same_prior = batch(regressors, targets, 1.0 / INITIAL_COVARIANCE)
    assert solver.solution().theta == pytest.approx(same_prior.theta, rel=1e-7, abs=1e-8)
    assert np.allclose(solver.solution().unit_covariance, same_prior.unit_covariance, rtol=1e-4, atol=1e-9)
    assert solver.solution().theta == pytest.approx(batch(regressors, targets, 0.0).theta, rel=1e-6, abs=1e-7)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 130))
def test_square_root_form_agrees_with_batch_in_any_blocks(seed: int, block: int) -> None:
    regressors, targets = problem(seed)
    solver = SquareRootLeastSquares(6)
    for first in range(0, len(targets), block):
        solver.update(regressors[first : first + block], targets[first : first + block])
    expected = batch(regressors, targets, 1.0 / INITIAL_COVARIANCE)
    assert solver.solution().theta == pytest.approx(expected.theta, rel=1e-9, abs=1e-11)
    assert np.allclose(solver.solution().unit_covariance, expected.unit_covariance, rtol=1e-8, atol=1e-14)


def test_square_root_form_survives_a_prior_the_recursion_does_not() -> None:
    """A nearly dependent column and P(0) = 1e12 I: the subtraction in P loses definiteness, the triangle cannot."""
    regressors, targets = problem(3)
    regressors[:, 5] = regressors[:, 4] + 1e-6 * regressors[:, 5]
    solver = SquareRootLeastSquares(6, initial_covariance=1e12)
    solver.update(regressors, targets)
    found = solver.solution()
    assert (np.linalg.eigvalsh(found.unit_covariance) > 0.0).all()
    residual = regressors @ found.theta - targets
    stacked, padded = np.vstack([regressors, 1e-6 * np.eye(6)]), np.concatenate([targets, np.zeros(6)])
    best = regressors @ np.linalg.lstsq(stacked, padded)[0] - targets
    assert np.linalg.norm(residual) == pytest.approx(np.linalg.norm(best), rel=1e-6)


@pytest.mark.parametrize("ridge", [0.0, 1e-8])
def test_fewer_rows_than_unknowns_are_fitted_exactly(ridge: float) -> None:
    regressors, targets = problem(4, n=4)
    found = batch(regressors, targets, ridge)
    assert regressors @ found.theta == pytest.approx(targets, abs=1e-6)
    assert np.isfinite(found.unit_covariance).all()


def test_dependent_and_empty_columns_are_survived() -> None:
    regressors, targets = problem(5)
    regressors[:, 1] = regressors[:, 0]
    regressors[:, 2] = 0.0
    found = batch(regressors, targets, 0.0)
    best = regressors @ np.linalg.lstsq(regressors, targets)[0]
    assert regressors @ found.theta == pytest.approx(best, abs=1e-6)
