"""Models are judged on rows they have never seen, and the figures are those of the definitions."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from fitting.linear import LinearCompensation
from fitting.splits import SplitPlan
from fitting.takagi_sugeno import TakagiSugeno, joint
from fitting.validation import Evaluation, ValidationError, evaluate


class Memory:
    """Knows the rows it has been fitted to and nothing else: predicts 1 for those and 0 for others."""

    def fit(self, X: NDArray[np.float64], y: NDArray[np.float64]) -> "Memory":
        self.known = {row.tobytes() for row in X}
        return self

    def predict(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([float(row.tobytes() in self.known) for row in X])


def rows(n: int = 60, dwells: int = 12) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    rng = np.random.default_rng(0)
    dwell = np.arange(n) % dwells
    rate = rng.uniform(-180.0, 180.0, n)
    inputs = np.column_stack([5.0 * dwell + 0.01 * rng.normal(size=n), 1.02 * rate + 0.1 * dwell])
    return inputs, rate, dwell


def judge(models: Any, plan: SplitPlan | None = None, **more: Any) -> Evaluation:
    inputs, rate, dwell = rows()
    return evaluate(models, inputs, rate, np.full(60, 0.003), dwell, plan or SplitPlan(), **more)


def test_no_row_is_judged_by_a_model_that_has_seen_it() -> None:
    result = judge({"memory": Memory}).residuals
    predicted = result[result.model == "memory"].groupby("split").predicted_dps
    assert predicted.max().to_dict() == {"leave_temperatures_out": 0.0, "random": 0.0, "random_train": 1.0}
    assert predicted.min()["random_train"] == 1.0


def test_no_dwell_is_judged_by_a_model_that_has_seen_any_of_it() -> None:
    inputs, rate, dwell = rows()
    inputs[:, 0], inputs[:, 1] = dwell, 0.0  # rows of one dwell look alike
    result = evaluate({"memory": Memory}, inputs, rate, np.zeros(60), dwell, SplitPlan()).residuals
    out = result[(result.model == "memory") & (result.split == "leave_temperatures_out")]
    assert (out.predicted_dps == 0.0).all()
    assert sorted(out.row) == list(range(60))


def test_metrics_are_their_definitions() -> None:
    inputs, rate, dwell = rows()
    u = np.linspace(0.001, 0.01, 60)
    plan = SplitPlan(train_count=40, seed=3)
    metrics = evaluate({"linear": LinearCompensation}, inputs, rate, u, dwell, plan).metrics
    held = ~plan.random_training_rows(60)
    error = LinearCompensation().fit(inputs[~held], rate[~held]).predict(inputs[held]) - rate[held]
    found = metrics["linear"]["random"]
    assert found["max_abs_dps"] == np.abs(error).max()
    assert found["std_dps"] == pytest.approx(error.std())
    assert found["floor_dps"] == pytest.approx(np.sqrt(np.mean(u[held] ** 2)))
    assert (found["n"], found["fit_s"]) == (20, None)
    assert metrics["linear"]["random_train"]["n"] == 40
    assert metrics["linear"]["leave_temperatures_out"]["n"] == 60
    whole = inputs[:, 1] - rate
    assert metrics["none"]["leave_temperatures_out"]["std_dps"] == pytest.approx(whole.std())
    assert metrics["none"]["random"]["max_abs_dps"] == np.abs(whole[held]).max()


def test_residual_is_compensated_minus_reference() -> None:
    _, rate, _ = rows()
    table = judge({"linear": LinearCompensation}).residuals
    assert table.columns.tolist() == ["row", "model", "split", "predicted_dps", "residual_dps"]
    assert np.allclose(table.residual_dps, table.predicted_dps - rate[table.row])
    assert len(table) == 2 * (60 + 60)


def test_the_timer_is_read_around_each_fit() -> None:
    readings = iter(range(1000))
    result = judge({"linear": LinearCompensation}, timer=lambda: float(next(readings)) * 0.5)
    assert result.metrics["linear"]["leave_temperatures_out"]["fit_s"] == 0.5
    assert result.metrics["linear"]["random"]["fit_s"] == 0.5
    assert result.metrics["none"]["random"]["fit_s"] is None
    assert result.fit_s == {"linear": 0.5}
    assert next(readings) == 2 * (1 + 6 + 1)


def test_the_seed_reaches_estimators_that_have_one_and_all_rows_are_fitted_at_the_end() -> None:
    small = TakagiSugeno(n_rules=2, n_starts=1, max_iter=3)
    result = judge({"linear": LinearCompensation, "ts": lambda: small.__class__(**small.get_params())}, seed=11)
    fitted: Any = result.fitted
    assert fitted["ts"].random_state == 11
    assert fitted["ts"].training_.rows == fitted["linear"].training_.rows == 60


def test_too_few_dwells_make_one_split_unavailable_with_a_reason() -> None:
    inputs, rate, _ = rows()
    result = evaluate({"linear": LinearCompensation}, inputs, rate, np.zeros(60), np.arange(60) % 3, SplitPlan())
    assert set(result.metrics["linear"]) == set(result.metrics["none"]) == {"random_train", "random"}
    assert result.unavailable.keys() == {"leave_temperatures_out"}
    assert "6 folds need as many temperatures, there are 3" in result.unavailable["leave_temperatures_out"]


def test_too_few_rows_leave_only_the_other_split() -> None:
    inputs, rate, dwell = rows()
    result = evaluate({}, inputs, rate, np.zeros(60), dwell, SplitPlan(train_count=60))
    assert result.unavailable.keys() == {"random_train", "random"}
    assert set(result.metrics["none"]) == {"leave_temperatures_out"}


def test_nothing_available_is_still_an_answer() -> None:
    result = evaluate({}, [[1.0, 2.0], [3.0, 4.0]], [2.0, 4.0], [0.1, 0.1], [0, 0], SplitPlan(train_count=2))
    assert result.metrics == {"none": {}} and len(result.unavailable) == 3
    assert len(result.residuals) == 0


@pytest.mark.parametrize("which", [0, 1, 2])
def test_values_that_are_not_finite_are_refused_by_row(which: int) -> None:
    inputs, rate, dwell = rows()
    u = np.zeros(60)
    (inputs, rate, u)[which][17] = np.nan
    with pytest.raises(ValidationError, match=rf"{'Xyu'[which]} is not finite in 1 row\(s\): 17. Drop or repeat"):
        evaluate({}, inputs, rate, u, dwell, SplitPlan())


def test_shapes_and_names_that_do_not_fit_are_refused() -> None:
    inputs, rate, dwell = rows()
    with pytest.raises(ValidationError, match=r"y has shape \(59,\)"):
        evaluate({}, inputs, rate[1:], np.zeros(60), dwell, SplitPlan())
    with pytest.raises(ValidationError, match="usable points"):
        evaluate({}, inputs[0], rate, np.zeros(60), dwell, SplitPlan())
    with pytest.raises(ValidationError, match="u is negative"):
        evaluate({}, inputs, rate, np.full(60, -1.0), dwell, SplitPlan())
    with pytest.raises(ValidationError, match=r"'none'.*rename"):
        judge({"none": LinearCompensation})


def test_a_model_that_fails_is_named() -> None:
    with pytest.raises(ValidationError, match=r"model 'broken' could not be fitted to 42 rows: .*n_rules is 0"):
        judge({"broken": lambda: TakagiSugeno(n_rules=0)})


def test_predictions_that_are_not_finite_are_an_error() -> None:
    class Blank(Memory):
        def predict(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.full(len(X), np.nan)

    with pytest.raises(ValidationError, match="'blank' did not give one finite prediction per row"):
        judge({"blank": Blank})


class Spline:
    """A thin-plate spline through every row: an honest method with room to memorise."""

    def fit(self, X: NDArray[np.float64], y: NDArray[np.float64]) -> "Spline":
        self.spline = RBFInterpolator(X / [27.0, 105.0], y, kernel="quintic")
        return self

    def predict(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.spline(X / [27.0, 105.0]))


def test_memorised_dwells_show_when_temperatures_are_left_out(campaign: Callable[..., Any]) -> None:
    """Fitting notes, section 5, 'random splits lie': what wins at random loses when temperatures are left out."""
    data = campaign(0, dwell_errors=True)
    u = np.full(len(data.reference), 2.8e-4)
    models: dict[str, Callable[[], Any]] = {"spline": Spline, "joint": joint}
    found = evaluate(models, data.inputs, data.reference, u, data.dwell, SplitPlan()).metrics
    std = {model: {split: float(one["std_dps"] or 0.0) for split, one in by.items()} for model, by in found.items()}
    assert std["spline"]["random"] < std["joint"]["random"]
    assert std["spline"]["leave_temperatures_out"] > std["joint"]["leave_temperatures_out"]
    assert std["spline"]["leave_temperatures_out"] > 3.0 * std["spline"]["random"]


def test_the_share_of_rows_outside_the_range_of_their_fit_is_in_every_score(campaign: Callable[..., Any]) -> None:
    """The coldest and the hottest dwell lie outside the range of the fits that do without them: 2 of 19."""
    data = campaign(0)
    found = evaluate(
        {"linear": LinearCompensation}, data.inputs, data.reference, np.zeros(684), data.dwell, SplitPlan()
    ).metrics
    assert found["linear"]["random_train"]["guarded"] == 0.0
    assert float(found["linear"]["leave_temperatures_out"]["guarded"] or 0.0) >= 2.0 / 19.0
    assert float(found["linear"]["random"]["guarded"] or 0.0) < 0.1
    assert found["none"]["random"]["guarded"] is None


def test_groups_reach_estimators_that_take_them() -> None:
    seen: list[NDArray[np.int64]] = []

    class Grouped(Memory):
        def fit(self, X: NDArray[np.float64], y: NDArray[np.float64], groups: Any = None) -> "Grouped":
            seen.append(groups)
            super().fit(X, y)
            return self

    judge({"grouped": Grouped}, SplitPlan(train_count=40))
    assert [len(groups) for groups in seen] == [40, *[50] * 6, 60]
    assert all(len(np.unique(groups)) == 10 for groups in seen[1:7])
