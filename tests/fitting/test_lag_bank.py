"""Ridge and lag bank: against closed forms and explicit leave-out, on data that are not nice, and on the twins."""

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.linear_model import Ridge
from sklearn.utils.estimator_checks import check_estimator

from fitting.lag_bank import LagBankCompensation, blocks, summary
from fitting.lag_bank_history import History
from fitting.lag_bank_ridge import INFLATION, choose, solve
from tests.fitting import twins

Array = NDArray[np.float64]


def _problem(seed: int = 0, rows: int = 80) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    design = rng.standard_normal((rows, 5)) @ rng.standard_normal((5, 5)) + 3.0
    return design, design @ [1.0, 0.5, 0.0, 0.0, -1.0] + 0.5 * rng.standard_normal(rows) + 7.0


def test_is_a_scikit_learn_estimator() -> None:
    check_estimator(LagBankCompensation(), on_skip=None)


def test_score_is_generalised_cross_validation_of_the_hat_matrix() -> None:
    design, target = _problem()
    columns = np.array([0, 2, 4])
    choice = choose(design, target, [columns], np.array([0.01]))
    chosen = np.column_stack([np.ones(80), design[:, columns] - design[:, columns].mean(axis=0)])
    hat = chosen @ np.linalg.solve(chosen.T @ chosen + 0.8 * np.diag([0.0, 1.0, 1.0, 1.0]), chosen.T)
    residual = target - hat @ target
    assert choice.freedom == pytest.approx(np.trace(hat))
    assert choice.score == pytest.approx(residual @ residual / 80 / (1 - INFLATION * np.trace(hat) / 80) ** 2)


def test_grouped_score_is_that_of_models_fitted_without_each_group() -> None:
    design, target = _problem(1)
    groups = np.arange(80) // 20
    choice = choose(design, target, [np.arange(5)], np.array([0.05]), groups)
    squares = 0.0
    for label in range(4):
        held = groups == label
        model = Ridge(alpha=0.05 * 80).fit(design[~held], target[~held])
        squares += float(np.sum((model.predict(design[held]) - target[held]) ** 2))
    assert choice.score == pytest.approx(squares / 80)


def test_solution_is_that_of_scikit_learns_ridge() -> None:
    design, target = _problem(2)
    choice = choose(design, target, [np.arange(5)], np.array([0.1]))
    constant, solution = solve(design, target, choice)
    expected = Ridge(alpha=8.0).fit(design, target)
    assert solution.theta == pytest.approx(expected.coef_) and constant == pytest.approx(expected.intercept_)


def test_recovers_a_bias_it_can_express() -> None:
    """Nearly noise-free: quadratic in temperature, linear in the rest, and one product."""
    rng = np.random.default_rng(3)
    features = rng.uniform([-40.0, -1.0, -5.0], [60.0, 1.0, 5.0], (300, 3))
    t = features[:, 0]
    bias = 0.02 + 1e-3 * t + 2e-5 * t**2 + 0.1 * features[:, 1] + 2e-4 * t * features[:, 2]
    bias += 1e-6 * rng.standard_normal(300)
    model = LagBankCompensation().fit(features, bias)
    assert model.predict(features) == pytest.approx(bias, abs=1e-4)
    assert summary(model) == {
        "degree": 2,
        "cross": True,
        "ridge": model.ridge_,
        "effective_parameters": pytest.approx(7.0, abs=0.05),
        "has_effect": True,
    }


def test_without_effect_the_model_is_the_mean() -> None:
    """Issue: a record without temperature effect gets no temperature term; here in all of 100 records."""
    features = History().features(twins.bp(0).temperatures_degc, 100.0)
    wrong = 0
    for seed in range(100):
        noise = np.random.default_rng(seed).standard_normal(len(features)) + 5.0
        model = LagBankCompensation().fit(features, noise)
        wrong += model.has_effect_
        if not model.has_effect_:
            assert model.predict(features) == pytest.approx(np.full(len(features), noise.mean()))
            assert len(model.coefficients_) == 0 and model.inside(features).all()
    assert wrong <= 1


def test_uncertainties_are_those_of_least_squares_where_no_ridge_is_asked_for() -> None:
    design, target = _problem(4)
    model = LagBankCompensation(degree=1, cross=False, ridge=0.0).fit(design, target)
    full = np.column_stack([np.ones(80), model.terms_.design(design)])
    residual = target - full @ np.linalg.lstsq(full, target)[0]
    covariance = residual @ residual / (80 - 6) * np.linalg.inv(full.T @ full)
    assert model.coefficients_u_ == pytest.approx(np.sqrt(covariance.diagonal()[1:]), rel=1e-6)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bp_other_cycle_is_within_a_fifth_of_the_white_floor(seed: int) -> None:
    first, other = twins.bp(seed), twins.bp(seed, 1)
    features = [History().features(cycle.temperatures_degc, 100.0) for cycle in (first, other)]
    model = LagBankCompensation().fit(features[0], first.bias_dph)
    left = other.bias_dph - model.predict(features[1])
    assert other.bias_dph.std() > 7.0 * other.floor_dph
    assert left.std() < 1.2 * other.floor_dph
    assert model.inside(features[1]).all()


