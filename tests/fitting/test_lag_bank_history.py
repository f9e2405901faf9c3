"""Features of the past: against closed forms, a numerical integration, and themselves in pieces."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from sklearn.utils.estimator_checks import check_estimator

from fitting.lag_bank_history import History, HistoryStream, ThermalHistory

# A row depends on the rows before it: that is what the history is for.
ORDERED = dict.fromkeys(
    ("check_methods_sample_order_invariance", "check_methods_subset_invariance"), "rows are in the order of time"
)


def test_is_a_scikit_learn_transformer() -> None:
    check_estimator(ThermalHistory(), on_skip=None, expected_failed_checks=ORDERED)


def test_lags_are_those_of_the_differential_equation() -> None:
    """tau dy/dt = T - y for a temperature that is straight between samples, integrated to 1e-10."""
    rng = np.random.default_rng(0)
    temperature, period, tau = np.cumsum(rng.standard_normal(30)), 100.0, 230.0
    times = period * np.arange(30)
    flow = solve_ivp(
        lambda t, y: (np.interp(t, times, temperature) - y) / tau,
        (0.0, times[-1]),
        [temperature[0]],
        t_eval=times,
        max_step=period / 4.0,
        rtol=1e-10,
        atol=1e-10,
    )
    features = History((tau,), start="steady").features(temperature[:, np.newaxis], period)
    assert features[:, -1] == pytest.approx(temperature - flow.y[0], abs=1e-7)


def test_after_a_long_ramp_a_low_pass_lags_by_slope_times_time_constant() -> None:
    ramp = (20.0 + 0.4 / 60.0 * 100.0 * np.arange(60))[:, np.newaxis]
    features = History().features(ramp, 100.0)
    assert features[:, 1] == pytest.approx(np.full(60, 0.4))
    for column, tau in zip(features[:, 2:].T, (200.0, 500.0, 1000.0, 2000.0), strict=True):
        assert column == pytest.approx(np.full(60, 0.4 / 60.0 * tau), rel=1e-9)


def test_a_record_that_begins_steady_has_no_history_either_way() -> None:
    temperature = np.concatenate([np.full(10, 25.0), 25.0 + np.arange(20.0)])[:, np.newaxis]
    steady = History(start="steady").features(temperature, 100.0)
    assert np.array_equal(steady, History(start="ramp").features(temperature, 100.0))
    assert steady[:10, 1:] == pytest.approx(np.zeros((10, 5)), abs=1e-12)


def test_steady_start_does_not_believe_the_first_slope() -> None:
    ramp = np.arange(5.0)[:, np.newaxis]
    features = History((200.0,), start="steady").features(ramp, 100.0)
    assert features[0].tolist() == [0.0, 0.0, 0.0]
    assert features[1, 1] == pytest.approx(0.6)


def test_several_sensors_give_their_mean_and_differences() -> None:
    temperatures = np.array([[1.0, 2.0, 6.0], [2.0, 4.0, 9.0]])
    features = History(()).features(temperatures, 60.0)
    assert features == pytest.approx(np.array([[3.0, 1.0, 4.0, 2.0], [5.0, 2.0, 5.0, 2.0]]))
    names = ThermalHistory(time_constants_s=()).fit(temperatures).get_feature_names_out().tolist()
    assert names == [
        "temperature_degc",
        "temperature_1_minus_0_degc",
        "temperature_2_minus_1_degc",
        "slope_degc_min",
    ]


def test_features_are_causal() -> None:
    rng = np.random.default_rng(1)
    temperature = np.cumsum(rng.standard_normal((50, 2)), axis=0)
    changed = temperature.copy()
    changed[30:] += 5.0
    first, second = (History().features(values, 100.0) for values in (temperature, changed))
    assert np.array_equal(first[:30], second[:30]) and not np.allclose(first[30:], second[30:])


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 40),
    st.lists(st.integers(0, 12), max_size=8),
    st.sampled_from(["steady", "ramp"]),
    st.sampled_from([10.0, 100.0]),
)
def test_a_stream_in_pieces_gives_the_same_numbers(n: int, pieces: list[int], start: str, period: float) -> None:
    temperature = np.cumsum(np.random.default_rng(n).standard_normal((n, 2)), axis=0)
    history = History(start=start)  # type: ignore[arg-type]
    stream, edges = HistoryStream(history, period), np.minimum(np.cumsum([0, *pieces, n]), n)
    parts = [stream.feed(temperature[a:b]) for a, b in pairwise(edges)]
    assert np.array_equal(np.vstack([*parts, stream.finish()]), history.features(temperature, period))
    assert sum(map(len, parts)) <= n


def test_a_stream_answers_each_row_at_once_after_the_first_slope() -> None:
    stream = HistoryStream(History(slope_over_s=100.0), 20.0)
    answered = [len(stream.feed(np.array([[float(k)]]))) for k in range(9)]
    assert answered == [0, 0, 0, 0, 0, 6, 1, 1, 1]


def test_a_finer_period_gives_the_same_lags() -> None:
    """The temperature is straight between the coarse samples, so both are exact."""
    coarse = np.cumsum(np.random.default_rng(2).standard_normal(40))
    fine = np.interp(np.arange(0.0, 3901.0, 10.0), 100.0 * np.arange(40), coarse)
    one = History(start="steady").features(coarse[:, np.newaxis], 100.0)
    ten = History(start="steady").features(fine[:, np.newaxis], 10.0)
    assert ten[::10] == pytest.approx(one, abs=1e-9)


def test_the_history_begins_anew_where_the_record_number_changes() -> None:
    temperature = np.cumsum(np.random.default_rng(3).standard_normal(30))
    stacked = np.column_stack([np.tile(temperature, 2), np.repeat([7.0, 3.0], 30)])
    features = ThermalHistory(record_column=1).fit_transform(stacked)
    assert np.array_equal(features[:30], features[30:])
    assert np.array_equal(features[:30], ThermalHistory().fit_transform(temperature[:, np.newaxis]))


@pytest.mark.parametrize(
    ("bad", "word"),
    [
        ({"period_s": 0.0}, "period_s"),
        ({"period_s": float("nan")}, "period_s"),
        ({"time_constants_s": (100.0, -1.0)}, "time_constants_s"),
        ({"slope_over_s": float("inf")}, "slope_over_s"),
        ({"start": "cold"}, "start"),
        ({"record_column": 2}, "record_column"),
        ({"record_column": -1}, "record_column"),
    ],
)
def test_a_bad_parameter_is_named(bad: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        ThermalHistory(**bad).fit(np.zeros((5, 2)))  # type: ignore[arg-type]


def test_values_that_are_not_finite_are_refused() -> None:
    values: NDArray[np.float64] = np.ones((5, 1))
    values[2] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        ThermalHistory().fit(values)
