"""Error models against published figures and closed forms."""

import dataclasses

import numpy as np
import pytest

from simulated_hw.physics.gyro_errors import ErrorModel, stuck_in_dead_band
from simulated_hw.physics.gyro_parameters import CurveParameters, GyroParameters, SurfaceParameters

# The grid of the `ts` experiment without rate 0: -30:5:60 °C, ±10:10:180 deg/s.
TEMPERATURES = np.arange(-30.0, 61.0, 5.0)
RATES = np.array([r for r in np.arange(-180.0, 181.0, 10.0) if r])


def grid_errors(parameters):
    t, rate = (a.ravel() for a in np.meshgrid(TEMPERATURES, RATES, indexing="ij"))
    output = ErrorModel(parameters).output_dps(t, rate)
    return t, rate, output


def test_surface_a_has_the_published_statistics():
    t, rate, output = grid_errors(GyroParameters())
    error = output - rate
    assert len(error) == 684
    assert np.abs(error).max() == pytest.approx(11.6008, abs=5e-5)
    assert error.std(ddof=1) == pytest.approx(4.62689, abs=5e-6) or error.std() == pytest.approx(4.62689, abs=5e-6)
    design = np.stack([np.ones_like(t), t, output], axis=1)
    residual = rate - design @ np.linalg.lstsq(design, rate, rcond=None)[0]
    assert np.abs(residual).max() == pytest.approx(3.5006, abs=5e-5)
    assert residual.std() == pytest.approx(1.7306, abs=5e-4)


def test_every_number_of_the_surface_counts():
    base = SurfaceParameters()
    _, _, reference = grid_errors(GyroParameters())
    for field in dataclasses.fields(base):
        changed = dataclasses.replace(base, **{field.name: getattr(base, field.name) * 1.1})
        _, _, output = grid_errors(GyroParameters(surface=changed))
        assert np.abs(output - reference).max() > 1e-3, field.name


def curve_model(**fields):
    return ErrorModel(GyroParameters(model="curves", max_rate_dps=200.0, curves=CurveParameters(**fields)))


def test_polynomials_in_ppm_and_degrees_an_hour():
    model = curve_model(reference_degc=20.0, scale_polynomial=(100.0, 10.0, 0.5), bias_polynomial=(3.6, 0.36))
    assert model.scale(np.array([20.0, 30.0])) == pytest.approx([100e-6, (100 + 100 + 50) * 1e-6])
    assert model.bias_dps(np.array([20.0, 30.0])) == pytest.approx([1e-3, 2e-3])
    output = model.output_dps(np.array([30.0]), np.array([-100.0]))
    assert output == pytest.approx([-100.0 * (1 + 250e-6) + 2e-3], abs=1e-12)


def test_tables_are_interpolated_and_held_beyond_their_ends():
    model = curve_model(
        scale_temperatures_degc=(-10.0, 10.0, 40.0),
        scale_values_ppm=(0.0, 200.0, -100.0),
        bias_temperatures_degc=(0.0, 10.0),
        bias_values_dph=(36.0, 72.0),
    )
    assert model.scale(np.array([-50.0, 0.0, 10.0, 25.0, 90.0])) * 1e6 == pytest.approx([0, 100, 200, 50, -100])
    assert model.bias_dps(np.array([-5.0, 5.0, 99.0])) == pytest.approx([0.01, 0.015, 0.02])


def test_nonlinearity_asymmetry_and_sagnac_sine():
    cubic = curve_model(k3_ppm=40.0, asymmetry_ppm=10.0)
    rate = np.array([-200.0, -100.0, 0.0, 100.0, 200.0])
    ppm = (cubic.respond(rate.copy()) - rate)[[0, 1, 3, 4]] / rate[[0, 1, 3, 4]] * 1e6
    assert ppm == pytest.approx([40 - 10, 10 - 10, 10 + 10, 40 + 10], abs=1e-6)
    open_loop = curve_model(alpha=0.0013)
    relative = open_loop.respond(np.array([180.0]))[0] / 180.0 - 1.0
    assert relative == pytest.approx(-((0.0013 * 180) ** 2) / 6, rel=3e-3)
    assert curve_model().respond(rate.copy()).tolist() == rate.tolist()


def test_a_dead_band_sticks_at_zero_and_fades_away_beyond():
    band = 0.1
    found = stuck_in_dead_band(np.array([-0.2, -0.1, -0.0999, 0.0, 0.05, 0.1, 0.2, 5.0]), band)
    beyond = 0.2 - 0.1 * np.exp(-1.0)
    assert found == pytest.approx([-beyond, 0.0, 0.0, 0.0, 0.0, 0.0, beyond, 5.0], abs=1e-12)


def test_only_curves_have_a_dead_band():
    curves = CurveParameters(dead_band_dph=0.36)
    assert ErrorModel(GyroParameters(model="curves", curves=curves)).dead_band_dps == pytest.approx(1e-4)
    assert ErrorModel(GyroParameters(curves=curves)).dead_band_dps == 0.0
