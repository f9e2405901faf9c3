"""Bias and its spreads, against numbers worked out by hand and simulated gyros."""

import json

import numpy as np
import pytest

from fitting.metrics.bias import (
    InputRate,
    ScaleFactor,
    bias,
    bias_repeatability,
    bias_stability,
    block_means,
    full_temperature_bias_stability,
)
from tests.fitting.random_errors import generators as g

UNIT = ScaleFactor(3600.0)  # output is then deg/h


def test_scale_factor_first_and_earth_rate_second() -> None:
    """Output in counts/s at K = 1000 counts per deg/s: 2.7777 counts/s is 10 deg/h, less 9.648 of earth rate."""
    rng = np.random.default_rng(0)
    output = 10.0 / 3600.0 * 1000.0 + 1e-5 * rng.standard_normal(1000)
    figure = bias(output, 1.0, ScaleFactor(1000.0, 0.1), InputRate(9.648, 0.002))
    assert figure.value == pytest.approx(0.352, abs=1e-5)
    assert figure.u == pytest.approx(np.hypot(10.0 * 1e-4, 0.002), rel=0.01)
    assert figure.low < 0.352 < figure.high and figure.n == 1000
    assert "9.648" in figure.definition and json.dumps(figure.record())


def test_bias_limits_hold_the_next_hour() -> None:
    inside = 0
    for seed in range(40):
        rate = 0.5 + g.white(np.random.default_rng(seed), 1800, 1.0, 0.01)
        figure = bias(rate, 1.0, UNIT, InputRate(0.0))
        inside += figure.low <= 0.5 <= figure.high
    assert inside >= 36


@pytest.mark.parametrize(("block_s", "expected"), [(1.0, 60.0), (10.0, 18.97), (100.0, 6.0)])
def test_pure_angle_random_walk(block_s: float, expected: float) -> None:
    """Gyro test metrics, section 3: Bs = 60 N, 18.97 N, 6 N."""
    rate = g.white(np.random.default_rng(1), 40_000, 0.5, 0.005)
    figure = bias_stability(rate, 0.5, block_s, UNIT).as_defined
    assert figure.value == pytest.approx(expected * 0.005, abs=4.0 * figure.u)
    assert figure.high / figure.low == pytest.approx(1.0 + 4.0 / np.sqrt(2.0 * figure.n), rel=0.02)
    assert figure.n == int(20_000 / block_s)
    assert f"{block_s:g} s" in figure.symbol and "20000 s" in figure.definition


def test_a_ramp_inflates_the_first_figure_only() -> None:
    """A ramp R adds R T / sqrt(12)."""
    rate = g.white(np.random.default_rng(2), 36_000, 1.0, 0.001) + g.ramp(36_000, 1.0, 0.1)
    found = bias_stability(rate, 1.0, 100.0, UNIT)
    assert found.as_defined.value == pytest.approx(np.hypot(0.1 * 10.0 / 12**0.5, 0.006), rel=0.02)
    assert found.detrended.value == pytest.approx(0.006, rel=0.15)
    assert "detrended" in found.detrended.name and "not detrended" in found.as_defined.definition


def test_detrended_is_the_residual_of_a_fitted_line() -> None:
    rate = np.array([1.0, 2.0, 2.5, 5.0, 4.0])
    time = np.arange(5.0)
    residual = rate - np.polyval(np.polyfit(time, rate, 1), time)
    found = bias_stability(rate, 1.0, 1.0, UNIT)
    assert found.detrended.value == pytest.approx(np.sqrt(residual @ residual / 3.0))
    assert found.as_defined.value == pytest.approx(rate.std(ddof=1))


def test_blocks_do_not_overlap_and_the_rest_is_left_out() -> None:
    assert block_means(np.arange(11.0), 0.5, 1.5).tolist() == [1.0, 4.0, 7.0]
    with pytest.raises(ValueError, match="whole number of samples"):
        block_means(np.arange(100.0), 0.3, 1.0)
    with pytest.raises(ValueError, match="3 or more"):
        block_means(np.arange(20.0), 1.0, 10.0)


def test_missing_samples_are_neither_averaged_nor_closed_up() -> None:
    rate = np.ones(100)
    rate[[3, 50]] = np.nan
    with pytest.raises(ValueError, match="2 of 100 samples"):
        bias(rate, 1.0, UNIT, InputRate(0.0))


def test_repeatability_with_its_chi_square_limits() -> None:
    biases = np.array([0.11, 0.09, 0.10, 0.13, 0.08, 0.10])
    figure = bias_repeatability(biases)
    assert figure.value == pytest.approx(biases.std(ddof=1))
    assert [round(figure.low / figure.value, 2), round(figure.high / figure.value, 2)] == [0.62, 2.45]
    assert "fewer than the 6" in bias_repeatability(biases[:5]).definition
    with pytest.raises(ValueError, match="2 or more"):
        bias_repeatability([0.1])


def test_the_temperature_cycle_has_a_name_of_its_own() -> None:
    figure = full_temperature_bias_stability(np.arange(100.0), 1.0, 10.0, UNIT).as_defined
    assert figure.symbol == "BsT(10 s)" and "temperature cycle" in figure.definition
