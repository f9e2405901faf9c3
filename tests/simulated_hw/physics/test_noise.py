"""Noise generators: Allan deviations over seeds against theory, and independence of who asks for what."""

import numpy as np
import pytest

from simulated_hw.physics.gyro_parameters import NoiseParameters
from simulated_hw.physics.noise import FLOOR_PER_B, ROWS_PER_CHUNK, FlickerBank, SlowNoise, white_sigma_dps
from simulated_hw.physics.streams import Stream

SILENT = NoiseParameters(0.0, 0.0, 0.0, 0.0, 0.0)


def slow(seed, row_s=1.0, **coefficients):
    noise = NoiseParameters(
        **{**dict.fromkeys(("arw_deg_sqrt_h", "bias_instability_dph", "rrw_dph_sqrt_h"), 0.0)} | coefficients
    )
    return SlowNoise(noise, row_s, Stream(seed, "dut", "slow noise"))


def record_dph(noise, chunks):
    return np.concatenate([noise.means_dps(chunk) for chunk in range(chunks)]) * 3600.0


def allan(rate, m):
    """Overlapping Allan deviation of interval means at m intervals (IEEE Std 952, cluster averages)."""
    angle = np.concatenate([[0.0], np.cumsum(rate)])
    second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
    return np.sqrt(np.mean(second**2) / 2.0) / m


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_the_allan_estimator_here_is_right():
    white = np.random.default_rng(1).standard_normal(200_000)
    assert allan(white, 16) == pytest.approx(0.25, rel=0.02)
    ramp = np.arange(1000.0)
    assert allan(ramp, 10) == pytest.approx(10 / np.sqrt(2))


@pytest.mark.parametrize("tau", [4, 30, 300, 1000])
def test_flicker_has_its_floor(tau):
    sigma = [allan(record_dph(slow(seed, bias_instability_dph=0.3), 12), tau) for seed in range(40)]
    # The bank's shortest time is 0.1 s: the floor is whole from 3 s on, a few per cent low before.
    assert rms(sigma) / (0.3 * 0.664) == pytest.approx(1.0, abs=0.05)
    assert abs(FLOOR_PER_B - 0.66428) < 1e-5


@pytest.mark.parametrize("row_s", [1.0, 0.25])
def test_rate_random_walk_has_its_slope(row_s):
    for m in (1, 30, 300):
        sigma = [allan(record_dph(slow(seed, row_s, rrw_dph_sqrt_h=0.6), 4), m) for seed in range(60)]
        assert rms(sigma) == pytest.approx(0.6 * np.sqrt(m * row_s / 3600.0 / 3.0), rel=0.05)


def test_rate_ramp():
    record = record_dph(slow(1, rate_ramp_dph_h=2.0), 4)
    hours = (np.arange(len(record)) + 0.5) / 3600.0
    np.testing.assert_allclose(record, 2.0 * hours, rtol=1e-12)


def test_white_noise_level():
    # N = 0.05 deg/sqrt(h): 0.05 deg/h over one hour.
    noise = NoiseParameters(arw_deg_sqrt_h=0.05)
    assert white_sigma_dps(noise, 3600.0) * 3600.0 == pytest.approx(0.05)
    assert white_sigma_dps(noise, 0.01) * 3600.0 == pytest.approx(0.05 * 60 / np.sqrt(0.01))


def test_block_means_are_exact_over_any_interval():
    """Means over 10 s must have the statistics of averages of ten means over 1 s: variance, and covariance in a row."""

    def moments(interval_s, group):
        bank = FlickerBank(1.0, interval_s)
        rng = np.random.default_rng(2)
        records = []
        for _ in range(60):
            start = rng.standard_normal(9) * bank.sigma_dph
            means, _ = bank.advance(start, rng.standard_normal((9, 400 * group)))
            means += bank.own_dph * rng.standard_normal(400 * group)
            records.append(means.reshape(-1, group).mean(axis=1))
        values = np.array(records)
        steps = np.diff(values, axis=1)
        return values.var(), steps.var(), np.mean(steps[:, 1:] * steps[:, :-1])

    fine, coarse = moments(1.0, 10), moments(10.0, 1)
    assert fine[0] == pytest.approx(coarse[0], rel=0.25)  # dominated by 60 draws of the slowest processes
    assert fine[1] == pytest.approx(coarse[1], rel=0.05)
    assert fine[2] == pytest.approx(coarse[2], rel=0.08)


def test_starts_stationary():
    records = [record_dph(slow(seed, bias_instability_dph=1.0), 1)[:2] for seed in range(500)]
    bank = FlickerBank(FLOOR_PER_B, 1.0)
    assert np.std(records) == pytest.approx(3.0 * bank.sigma_dph, rel=0.08)  # nine processes


def test_chunks_are_the_same_in_any_order():
    coefficients = {"bias_instability_dph": 0.3, "rrw_dph_sqrt_h": 0.2}
    in_order = [slow(3, **coefficients).means_dps(chunk).tobytes() for chunk in range(6)]
    jumping = slow(3, **coefficients)
    assert [jumping.means_dps(chunk).tobytes() for chunk in (5, 0, 3, 5)] == [in_order[n] for n in (5, 0, 3, 5)]
    record = record_dph(slow(3, **coefficients), 6)
    steps = np.abs(np.diff(record))
    seams = steps[ROWS_PER_CHUNK - 1 :: ROWS_PER_CHUNK]
    assert seams.max() < steps.max()  # no jump where chunks meet


def test_names_decide():
    a = SlowNoise(NoiseParameters(), 1.0, Stream(1, "a", "slow noise")).means_dps(0)
    b = SlowNoise(NoiseParameters(), 1.0, Stream(1, "b", "slow noise")).means_dps(0)
    assert abs(np.corrcoef(np.diff(a), np.diff(b))[0, 1]) < 0.15
    assert not np.any(SlowNoise(SILENT, 1.0, Stream(1, "a", "slow noise")).means_dps(7))
