"""Bias over temperature, its rate, and hysteresis."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.typing import NDArray
from scipy.signal import lfilter

from fitting.metrics.thermal import (
    bias_temperature_rate_sensitivity,
    bias_temperature_sensitivity,
    hysteresis,
)


def test_the_largest_ratio_with_soaks_near_room_left_out() -> None:
    t, b = [-40.0, 0.0, 18.0, 20.0, 60.0], [0.1, 0.2, 9.0, 0.5, 0.1]
    found = bias_temperature_sensitivity(t, b, [0.01] * 5, 20.5)
    assert found.sensitivity.value == pytest.approx(0.3 / 20.0)
    assert found.sensitivity.u == pytest.approx(0.01 * 2**0.5 / 20.0)
    assert "found at 0 degC" in found.sensitivity.definition
    assert found.table.shape == (5, 3)


def test_polynomial_through_the_table() -> None:
    t = np.array([-40.0, -20.0, 0.0, 20.0, 40.0, 60.0])
    b = 0.3 - 0.002 * t + 1e-5 * t**2
    found = bias_temperature_sensitivity(t, b, np.full(6, 0.01), 20.0)
    assert found.polynomial == pytest.approx([0.3, -0.002, 1e-5], rel=1e-8)
    assert found.residual_rms_dph < 1e-12
    assert np.isnan(bias_temperature_sensitivity(t[::3], b[::3], [0.1, 0.1], 20.0, degree=5).residual_rms_dph)


def test_all_soaks_at_room_temperature_are_no_temperature_test() -> None:
    with pytest.raises(ValueError, match="low, room and high"):
        bias_temperature_sensitivity([18.0, 20.0, 25.0], [0.1, 0.2, 0.3], [0.01] * 3, 20.0)


def cycle() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Temperature and its slope in degC/min at one row a minute: down and up at 1 and at 0.5 degC/min."""
    slope = np.concatenate([np.full(80, -1.0), np.full(80, 1.0), np.full(160, -0.5), np.full(160, 0.5)])
    return 40.0 + np.cumsum(slope), slope


def test_rate_sensitivity_and_its_covariance_are_statsmodels() -> None:
    t, slope = cycle()
    rng = np.random.default_rng(0)
    noise = lfilter([1.0], [1.0, -0.8], 0.02 * rng.standard_normal(len(t)))
    bias = 0.2 + 0.003 * t - 2e-5 * t**2 + 0.4 * slope + noise
    found = bias_temperature_rate_sensitivity(bias, t, slope)
    matrix = np.column_stack([np.ones_like(t), t, t**2, slope])
    theirs = sm.OLS(bias, matrix).fit(cov_type="HAC", cov_kwds={"maxlags": found.lags, "use_correction": True})
    assert found.coefficients == pytest.approx(theirs.params, rel=1e-8)
    assert found.covariance == pytest.approx(theirs.cov_params(), rel=1e-8)
    assert found.rate_sensitivity.low < 0.4 < found.rate_sensitivity.high
    white = sm.OLS(bias, matrix).fit().bse[3]
    assert found.rate_sensitivity.u > 1.3 * white


def test_a_gradient_column() -> None:
    t, slope = cycle()
    rng = np.random.default_rng(1)
    difference = 2.0 * slope + rng.standard_normal(len(t))
    bias = 0.1 + 0.4 * slope - 0.05 * difference + 1e-4 * rng.standard_normal(len(t))
    found = bias_temperature_rate_sensitivity(bias, t, slope, difference)
    assert found.coefficients[3:] == pytest.approx([0.4, -0.05], abs=1e-3)
    assert found.residual_rms_dph == pytest.approx(1e-4, rel=0.1)


def test_no_ramp_no_rate_sensitivity() -> None:
    t, slope = cycle()
    with pytest.raises(ValueError, match="up and down"):
        bias_temperature_rate_sensitivity(t, t, np.zeros_like(t))
    with pytest.raises(ValueError, match="up and down"):
        bias_temperature_rate_sensitivity(t[:80], t[:80], slope[:80])


def test_hysteresis_between_the_branches() -> None:
    t, slope = cycle()
    rng = np.random.default_rng(2)
    loop = 0.3 * np.exp(-(((t - 5.0) / 8.0) ** 2)) * (slope > 0)
    bias = 0.01 * t + loop + 0.001 * rng.standard_normal(len(t))
    figure = hysteresis(bias, t, slope, bin_degc=2.0, moving=0.1)
    assert figure.value == pytest.approx(0.3, abs=0.02)
    assert "found at 5 degC" in figure.definition


def test_rows_at_rest_belong_to_no_branch() -> None:
    t, slope = cycle()
    rest = np.abs(np.abs(slope) - 1.0) < 1e-9
    bias = np.where(rest, 100.0, 0.0)
    assert hysteresis(bias, t, np.where(rest, 0.0, slope), bin_degc=2.0, moving=0.1).value == 0.0
    with pytest.raises(ValueError, match="both branches"):
        hysteresis(bias, t, np.abs(slope), bin_degc=2.0, moving=0.1)
