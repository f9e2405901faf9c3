"""Networks: gradient and Jacobian against differences, accuracy on surface A, data that are not nice."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.utils.estimator_checks import check_estimator

from fitting.network import BackPropagationNetwork, published, second_order
from fitting.network_core import Activation, Shape, random_weights
from fitting.network_training import ProjectedNetwork, descend, levenberg_marquardt

MODES = {
    "gradient": published().set_params(epochs=200),
    "second order": second_order().set_params(epochs=30, hidden=6, n_starts=1),
}
SHAPES = [Shape(2, 4, "sigmoid"), Shape(3, 2, "tanh", True), Shape(1, 1, "tanh")]


def _rows(shape: Shape, seed: int = 0, n: int = 30) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    return random_weights(shape, rng), rng.standard_normal((n, shape.inputs)), rng.standard_normal(n)


@pytest.mark.parametrize("mode", MODES)
def test_is_a_scikit_learn_estimator(mode: str) -> None:
    check_estimator(MODES[mode], on_skip=None)


def test_output_is_the_sum_written_out() -> None:
    shape = Shape(2, 3, "sigmoid", True)
    weights, inputs, _ = _rows(shape)
    into, thresholds, out = weights[:6].reshape(3, 2), weights[6:9], weights[9:12]
    expected = [
        sum(out[j] / (1.0 + np.exp(-(into[j] @ x + thresholds[j]))) for j in range(3)) + weights[12] + weights[13:] @ x
        for x in inputs
    ]
    assert shape.output(weights, inputs) == pytest.approx(expected)
    assert shape.size == 15


@pytest.mark.parametrize("shape", SHAPES)
def test_many_networks_at_once_are_each_their_own(shape: Shape) -> None:
    _, inputs, _ = _rows(shape)
    many = np.stack([_rows(shape, seed)[0] for seed in range(5)])
    for weights, output in zip(many, shape.output(many, inputs), strict=True):
        assert output == pytest.approx(shape.output(weights, inputs))


@pytest.mark.parametrize("shape", SHAPES)
def test_gradient_is_that_of_differences(shape: Shape) -> None:
    weights, inputs, target = _rows(shape)
    cost, gradient = shape.gradient(weights, inputs, target)
    assert cost == pytest.approx(np.mean((shape.output(weights, inputs) - target) ** 2))
    for k in range(shape.size):
        step = 1e-6 * np.eye(shape.size)[k]
        costs = [shape.gradient(weights + sign * step, inputs, target)[0] for sign in (1.0, -1.0)]
        assert gradient[k] == pytest.approx((costs[0] - costs[1]) / 2e-6, abs=1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_downhill_direction_is_that_of_the_projected_cost(shape: Shape) -> None:
    """J'r is -1/2 of the gradient of the reduced cost: Kaufman's simplification keeps it exact."""
    weights, inputs, target = _rows(shape)
    problem, p = ProjectedNetwork(shape, inputs, target, 1e-3), weights[: shape.nonlinear]
    _, downhill = problem.normal_equations(problem.evaluate(p))
    for k in range(shape.nonlinear):
        step = 1e-6 * np.eye(shape.nonlinear)[k]
        slope = (problem.evaluate(p + step).cost - problem.evaluate(p - step).cost) / 2e-6
        assert downhill[k] == pytest.approx(-0.5 * slope, abs=1e-5)


def test_levenberg_marquardt_finds_the_network_that_made_the_data() -> None:
    shape = Shape(2, 2, "tanh")
    weights, inputs, _ = _rows(shape, 3, 200)
    target = shape.output(weights, inputs)
    found = [
        levenberg_marquardt(shape, _rows(shape, seed)[0], inputs, target, epochs=300, goal=0.0, decay=0.0)
        for seed in range(4)
    ]
    assert min(run.mean_square for run in found) < 1e-12


def test_gradient_descent_keeps_the_best_and_stops_at_its_goal() -> None:
    shape = Shape(2, 4, "sigmoid")
    start, inputs, target = _rows(shape)
    run = descend(shape, start, inputs, target, rate=0.1, epochs=500, goal=0.9, decay=0.0)
    assert run.converged and run.epochs < 500 and run.mean_square <= 0.9
    wild = descend(shape, start, inputs, target, rate=1e3, epochs=500, goal=0.0, decay=0.0)
    assert np.isfinite(wild.weights).all() and not wild.converged
    assert wild.mean_square <= shape.gradient(start, inputs, target)[0]


@pytest.mark.parametrize(("hidden", "largest", "std"), [(10, 0.053, 0.014), (20, 0.0036, 0.0008)])
def test_surface_a_is_fitted_as_well_as_the_notes_have_it(
    hidden: int, largest: float, std: float, campaign: Callable[..., Any]
) -> None:
    """Fitting notes, section 2: one hidden layer by Levenberg-Marquardt; medians of three seeds here."""
    found = []
    for seed in range(3):
        data = campaign(seed)
        rows, held = data.split(seed, 470)
        model = BackPropagationNetwork(
            hidden, "levenberg_marquardt", activation="tanh", linear_path=True, random_state=seed
        ).fit(data.inputs[rows], data.reference[rows])
        error = model.predict(data.inputs[held]) - data.reference[held]
        found.append((np.abs(error).max(), error.std()))
    assert tuple(np.median(found, axis=0)) < (largest, std)
    assert np.median(found, axis=0)[1] < std


@pytest.mark.parametrize("mode", MODES)
def test_same_seed_same_model(mode: str) -> None:
    _, inputs, target = _rows(Shape(2, 4, "tanh"))
    first, second = (clone(MODES[mode]).set_params(random_state=3).fit(inputs, target) for _ in range(2))
    assert np.array_equal(first.predict(inputs), second.predict(inputs))
    other = clone(MODES[mode]).set_params(random_state=4).fit(inputs, target)
    assert not np.array_equal(first.predict(inputs), other.predict(inputs))


def test_more_starts_are_never_worse_in_training() -> None:
    _, inputs, target = _rows(Shape(2, 4, "tanh"))
    losses = [BackPropagationNetwork(4, epochs=100, n_starts=n).fit(inputs, target).loss_ for n in (1, 3, 6)]
    assert losses[0] >= losses[1] >= losses[2]


def test_weight_decay_keeps_weights_small() -> None:
    _, inputs, target = _rows(Shape(2, 4, "tanh"))
    sizes = [
        np.abs(MODES["second order"].set_params(weight_decay=decay).fit(inputs, target).model_.weights).max()
        for decay in (0.0, 1.0)
    ]
    assert sizes[1] < sizes[0]
    MODES["second order"].set_params(weight_decay=0.0)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "case", ["constant column", "duplicate rows", "few rows", "two rows", "constant target", "nothing"]
)
def test_data_that_are_not_nice(mode: str, case: str) -> None:
    rng = np.random.default_rng(5)
    inputs = rng.normal([20.0, 0.0], [30.0, 100.0], (40, 2))
    if case in ("constant column", "nothing"):
        inputs[:, 0] = 25.0
    if case == "nothing":
        inputs[:, 1] = 0.0
    if case == "duplicate rows":
        inputs = np.repeat(inputs[:5], 8, axis=0)
    inputs = inputs[: {"few rows": 7, "two rows": 2}.get(case, 40)]
    target = np.full(len(inputs), 3.0) if case in ("constant target", "nothing") else 0.9 * inputs[:, 1] + 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = clone(MODES[mode]).fit(inputs, target)
    tolerance = (60.0 if target.std() > 0.0 else 0.2) if mode == "gradient" else 0.1
    assert model.predict(inputs) == pytest.approx(target, abs=tolerance)


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 20), st.integers(1, 3), st.integers(0, 10**6), st.sampled_from(sorted(MODES)))
def test_any_small_data_give_a_finite_model(n: int, n_inputs: int, seed: int, mode: str) -> None:
    rng = np.random.default_rng(seed)
    inputs = rng.choice([-1.0, 0.0, 1.0, 50.0], (n, n_inputs)) * 10.0 ** rng.integers(-6, 7)
    model = clone(MODES[mode]).set_params(epochs=10).fit(inputs, rng.normal(size=n))
    assert np.isfinite(model.predict(inputs)).all()


@pytest.mark.parametrize(
    "bad",
    [
        {"hidden": 0},
        {"training": "adam"},
        {"epochs": 0},
        {"learning_rate": float("nan")},
        {"goal": -1.0},
        {"n_starts": 1.5},
        {"activation": "relu"},
        {"weight_decay": -1.0},
    ],
)
def test_a_bad_parameter_is_named_with_what_is_allowed(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(bad))}.*allowed"):
        BackPropagationNetwork(**bad).fit(np.arange(20.0).reshape(10, 2), np.arange(10.0))


@pytest.mark.parametrize("activation", ["sigmoid", "tanh"])
def test_values_that_are_not_finite_are_refused(activation: Activation) -> None:
    with pytest.raises(ValueError, match="NaN"):
        BackPropagationNetwork(activation=activation).fit([[1.0], [np.nan], [2.0]], [1.0, 2.0, 3.0])
