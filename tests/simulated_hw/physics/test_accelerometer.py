"""The quartz accelerometer against its formula, and its noise against its density."""

from dataclasses import replace

import numpy as np
import pytest

from simulated_hw.physics.accelerometer import Accelerometer, rows_of_block
from simulated_hw.physics.seeker_parameters import AccelerometerParameters

BARE = AccelerometerParameters(
    bias_sigma_ug=0.0,
    scale_sigma_ppm=0.0,
    bias_ug_k=0.0,
    scale_ppm_k=0.0,
    quadratic_ug_g2=0.0,
    noise_ug_sqrt_hz=0.0,
    instability_ug=0.0,
    lsb_ug=0.0,
)
ROWS = slice(0, 64)


def output(parameters, pull_g, body_degc=25.0, number=0):
    sensor = Accelerometer(parameters, 1, "A", "accelerometer x", 0.01, 1.0)
    return sensor.output_g(number, np.full(6400, pull_g), np.full(64, body_degc), 0, ROWS)


def test_a_bare_one_tells_the_truth():
    assert (output(BARE, 0.5) == 0.5).all()


def test_every_term_of_the_formula():
    p = replace(BARE, bias_ug_k=2.0, scale_ppm_k=10.0, quadratic_ug_g2=15.0)
    expected = (1.0 + 10e-6 * 20.0) * (-0.7 + 2e-6 * 20.0 + 15e-6 * 0.49)
    assert output(p, -0.7, 45.0) == pytest.approx(np.full(6400, expected), abs=1e-12)
    hidden = Accelerometer(replace(BARE, bias_sigma_ug=30.0, scale_sigma_ppm=50.0), 1, "A", "x", 0.01, 1.0)
    found = hidden.output_g(0, np.full(6400, 0.5), np.full(64, 25.0), 0, ROWS)
    expected = (1.0 + hidden.scale_ppm * 1e-6) * (0.5 + hidden.bias_ug * 1e-6)
    assert found == pytest.approx(np.full(6400, expected), abs=1e-12)
    assert hidden.bias_ug != 0.0 and hidden.scale_ppm != 0.0


def test_hidden_errors_have_the_stated_size():
    drawn = [Accelerometer(AccelerometerParameters(), 1, str(n), "x", 0.01, 1.0) for n in range(400)]
    assert np.std([sensor.bias_ug for sensor in drawn]) == pytest.approx(30.0, rel=0.12)
    assert np.std([sensor.scale_ppm for sensor in drawn]) == pytest.approx(50.0, rel=0.12)


def test_white_noise_has_the_stated_density():
    """One-sided density d: means over a time t scatter by d / sqrt(2 t)."""
    samples = np.concatenate([output(replace(BARE, noise_ug_sqrt_hz=7.0), 0.0, number=n) for n in range(8)]) * 1e6
    for m in (1, 10, 100):
        means = samples.reshape(-1, m).mean(axis=1)
        assert means.std() == pytest.approx(7.0 / np.sqrt(2.0 * m * 0.01), rel=0.12)


def test_whole_quanta_and_full_scale():
    found = output(replace(BARE, noise_ug_sqrt_hz=5.0, lsb_ug=10.0), 0.2) * 1e5
    np.testing.assert_allclose(found, np.round(found), atol=1e-6)
    assert len(np.unique(np.round(found))) > 5
    assert (output(replace(BARE, range_g=0.4), 0.9) == 0.4).all()


def test_flicker_wanders_by_its_size():
    p = replace(BARE, instability_ug=100.0)
    wander = [
        Accelerometer(p, seed, "A", "x", 0.01, 1.0).output_g(0, np.zeros(64), np.full(64, 25.0), 0, ROWS).mean() * 1e6
        for seed in range(60)
    ]
    # nine Gauss-Markov processes a decade apart: sqrt(9 ln 10 / (2 ln 2)) floors of 0.664 B, the fastest averaged away
    assert 150.0 < np.std(wander) < 350.0


def test_where_the_rows_of_a_block_stand():
    assert rows_of_block(17, 64) == (1, slice(64, 128))
