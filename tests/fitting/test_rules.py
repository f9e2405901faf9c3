"""Rule models against a loop written from the equations of the paper."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.rules import Antecedents, RuleModel
from fitting.scaling import Scaling


def random_model(seed: int, n_rules: int = 4, n_inputs: int = 2) -> RuleModel:
    rng = np.random.default_rng(seed)
    antecedents = Antecedents(rng.normal(size=(n_rules, n_inputs)), rng.uniform(0.3, 2.0, (n_rules, n_inputs)))
    return RuleModel(antecedents, rng.normal(size=(n_rules, n_inputs + 1)), np.arange(n_inputs))


def by_hand(model: RuleModel, x: np.ndarray) -> float:
    strengths, locals_ = [], []
    for v, sigma, a in zip(model.antecedents.centres, model.antecedents.widths, model.consequents, strict=True):
        memberships = [math.exp(-0.5 * (x[k] - v[k]) ** 2 / sigma[k] ** 2) for k in range(len(v))]
        strengths.append(math.prod(memberships))
        locals_.append(a[0] + sum(a[k + 1] * x[k] for k in range(len(v))))
    return float(sum(w * g for w, g in zip(strengths, locals_, strict=True)) / sum(strengths))


@pytest.mark.parametrize("n_inputs", [1, 2, 3])
def test_prediction_is_the_papers_formula(n_inputs: int) -> None:
    model = random_model(1, n_rules=5, n_inputs=n_inputs)
    inputs = np.random.default_rng(2).normal(size=(20, n_inputs))
    assert model.predict(inputs) == pytest.approx([by_hand(model, x) for x in inputs], rel=1e-12)


def test_regressors_times_consequents_is_the_prediction() -> None:
    model = random_model(3)
    inputs = np.random.default_rng(4).normal(size=(50, 2))
    product = model.antecedents.regressors(inputs) @ model.consequents.ravel()
    assert product == pytest.approx(model.predict(inputs), rel=1e-12)


@given(st.lists(st.floats(-1e30, 1e30), min_size=2, max_size=2))
def test_strengths_sum_to_one_however_far_away(x: list[float]) -> None:
    firing = random_model(5).antecedents.firing(np.array([x]))
    assert np.isfinite(firing).all()
    assert firing.sum() == pytest.approx(1.0)


@settings(max_examples=20)
@given(st.integers(0, 9000), st.integers(1, 50))
def test_a_row_does_not_depend_on_its_batch(first: int, count: int) -> None:
    model = random_model(6)
    inputs = np.random.default_rng(7).normal(size=(9050, 2))
    assert np.array_equal(model.predict(inputs)[first : first + count], model.predict(inputs[first : first + count]))


def test_only_the_columns_used_matter() -> None:
    model = random_model(8, n_inputs=1)
    wider = RuleModel(model.antecedents, model.consequents, np.array([1]))
    x = np.linspace(-1.0, 1.0, 5)
    assert np.array_equal(wider.predict(np.column_stack([x * 7.0, x])), model.predict(x[:, np.newaxis]))


def test_rules_are_ordered_by_first_then_second_input() -> None:
    antecedents = Antecedents(np.array([[1.0, 0.0], [0.0, 2.0], [0.0, 1.0]]), np.array([[1.0, 1], [2, 2], [3, 3]]))
    ordered = antecedents.ordered()
    assert ordered.centres.tolist() == [[0.0, 1.0], [0.0, 2.0], [1.0, 0.0]]
    assert ordered.widths[:, 0].tolist() == [3.0, 2.0, 1.0]


def test_scaling_back_to_units_keeps_the_firing_strengths() -> None:
    values = np.random.default_rng(9).normal([20.0, -5.0], [30.0, 100.0], (60, 2))
    scaling = Scaling.of(values)
    antecedents = random_model(10).antecedents
    in_units = antecedents.in_units_of(scaling)
    assert np.allclose(in_units.firing(values), antecedents.firing(scaling.apply(values)), atol=1e-12)
