"""Variable projection: gradients against finite differences, minima against scipy's trust-region method."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime, least_squares

from fitting.joint import JointWalk, SharedSets, VariableProjection, common_inputs, shared_slopes
from fitting.rules import Antecedents
from fitting.scaling import Scaling, scale_target
from fitting.starts import grid

RIDGE = 1e-6


def small(n_rules: int = 3, n_inputs: int = 2) -> tuple[VariableProjection, NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(n_rules + n_inputs)
    inputs = rng.normal(size=(60, n_inputs))
    targets = np.sin(inputs.sum(axis=1)) + 0.1 * rng.standard_normal(60)
    problem = VariableProjection(inputs, targets, n_rules, RIDGE)
    centres, widths = rng.normal(size=(n_rules, n_inputs)), rng.uniform(0.5, 1.5, (n_rules, n_inputs))
    return problem, problem.pack(Antecedents(centres, widths)), inputs


def cost_of(problem: VariableProjection | SharedSets) -> Callable[[NDArray[np.float64]], float]:
    def cost(parameters: NDArray[np.float64]) -> float:
        return problem.evaluate(parameters).cost

    return cost


@pytest.mark.parametrize(("n_rules", "n_inputs"), [(1, 1), (2, 1), (3, 2), (4, 3)])
def test_gradient_agrees_with_finite_differences(n_rules: int, n_inputs: int) -> None:
    problem, start, _ = small(n_rules, n_inputs)
    _, downhill = problem.normal_equations(problem.evaluate(start))
    numeric = approx_fprime(start, cost_of(problem), 1e-7)
    assert -2.0 * downhill == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_jacobian_is_the_change_of_the_output_with_the_consequents_held() -> None:
    problem, start, inputs = small()
    fit = problem.evaluate(start)
    regressors = problem.unpack(start).regressors(inputs)

    def output(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return problem.unpack(p).regressors(inputs) @ fit.theta

    numeric = np.array([(output(start + h) - output(start - h)) / 2e-6 for h in 1e-6 * np.eye(len(start))])
    assert np.allclose(problem.jacobian(fit), numeric, atol=1e-7)
    hat = regressors @ np.linalg.solve(regressors.T @ regressors + RIDGE * np.eye(regressors.shape[1]), regressors.T)
    curvature, _ = problem.normal_equations(fit)
    assert np.allclose(curvature, numeric @ (np.eye(len(inputs)) - hat) @ numeric.T, atol=1e-5)


def test_consequents_minimise_at_every_point() -> None:
    problem, start, inputs = small()
    regressors = problem.unpack(start).regressors(inputs)
    fit = problem.evaluate(start)
    stacked = np.vstack([regressors, np.sqrt(RIDGE) * np.eye(regressors.shape[1])])
    padded = np.concatenate([fit.residual + regressors @ fit.theta, np.zeros(regressors.shape[1])])
    best = np.linalg.lstsq(stacked, padded)[0]
    assert fit.theta == pytest.approx(best, rel=1e-6, abs=1e-8)
    assert fit.cost == pytest.approx(float(np.sum((stacked @ best - padded) ** 2)), rel=1e-9)


def test_shared_sets_have_the_gradient_of_their_own_unknowns() -> None:
    rng = np.random.default_rng(4)
    inputs = rng.normal(size=(80, 2))
    whole = VariableProjection(inputs, np.tanh(inputs[:, 0]) * inputs[:, 1], 6, RIDGE)
    shared = SharedSets(whole, (2, 3))
    start = shared.pack(grid(inputs, (2, 3)).antecedents)
    assert len(start) == 10
    _, downhill = shared.normal_equations(shared.evaluate(start))
    numeric = approx_fprime(start, cost_of(shared), 1e-7)
    assert -2.0 * downhill == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_shared_sets_stay_a_grid() -> None:
    rng = np.random.default_rng(5)
    inputs = rng.normal(size=(80, 2))
    start = grid(inputs, (2, 3)).antecedents
    walk = JointWalk(inputs, np.tanh(inputs[:, 0]) * inputs[:, 1], start, ridge=RIDGE, sets=(2, 3))
    found = walk.advance(30).antecedents
    for values in (found.centres, found.widths):
        low, high = values.reshape(2, 3, 2)
        assert np.ptp(low[:, 0]) == np.ptp(high[:, 0]) == 0.0
        assert np.array_equal(low[:, 1], high[:, 1])
    assert not np.allclose(found.centres, start.centres)


def test_reaches_scipys_minimum_on_surface_a(campaign: Callable[..., Any]) -> None:
    """Same start, same reduced problem: at least as low as the trf of fitting notes, section 3."""
    data = campaign(0)
    rows, _ = data.split(0, 470)
    inputs = Scaling.of(data.inputs[rows]).apply(data.inputs[rows])
    targets, _, _ = scale_target(data.reference[rows])
    start = grid(inputs, (2, 2)).antecedents
    problem = VariableProjection(inputs, targets, 4, 1e-8)

    def residual(p: NDArray[np.float64]) -> NDArray[np.float64]:
        fit = problem.evaluate(p)
        return np.concatenate([fit.residual, np.sqrt(problem.ridge) * fit.theta])

    expected = least_squares(residual, problem.pack(start), bounds=problem.bounds, method="trf", max_nfev=200)
    found = JointWalk(inputs, targets, start, ridge=1e-8).advance(200)
    assert found.optimum.cost <= 2.0 * expected.cost * 1.02


def test_parameters_stay_inside_the_bounds() -> None:
    problem, _, inputs = small()
    wild = Antecedents(np.full((3, 2), 50.0), np.array([[1e-9, 1e9]] * 3))
    lower, upper = problem.bounds
    packed = problem.pack(wild)
    assert (packed >= lower).all() and (packed <= upper).all()
    found = JointWalk(inputs, np.sin(9.0 * inputs[:, 0]), wild, ridge=RIDGE).advance(50).antecedents
    assert (np.abs(found.centres) <= 4.0).all()
    assert (found.widths >= 0.08 - 1e-12).all() and (found.widths <= 20.0 + 1e-9).all()


def test_without_a_ridge_and_with_fewer_rows_than_unknowns() -> None:
    rng = np.random.default_rng(6)
    inputs = rng.normal(size=(5, 2))
    found = JointWalk(inputs, rng.normal(size=5), grid(inputs, (2, 2)).antecedents, ridge=0.0).advance(20)
    assert np.isfinite(found.optimum.cost)


def tied_problem(n_inputs: int) -> tuple[SharedSets, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(20 + n_inputs)
    inputs = rng.normal(size=(90, n_inputs))
    targets = np.tanh(inputs[:, 0]) * inputs[:, -1] + 0.3 * inputs[:, 0] + 0.05 * rng.standard_normal(90)
    start = grid(inputs, (2,) * n_inputs)
    whole = VariableProjection(inputs, targets, 2**n_inputs, RIDGE, common_inputs(n_inputs))
    shared = SharedSets(whole, (2,) * n_inputs, equal_widths=True)
    return shared, shared.pack(start.antecedents), inputs, targets


@pytest.mark.parametrize("n_inputs", [1, 2, 3])
def test_gradient_of_tied_rules_agrees_with_finite_differences(n_inputs: int) -> None:
    problem, start, _, _ = tied_problem(n_inputs)
    assert len(start) == 3 * n_inputs  # two centres and one width an input
    start = start + 0.1 * np.random.default_rng(0).standard_normal(len(start))
    _, downhill = problem.normal_equations(problem.evaluate(start))
    numeric = approx_fprime(start, cost_of(problem), 1e-7)
    assert -2.0 * downhill == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_tied_rules_have_one_width_an_input_and_one_slope_of_all_but_the_last() -> None:
    problem, start, inputs, targets = tied_problem(2)
    antecedents = problem.unpack(start + 0.1)
    assert np.ptp(antecedents.widths, axis=0) == pytest.approx(0.0)
    slopes = shared_slopes(4, 2, (0,))
    fit = problem.evaluate(start + 0.1)
    consequents = (slopes @ fit.theta).reshape(4, 3)
    assert np.ptp(consequents[:, 1]) == 0.0 and np.ptp(consequents[:, 2]) > 0.0
    by_hand = np.linalg.lstsq(
        np.column_stack([antecedents.regressors(inputs)[:, [0, 3, 6, 9, 2, 5, 8, 11]], inputs[:, 0]]), targets
    )[0]
    assert fit.theta[[0, 1, 2, 3, 5, 6, 7, 8, 4]] == pytest.approx(by_hand, abs=1e-3)
