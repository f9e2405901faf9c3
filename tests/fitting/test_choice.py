"""The choice between models: what is left out, what is given up, and what the simplest good one is."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.automatic import AutomaticCompensation
from fitting.choice import Candidate, choose, groups_of, without_columns
from fitting.linear import LinearCompensation
from fitting.modelfile import load_model, save_model
from fitting.polynomial import PolynomialCompensation


def powers(degrees: Any) -> list[Candidate]:
    return [Candidate(f"degree {degree}", PolynomialCompensation(degree)) for degree in degrees]


def curve(noise: float, n: int = 120) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    inputs = rng.uniform(-1.0, 1.0, (n, 2))
    return inputs, inputs[:, 0] ** 2 + inputs[:, 1] + noise * rng.standard_normal(n)


def test_the_smallest_sufficient_degree_is_kept() -> None:
    choice = choose([powers([1, 2, 3, 4])], *curve(0.1))
    assert choice.chosen.candidate.name == "degree 2"
    assert choice.chosen.n_parameters == 6
    assert [row["name"] for row in choice.table() if row["chosen"]] == ["degree 2"]
    assert choice.estimator.degree == 2 and not hasattr(choice.estimator, "model_")


def test_a_family_ends_where_its_next_member_gains_nothing() -> None:
    scores = choose([powers([2, 3, 4, 5, 6])], *curve(0.1)).scores
    assert [score.candidate.name for score in scores] == ["degree 2", "degree 3"]


def test_the_hopeless_are_given_up_and_never_chosen() -> None:
    choice = choose([powers([2]), powers([0])], *curve(0.01))
    given_up = choice.scores[1]
    assert not given_up.complete and np.isnan(given_up.squares).any() and np.isnan(given_up.excess_se)
    assert choice.chosen.candidate.name == "degree 2"


def test_scores_are_errors_of_groups_left_out() -> None:
    inputs, target = curve(0.1, 60)
    groups = np.arange(60) % 5
    score = choose([powers([2])], inputs, target, groups, folds=5).chosen
    for group in range(5):
        out = groups == group
        error = PolynomialCompensation(2).fit(inputs[~out], target[~out]).predict(inputs[out]) - target[out]
        assert score.squares[group] == pytest.approx(np.mean(error**2))
    assert score.rms == pytest.approx(np.sqrt(score.squares.mean()))


def test_a_model_much_worse_than_the_best_is_not_kept_however_uncertain_the_difference() -> None:
    inputs, target = curve(0.01, 80)
    inputs[0], target[0] = [0.0, 0.0], 0.5  # one row that both miss
    choice = choose([powers([2]), powers([1])], inputs, target, np.arange(80) % 8)
    assert choice.chosen.candidate.name == "degree 2"


def test_too_few_rows_keep_the_first() -> None:
    choice = choose([powers([1, 2])], np.arange(6.0).reshape(3, 2), np.arange(3.0))
    assert choice.chosen.candidate.name == "degree 1"


def test_dwells_are_seen_by_their_gaps() -> None:
    rng = np.random.default_rng(1)
    dwell = rng.permutation(np.repeat(np.arange(19), 36))
    temperature = -30.0 + 5.0 * dwell + 0.05 * rng.standard_normal(len(dwell))
    assert np.array_equal(groups_of(temperature), dwell)


@given(st.lists(st.floats(-60.0, 60.0), min_size=2, max_size=60))
def test_groups_ascend_with_the_input_and_none_is_empty(values: list[float]) -> None:
    first = np.array(values)
    groups = groups_of(first)[np.argsort(first, kind="stable")]
    assert groups[0] == 0 and set(np.diff(groups)) <= {0, 1}
    assert groups[-1] >= 1


def test_columns_left_out_are_constant_and_the_rest_untouched() -> None:
    inputs = np.random.default_rng(2).normal(size=(20, 3))
    held = without_columns(inputs, (0, 2))
    assert np.ptp(held[:, [0, 2]], axis=0).tolist() == [0.0, 0.0]
    assert np.array_equal(held[:, 1], inputs[:, 1])


def record(effect: float, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Twelve rates at each of 13 temperatures; effect: of 10 degC on the scale factor."""
    rng = np.random.default_rng(seed)
    temperature, rate = np.repeat(np.arange(-30.0, 31.0, 5.0), 12), np.tile(np.linspace(-180.0, 180.0, 12), 13)
    gain = 1.02 + effect * temperature / 10.0
    output = gain * np.sin(0.0013 * rate) / 0.0013 + 0.4 + 0.003 * rng.standard_normal(len(rate))
    return np.column_stack([temperature + 0.02 * rng.standard_normal(len(rate)), output]), rate


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_record_without_temperature_effect_gets_no_temperature_term(seed: int, tmp_path: Any) -> None:
    inputs, rate = record(0.0, seed)
    model = AutomaticCompensation().fit(inputs, rate)
    assert model.without_ == (0,) and model.chosen_.endswith("without temperature")
    hot = inputs + np.array([40.0, 0.0])
    assert np.array_equal(model.predict(hot), model.predict(inputs))
    save_model(tmp_path / "m.json", model, {})
    loaded = load_model(tmp_path / "m.json")
    assert np.array_equal(loaded.predict(*hot.T), model.predict(hot))
    assert loaded.inside(*inputs.T).all() and not loaded.inside(90.0, 0.0)


def test_a_record_with_a_temperature_effect_keeps_it() -> None:
    inputs, rate = record(1e-3, 0)
    model = AutomaticCompensation().fit(inputs, rate)
    assert model.without_ == ()
    assert (model.predict(inputs) - rate).std() < 0.005


def test_a_bias_run_without_any_effect_gets_a_constant() -> None:
    rng = np.random.default_rng(3)
    temperatures = rng.uniform(-30.0, 25.0, (150, 1)) + 0.3 * rng.standard_normal((150, 3))
    model = AutomaticCompensation(rate=False).fit(temperatures, 0.4 + 0.01 * rng.standard_normal(150))
    assert model.without_ == (0, 1, 2)
    assert np.ptp(model.predict(temperatures)) == 0.0


def test_it_chooses_as_well_as_the_rules_alone_on_surface_a(campaign: Callable[..., Any]) -> None:
    data = campaign(2, dwell_errors=True)
    model = AutomaticCompensation().fit(data.inputs, data.reference, groups=data.dwell)
    assert "tied" in model.chosen_ and model.best_estimator_.n_rules_ in (4, 6)
    assert {row["name"] for row in model.scores_} >= {"linear", "LS-SVM", "radial basis spline"}
    assert model.training_.rows == 684


def test_candidates_of_ones_own_are_tried_with_and_without_temperature() -> None:
    inputs, rate = record(1e-3, 1)
    pair = [("line", LinearCompensation()), ("cubic", PolynomialCompensation(3))]
    model = AutomaticCompensation(candidates=pair).fit(inputs, rate)
    assert [row["name"] for row in model.scores_] == [
        "line", "cubic", "line, without temperature", "cubic, without temperature",
    ]  # fmt: skip
    assert model.chosen_ == "cubic"


@pytest.mark.parametrize(("parameters", "name"), [({"folds": 1}, "folds is 1"), ({"candidates": []}, "candidates is")])
def test_a_bad_parameter_is_named_with_what_is_allowed(parameters: Any, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}.*allowed"):
        AutomaticCompensation(**parameters).fit(*record(0.0, 0))
