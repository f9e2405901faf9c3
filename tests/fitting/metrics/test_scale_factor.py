"""Scale factor figures against numpy, statsmodels and hand-made sets."""

import numpy as np
import pytest
import statsmodels.api as sm

from fitting.metrics.scale_factor import (
    fit_line,
    rate_set,
    scale_factor_repeatability,
    scale_factor_temperature_sensitivity,
)

R5 = np.array([1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0, 40.0, 63.0, 100.0, 160.0, 250.0])
RATES = np.concatenate([-R5[::-1], R5])


def test_line_and_covariance_are_least_squares() -> None:
    rng = np.random.default_rng(0)
    outputs = 3.0 + 100.0 * RATES + rng.standard_normal(len(RATES))
    line = fit_line(RATES + 20.0, outputs)
    theirs = sm.OLS(outputs, np.column_stack([RATES + 20.0, np.ones(len(RATES))])).fit()
    assert [line.slope, line.offset] == pytest.approx(theirs.params, rel=1e-10)
    assert line.covariance == pytest.approx(theirs.cov_params(), rel=1e-8)


def test_rest_outputs_take_bias_and_earth_rate_away() -> None:
    outputs = 50.0 * RATES + 7.0 + np.linspace(0.0, 0.2, len(RATES))
    found = rate_set(RATES, outputs, rest_before=7.0, rest_after=7.2)
    assert found.scale_factor.value == pytest.approx(50.0, rel=1e-3)
    assert abs(found.offset.value) < 1e-6
    exact = rate_set(RATES, 50.0 * RATES + 7.0, rest_before=7.0)
    assert exact.scale_factor.value == pytest.approx(50.0, rel=1e-14)
    assert exact.nonlinearity.value < 1e-6 and exact.asymmetry.value < 1e-6


def test_nonlinearity_in_ppm_of_full_scale_and_of_reading() -> None:
    outputs = RATES.copy()
    outputs[20] += 0.01
    found = rate_set(RATES, outputs)
    line = np.polyfit(RATES, outputs, 1)
    residual = outputs - np.polyval(line, RATES)
    assert found.nonlinearity.value == pytest.approx(1e6 * np.abs(residual).max() / 250.0)
    assert found.nonlinearity.unit == "ppm of full scale" and f"{RATES[20]:g} deg/s" in found.nonlinearity.definition
    assert found.reading_ppm == pytest.approx(1e6 * residual / (line[0] * RATES))
    assert found.residuals_ppm == pytest.approx(1e6 * residual / 250.0, abs=1e-6)


@pytest.mark.parametrize("rest", [True, False])
def test_asymmetry(rest: bool) -> None:
    outputs = np.where(RATES > 0.0, 1.0 + 50e-6, 1.0 - 50e-6) * RATES
    found = rate_set(RATES, outputs, rest_in_halves=rest)
    assert found.asymmetry.value == pytest.approx(100.0, rel=1e-4)
    assert ("not in the fits" in found.asymmetry.definition) is not rest


def test_table_error_goes_into_k_and_nowhere_else() -> None:
    rng = np.random.default_rng(1)
    outputs = RATES + 1e-5 * rng.standard_normal(len(RATES))
    plain, with_table = rate_set(RATES, outputs), rate_set(RATES, outputs, table_u_ppm=10.0)
    assert with_table.scale_factor.u == pytest.approx(10e-6, rel=0.01)
    assert plain.scale_factor.u < 0.1e-6
    assert with_table.nonlinearity == plain.nonlinearity and with_table.asymmetry == plain.asymmetry


def test_noise_floor_of_the_notes() -> None:
    """Section 5: N = 0.005, 60 s, 11 rates of each sign to 250 deg/s: 0.024 ppm on K."""
    rates = np.concatenate([-R5[2:], R5[2:]])
    sigma_dps = 60.0 * 0.005 / 60.0**0.5 / 3600.0
    rng = np.random.default_rng(2)
    sets = [rate_set(rates, rates + sigma_dps * rng.standard_normal(len(rates))) for _ in range(300)]
    scatter_ppm = 1e6 * np.std([found.scale_factor.value for found in sets])
    assert scatter_ppm == pytest.approx(0.024, abs=0.003)
    assert 1e6 * np.mean([found.scale_factor.u for found in sets]) == pytest.approx(scatter_ppm, rel=0.1)
    inside = np.mean([found.scale_factor.low <= 1.0 <= found.scale_factor.high for found in sets])
    assert 0.92 < inside < 0.98


def test_repeatability_and_temperature_sensitivity() -> None:
    figure = scale_factor_repeatability([1.0, 1.00001, 0.99999, 1.0, 1.00002, 0.99998])
    assert figure.value == pytest.approx(1e6 * np.std([0, 1e-5, -1e-5, 0, 2e-5, -2e-5], ddof=1))
    kt = scale_factor_temperature_sensitivity(
        [-40.0, 15.0, 20.0, 60.0], [1.0006, 1.01, 1.0, 0.9992], [1e-5, 1e-5, 1e-5, 2e-5], 21.0
    )
    assert kt.value == pytest.approx(20.0)
    assert kt.u == pytest.approx(1e6 * np.hypot(1e-5, 2e-5) / 40.0)


def test_what_cannot_be_fitted_is_said() -> None:
    with pytest.raises(ValueError, match="one direction"):
        rate_set(R5, R5)
    with pytest.raises(ValueError, match="3 points"):
        fit_line(np.array([1.0, 1.0, 1.0]), np.array([1.0, 2.0, 3.0]))
