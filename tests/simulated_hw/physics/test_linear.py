"""The exact solver against scipy's step-by-step integration; answers do not depend on what else is asked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from simulated_hw.physics.linear import LinearSystem

CASES = {
    "real": [[-1.0, 0.4], [0.3, -2.0]],
    "oscillating": [[-0.1, 2.0, 0.0], [-2.0, -0.1, 0.0], [1.0, 0.5, -1.0]],
    "integrating": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -9.0, -3.0]],
    "growing": [[0.2, 0.0], [1.0, -1.0]],
}


def integrated(matrix, start, b0, b1, times):
    a = np.asarray(matrix)
    solution = solve_ivp(
        lambda t, x: a @ x + b0 + b1 * t, (0.0, times[-1]), start, t_eval=times, rtol=1e-11, atol=1e-12
    )
    return solution.y.T


@pytest.mark.parametrize("matrix", CASES.values(), ids=CASES.keys())
def test_agrees_with_numerical_integration(matrix):
    n = len(matrix)
    rng = np.random.default_rng(5)
    start, b0, b1 = rng.normal(size=(3, n))
    times = np.linspace(0.0, 7.0, 23)
    trajectory = LinearSystem(np.array(matrix)).solve(start, b0, b1)
    np.testing.assert_allclose(trajectory.at(times), integrated(matrix, start, b0, b1, times), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(trajectory.state(3.3), trajectory.at(np.array([3.3]))[0], rtol=1e-12)


def test_a_chain_of_equal_time_constants_has_no_eigenvectors_and_is_solved_all_the_same():
    chain = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]) / 300.0
    b0 = np.array([1.0 / 300.0, 0.0, 0.0])
    t = np.linspace(0.0, 3000.0, 50)
    trajectory = LinearSystem(chain).solve(np.zeros(3), b0)
    u = t / 300.0  # three equal lags: an Erlang distribution
    np.testing.assert_allclose(trajectory.at(t)[:, 2], 1 - np.exp(-u) * (1 + u + u**2 / 2), atol=1e-3)


@given(split=st.floats(0.01, 6.9), cut=st.integers(1, 40))
@settings(max_examples=40, deadline=None)
def test_one_step_equals_two_and_any_subset_of_times_gives_the_same_bits(split, cut):
    system = LinearSystem(np.array(CASES["oscillating"]))
    start, b0, b1 = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, 0.3]), np.array([0.01, -0.02, 0.0])
    whole = system.solve(start, b0, b1)
    second = system.solve(whole.state(split), b0 + b1 * split, b1)
    np.testing.assert_allclose(second.state(7.0 - split), whole.state(7.0), rtol=1e-10, atol=1e-12)
    times = np.linspace(0.0, 7.0, 41)
    parts = np.concatenate([whole.at(times[:cut]), whole.at(times[cut:])])
    assert parts.tobytes() == whole.at(times).tobytes()


def test_a_projection_is_the_combination_of_the_states():
    trajectory = LinearSystem(np.array(CASES["oscillating"])).solve(np.ones(3), np.ones(3), np.ones(3))
    combination = np.array([[1.0], [-2.0], [0.5]])
    t = np.linspace(0, 5, 11)
    np.testing.assert_allclose(trajectory.project(combination).at(t), trajectory.at(t) @ combination, atol=1e-12)
