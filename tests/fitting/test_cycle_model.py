"""Temperatures in, bias out: records, streams, other regressors."""

from typing import Any

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import check_estimator

from fitting.cycle_model import ThermalCycleCompensation, lag_bank
from fitting.lag_bank import LagBankCompensation
from fitting.lag_bank_history import ThermalHistory
from tests.fitting import twins

ORDERED = dict.fromkeys(
    ("check_methods_sample_order_invariance", "check_methods_subset_invariance"), "rows are in the order of time"
)


def test_is_a_scikit_learn_estimator() -> None:
    check_estimator(lag_bank(), on_skip=None, expected_failed_checks=ORDERED)


def test_is_the_pipeline_of_history_and_lag_bank() -> None:
    cycle, other = twins.rlg(1), twins.rlg(1, 1)
    model = lag_bank().fit(cycle.temperatures_degc, cycle.bias_dph)
    pipeline = make_pipeline(ThermalHistory(), LagBankCompensation()).fit(cycle.temperatures_degc, cycle.bias_dph)
    assert np.array_equal(model.predict(other.temperatures_degc), pipeline.predict(other.temperatures_degc))
    assert model.inside(other.temperatures_degc).mean() > 0.99


def test_two_records_are_told_apart_and_can_be_left_out_in_turn() -> None:
    cycles = [twins.bp(2, k) for k in range(3)]
    numbered = [
        np.column_stack([c.temperatures_degc, np.full(len(c.bias_dph), float(k))]) for k, c in enumerate(cycles)
    ]
    inputs, bias = np.vstack(numbered[:2]), np.concatenate([c.bias_dph for c in cycles[:2]])
    model = ThermalCycleCompensation(record_column=1).fit(inputs, bias, groups=inputs[:, 1])
    left = cycles[2].bias_dph - model.predict(numbered[2])
    assert left.std() < 1.15 * cycles[2].floor_dph
    alone = ThermalCycleCompensation().fit(cycles[0].temperatures_degc, cycles[0].bias_dph)
    assert np.array_equal(model.model_.history.features(inputs)[:498], alone.model_.history.features(inputs[:498, :1]))


def test_a_stream_gives_what_the_whole_record_gives() -> None:
    cycle = twins.bp(3)
    model = lag_bank().fit(cycle.temperatures_degc, cycle.bias_dph)
    stream = model.stream()
    parts = [stream.feed(cycle.temperatures_degc[k : k + 1]) for k in range(len(cycle.bias_dph))]
    assert np.concatenate([*parts, stream.finish()]) == pytest.approx(model.predict(cycle.temperatures_degc), abs=1e-12)


def test_a_model_of_100_s_rows_serves_a_faster_stream() -> None:
    """Reference experiment `rlg`: the model is applied to the unsmoothed output."""
    cycle = twins.rlg(0)
    model = lag_bank().fit(cycle.temperatures_degc, cycle.bias_dph)
    coarse_s = 50.0 + 100.0 * np.arange(len(cycle.bias_dph))
    fine_s = np.arange(coarse_s[0], coarse_s[-1] + 1.0, 5.0)
    fine = np.column_stack([np.interp(fine_s, coarse_s, column) for column in cycle.temperatures_degc.T])
    stream = model.stream(5.0)
    bias = np.concatenate([stream.feed(fine), stream.finish()])
    assert bias[::20] == pytest.approx(model.predict(cycle.temperatures_degc), abs=0.2 * cycle.floor_dph)


def test_any_regressor_will_do() -> None:
    cycle = twins.bp(0)
    model = ThermalCycleCompensation(LinearRegression()).fit(cycle.temperatures_degc, cycle.bias_dph)
    features = ThermalHistory().fit_transform(cycle.temperatures_degc)
    expected = LinearRegression().fit(features, cycle.bias_dph).predict(features)
    assert model.predict(cycle.temperatures_degc) == pytest.approx(expected)
    assert model.inside(cycle.temperatures_degc).all()
    assert model.training_.std_residual == pytest.approx(float((expected - cycle.bias_dph).std()))


@pytest.mark.parametrize(("rows", "columns"), [(2, 1), (3, 2), (12, 3)])
def test_few_rows_and_constant_columns(rows: int, columns: int) -> None:
    temperatures = np.full((rows, columns), 25.0)
    temperatures[:, -1] += np.arange(rows) if columns == 1 else 0.0
    model: Any = lag_bank().fit(temperatures, np.arange(float(rows)))
    assert np.isfinite(model.predict(temperatures)).all()


def test_values_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="NaN"):
        lag_bank().fit([[1.0], [np.nan], [2.0]], [1.0, 2.0, 3.0])