def _rlg_left(seed: int, test: twins.Cycle, rows: slice = slice(None), **settings: Any) -> tuple[float, float]:
    """What is left of the test cycle, in floors, and the guarded share; trained on the rows of cycle 0."""
    first = twins.rlg(seed)
    features, tested = (History().features(cycle.temperatures_degc, 100.0) for cycle in (first, test))
    model = LagBankCompensation(**settings).fit(features[rows], first.bias_dph[rows])
    judged = slice(rows.stop, None)
    left = test.bias_dph[judged] - model.predict(tested[judged])
    return float(left.std() / test.floor_dph), float(1.0 - model.inside(tested[judged]).mean())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rlg_second_cycle_and_other_profile(seed: int) -> None:
    """Issue: 1.05 and 1.2 floors; the std of 336 rows of noise alone is uncertain by 4 %."""
    second, profile = (_rlg_left(seed, test) for test in (twins.rlg(seed, 1), twins.rlg(seed, 2, "steps")))
    assert second[0] < 1.09 and profile[0] < 1.1
    assert second[1] < 0.01 and profile[1] < 0.05


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rlg_trained_on_cooling_is_guarded_on_warming(seed: int) -> None:
    """Issue: 2.3 floors; without the guard products of temperature and slope are many floors off."""
    left, guarded = _rlg_left(seed, twins.rlg(seed), slice(0, 168))
    assert left < 2.4 and 0.4 < guarded < 0.95
    assert _rlg_left(seed, twins.rlg(seed), slice(0, 168), degree=3, cross=True)[0] < 2.4


def test_outside_the_training_range_the_fallback_is_linear() -> None:
    rng = np.random.default_rng(5)
    features = rng.uniform(-1.0, 1.0, (200, 2))
    model = LagBankCompensation(degree=4).fit(features, features[:, 0] + features[:, 0] ** 4 + features[:, 1])
    line = np.array([[3.0, 0.0], [4.0, 0.0], [5.0, 0.0]])
    assert not model.inside(line).any()
    steps = np.diff(model.predict(line))
    assert steps[0] == pytest.approx(steps[1]) and steps[0] == pytest.approx(1.0, abs=0.15)


def test_a_combination_that_never_occurred_is_outside_though_each_feature_is_inside() -> None:
    rng = np.random.default_rng(6)
    t = rng.uniform(-1.0, 1.0, 200)
    features = np.column_stack([t, t + 0.01 * rng.standard_normal(200)])
    model = LagBankCompensation().fit(features, t**3 + 0.01 * rng.standard_normal(200))
    assert model.inside(features).all()
    assert not model.inside([[0.8, -0.8]])[0]


@pytest.mark.parametrize(
    "case", ["constant temperature", "constant feature", "duplicate rows", "few rows", "two rows", "constant target"]
)
def test_data_that_are_not_nice(case: str) -> None:
    rng = np.random.default_rng(7)
    features = rng.normal([20.0, 0.0, 0.0], [30.0, 1.0, 5.0], (60, 3))
    if case.startswith("constant t"):
        features[:, 0] = 25.0
    if case == "constant feature":
        features[:, 1] = 0.0
    if case == "duplicate rows":
        features = np.repeat(features[:6], 10, axis=0)
    features = features[: {"few rows": 5, "two rows": 2}.get(case, 60)]
    target = np.full(len(features), 3.0) if case == "constant target" else features @ [0.01, 0.5, 0.1] + 2.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = LagBankCompensation().fit(features, target)
    assert np.isfinite(model.predict(features)).all()
    if len(features) == 60:
        assert model.predict(features) == pytest.approx(target, abs=1e-3)


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 30), st.integers(1, 4), st.integers(0, 10**6))
def test_any_small_data_give_a_finite_model(n: int, n_features: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    features = rng.choice([-1.0, 0.0, 1.0, 50.0], (n, n_features)) * 10.0 ** rng.integers(-6, 7)
    model = LagBankCompensation().fit(features, rng.normal(size=n))
    assert np.isfinite(model.predict(features)).all() and np.isfinite(model.predict(3.0 * features)).all()


def test_groups_choose_by_what_is_left_out() -> None:
    features, bias = _problem(8)
    model = LagBankCompensation().fit(features, bias, groups=blocks(80, 4))
    assert np.unique(blocks(80, 4), return_counts=True)[1].tolist() == [20] * 4
    assert model.has_effect_ and model.predict(features).std() > 0.5
    with pytest.raises(ValueError, match="one label"):
        LagBankCompensation().fit(features, bias, groups=np.zeros(80))
    with pytest.raises(ValueError, match="shape"):
        LagBankCompensation().fit(features, bias, groups=np.zeros(7))


@pytest.mark.parametrize(
    "bad",
    [{"degree": -1}, {"degree": "high"}, {"cross": "maybe"}, {"ridge": -1.0}, {"max_degree": 0}, {"margin": -0.1}],
)
def test_a_bad_parameter_is_named_with_what_is_allowed(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(bad))}.*allowed"):
        LagBankCompensation(**bad).fit(np.arange(20.0).reshape(10, 2), np.arange(10.0))


def test_values_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="NaN"):
        LagBankCompensation().fit([[1.0], [np.nan], [2.0]], [1.0, 2.0, 3.0])
