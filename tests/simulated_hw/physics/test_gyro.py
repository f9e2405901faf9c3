"""The gyro's frames: right in the mean, noisy as stated, and the same whoever asks for them, in whatever pieces."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulated_hw.physics.axes import EARTH_RATE_DPS, earth_rate_dps
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.gyro_classes import gyro_class
from simulated_hw.physics.gyro_errors import ErrorModel
from simulated_hw.physics.gyro_parameters import (
    GyroParameters,
    NoiseParameters,
    RepeatabilityParameters,
    SensorParameters,
    ThermalParameters,
)
from simulated_hw.physics.parameters import ChamberParameters, TableParameters
from simulated_hw.physics.rate_table import TablePlant

HOUR = 3600.0
NO_NOISE = NoiseParameters(0.0, 0.0, 0.0, 0.0, 0.0)
NO_SHUPE = ThermalParameters(shupe_c1=0.0, shupe_c2=0.0, shupe_c3=0.0)
# Every error off but the surface.
BARE = GyroParameters(
    clock_offset_ppm=0.0,
    turn_on_bias_sigma_dph=0.0,
    thermal=NO_SHUPE,
    sensor=SensorParameters(offset_sigma_k=0.0, noise_k=0.0, lsb_k=0.0),
    noise=NO_NOISE,
    repeatability=RepeatabilityParameters(0.0, 0.0, 0.0),
)
PLAIN_TABLE = TableParameters(rate_gain_sigma_ppm=0.0, angle_error_orders=(), angle_error_arcsec=())


class Bench:
    """A chamber and a table with gyros on it."""

    def __init__(self, table=PLAIN_TABLE, seed=1):
        self.chamber = ChamberPlant(ChamberParameters(), seed)
        self.table = TablePlant(table, seed)
        self.seed = seed

    def gyro(self, parameters=BARE, serial="A", earth_dps=0.0):
        return GyroUnit(parameters, self.chamber, self.table, seed=self.seed, serial=serial, earth_dps=earth_dps)


def same(a, b):
    return all(
        getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in ("rate_dps", "temperature_degc", "good")
    )


def test_output_is_the_error_model_of_the_true_rate_and_coil_temperature():
    bench = Bench()
    gyro = bench.gyro(earth_dps=0.003)
    bench.chamber.command(0.0, 45.0, 2.0)
    bench.table.energise(0.0)
    bench.table.command_rate(10.0, -130.0)
    k = gyro.frames_until(1700.0)  # in the middle of the warming
    block = gyro.block(k - 1000, k)
    middles = (np.arange(k - 1000, k) + 0.5) * 0.01
    truth = gyro.truth(middles)
    assert 30.0 < truth["coil_degc"][0] < 45.0
    assert truth["input_rate_dps"] == pytest.approx(np.full(1000, -129.997), abs=1e-9)
    expected = ErrorModel(BARE).output_dps(truth["coil_degc"], truth["input_rate_dps"])
    np.testing.assert_allclose(block.rate_dps, expected, atol=2e-6)
    assert block.good.all()


def test_frames_are_counted_by_the_gyros_own_clock():
    fast = Bench().gyro(replace(BARE, clock_offset_ppm=50.0))
    assert fast.frames_until(0.0) == 0
    assert fast.frames_until(1e5) == 10_000_500
    exact = Bench().gyro()
    assert [exact.frames_until(n * 0.01) for n in range(2000)] == list(range(2000))
    assert [exact.frames_until(n * 0.01 - 1e-4) for n in range(1, 100)] == list(range(99))


@st.composite
def splits(draw):
    """A range of frames and how to cut it, over several blocks of the implementation."""
    begin = draw(st.integers(0, 30_000))
    cuts = draw(st.lists(st.integers(0, 20_000), max_size=6))
    end = begin + draw(st.integers(1, 20_000))
    return begin, sorted({begin, end, *(begin + c for c in cuts if begin + c < end)}), end


@given(splits(), st.sampled_from([0.0, 0.3]), st.sampled_from([100.0, 37.5]))
@settings(max_examples=30, deadline=None)
def test_a_block_is_the_concatenation_of_its_parts_bit_for_bit(split, lsb_arcsec, data_rate_hz):
    begin, edges, end = split
    parameters = replace(gyro_class("ts_a"), data_rate_hz=data_rate_hz, noise=NoiseParameters(lsb_arcsec=lsb_arcsec))
    bench = Bench(TableParameters())
    bench.chamber.command(0.0, 60.0, 4.0)
    bench.table.energise(0.0)
    for n in range(8):
        bench.table.command_rate(20.0 + 47.3 * n, 25.0 * n - 90.0)
    whole = bench.gyro(parameters).block(begin, end)
    piecewise = bench.gyro(parameters)
    parts = [piecewise.block(a, b) for a, b in pairwise(edges)]
    for name in ("rate_dps", "temperature_degc", "good"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert joined.tobytes() == getattr(whole, name).tobytes()


@given(st.lists(st.floats(0.0, 299.0), max_size=12), st.sampled_from([0.0, 0.3]))
@settings(max_examples=25, deadline=None)
def test_no_frame_depends_on_who_looked_when(looks, lsb_arcsec):
    """One gyro is read while commands come, at any times; its twin only in the end."""
    parameters = replace(gyro_class("ts_b"), noise=NoiseParameters(lsb_arcsec=lsb_arcsec))
    watched, left_alone = Bench(TableParameters()), Bench(TableParameters())
    gyro, twin = watched.gyro(parameters), left_alone.gyro(parameters)
    seen = []
    commands = [(t, rate) for t, rate in zip(np.arange(1.0, 300.0, 23.71), np.linspace(-100, 150, 13), strict=True)]
    for bench in (watched, left_alone):
        bench.table.energise(0.0)
    pending = sorted(looks)
    read = 0
    for at, rate in commands:
        while pending and pending[0] <= at:
            now = gyro.frames_until(pending.pop(0))
            seen.append((read, now, gyro.block(read, now)))
            read = now
        for bench in (watched, left_alone):
            bench.table.command_rate(at, rate)
            if rate > 0.0:
                bench.chamber.command(at, rate / 3.0, 3.0)
    end = gyro.frames_until(300.0)
    seen.append((read, end, gyro.block(read, end)))
    assert all(same(block, twin.block(a, b)) for a, b, block in seen)


def test_skipping_changes_nothing_and_costs_nothing():
    one, other = Bench().gyro(gyro_class("ts_a")), Bench().gyro(gyro_class("ts_a"))
    far = 100 * 3600 * 20
    late = one.block(far, far + 500)
    other.block(0, 300)
    assert same(other.block(far, far + 500), late)
    assert same(one.block(0, 300), other.block(0, 300))  # and back again


def test_adding_a_dut_or_a_seed_changes_nobody_else():
    alone = Bench().gyro(gyro_class("ts_a")).block(0, 3000)
    bench = Bench()
    first, second = bench.gyro(gyro_class("ts_a")), bench.gyro(gyro_class("ts_a"), serial="B")
    second_block = second.block(0, 3000)
    assert same(first.block(0, 3000), alone)
    assert abs(np.corrcoef(second_block.rate_dps, alone.rate_dps)[0, 1]) < 0.1
    other_seed = Bench(seed=2).gyro(gyro_class("ts_a")).block(0, 3000)
    assert abs(np.corrcoef(other_seed.rate_dps, alone.rate_dps)[0, 1]) < 0.1


def test_angle_random_walk_is_that_of_the_parameters():
    cold = replace(NO_SHUPE, self_heating_k=0.0)  # no warming up
    gyro = Bench().gyro(replace(BARE, thermal=cold, noise=replace(NO_NOISE, arw_deg_sqrt_h=0.05)))
    rate_dph = gyro.block(0, 200_000).rate_dps * 3600.0
    for m in (1, 10, 100):
        tau_s = m * 0.01
        means = rate_dph.reshape(-1, m).mean(axis=1)
        allan = np.sqrt(np.mean(np.diff(means) ** 2) / 2.0)
        assert allan == pytest.approx(0.05 * 60.0 / np.sqrt(tau_s), rel=0.05)
    whole = rate_dph - rate_dph.mean()
    assert abs(np.mean((whole / whole.std()) ** 4) - 3.0) < 0.05  # normal


def test_quantised_angle_carries_the_residue():
    noise = replace(NO_NOISE, arw_deg_sqrt_h=0.002, lsb_arcsec=1.0)
    gyro = Bench().gyro(replace(BARE, noise=noise), earth_dps=0.01234)
    plain = Bench().gyro(replace(BARE, noise=replace(noise, lsb_arcsec=0.0)), earth_dps=0.01234)
    quanta = gyro.block(0, 60_000).rate_dps * 0.01 * 3600.0
    np.testing.assert_allclose(quanta, np.round(quanta), atol=1e-6)
    angle, truth = np.cumsum(quanta), np.cumsum(plain.block(0, 60_000).rate_dps) * 0.01 * 3600.0
    error = angle - truth
    assert np.ptp(error) < 1.0 + 1e-6
    assert error.std() == pytest.approx(1 / np.sqrt(12), rel=0.1)


def test_clips_at_full_scale_and_says_so():
    bench = Bench()
    gyro = bench.gyro(replace(BARE, max_rate_dps=150.0))
    bench.table.energise(0.0)
    bench.table.command_rate(0.0, -180.0)
    block = gyro.block(0, 1000)
    assert block.rate_dps.min() == -150.0
    assert not block.good[500:].any()
    assert block.good[:100].all()
    assert (block.good == (block.rate_dps > -150.0)).all()


def test_earth_rate():
    assert earth_rate_dps(None) == 0.0
    assert earth_rate_dps(90.0) == EARTH_RATE_DPS == pytest.approx(0.0041780746, rel=1e-6)
    assert earth_rate_dps(-30.0) == pytest.approx(-0.5 * EARTH_RATE_DPS)


def test_temperature_comes_once_a_second_lagging_rounded_and_off_by_its_offset():
    bench = Bench()
    sensor = SensorParameters(lag_s=30.0, offset_sigma_k=0.5, noise_k=0.01, lsb_k=0.01)
    gyro = bench.gyro(replace(BARE, sensor=sensor))
    bench.chamber.command(0.0, 85.0, 4.0)
    k = gyro.frames_until(900.0)
    block = gyro.block(k - 10_000, k)
    per_second = block.temperature_degc.reshape(-1, 100)
    assert (per_second == per_second[:, :1]).all()
    assert len(np.unique(per_second[:, 0])) > 50
    np.testing.assert_allclose(per_second * 100, np.round(per_second * 100), atol=1e-9)
    seconds = 800.0 + np.arange(100)
    nodes = gyro.rows.chain.temperatures_degc(seconds)
    assert np.std(per_second[:, 0] - nodes[:, 3]) < 0.02
    assert np.mean(per_second[:, 0] - nodes[:, 3]) == pytest.approx(gyro.rows.sensor_offset_k, abs=0.005)
    coil = gyro.truth(seconds)["coil_degc"]
    lag_k = np.mean(coil - nodes[:, 3])
    slope = (coil[-1] - coil[0]) / 99.0
    assert lag_k == pytest.approx(30.0 * slope, rel=0.1)


def test_repeatability_is_drawn_anew_at_every_thermal_excursion_and_only_then():
    bench = Bench()
    repeat = RepeatabilityParameters(scale_ppm=1000.0, bias_dph=500.0, sensor_k=1.0)
    gyro, ideal = bench.gyro(replace(BARE, repeatability=repeat)), bench.gyro(serial="ideal")
    bench.table.energise(0.0)
    bench.table.command_rate(1.0, 100.0)
    errors, sensors = [], []
    for n, setpoint in enumerate((25.0, 24.9, 24.9, 24.8)):
        at = 600.0 * (n + 1)
        bench.chamber.command(at, setpoint)
        k = gyro.frames_until(at + 500.0)
        mine, other = gyro.block(k - 5000, k), ideal.block(k - 5000, k)
        difference = mine.rate_dps - other.rate_dps
        assert np.ptp(difference) < 1e-3
        errors.append(difference.mean())
        sensors.append((mine.temperature_degc - other.temperature_degc).mean())
    assert errors[1] == pytest.approx(errors[2], abs=2e-4)
    assert len({round(e, 3) for e in errors}) == 3
    draws = gyro.truth(np.array([1900.0, 2500.0]))
    predicted = 1e-6 * draws["scale_ppm"] * 105.0 + draws["bias_dph"] / 3600.0
    assert [errors[2], errors[3]] == pytest.approx(predicted.tolist(), abs=3e-3)
    assert [sensors[2], sensors[3]] == pytest.approx(draws["sensor_k"].tolist(), abs=1e-6)


def test_repeatability_has_the_stated_size():
    gyro = Bench().gyro(gyro_class("ts_a"))
    drawn = [gyro.rows.draws(n) for n in range(1500)]
    assert np.std([d.scale_ppm for d in drawn]) == pytest.approx(100.0, rel=0.06)
    assert np.std([d.bias_dph for d in drawn]) == pytest.approx(2.0, rel=0.06)
    assert np.std([d.sensor_k for d in drawn]) == pytest.approx(0.1, rel=0.06)


def test_shupe_bias_follows_the_rate_of_temperature_and_vanishes_at_rest():
    bench = Bench()
    plain = bench.gyro()
    c1, c2, c3 = (
        bench.gyro(replace(BARE, thermal=replace(NO_SHUPE, **{name: 100.0})))
        for name in ("shupe_c1", "shupe_c2", "shupe_c3")
    )
    bench.chamber.command(4 * HOUR, 60.0, 1.0)
    for at, moving in ((4 * HOUR - 10, False), (4 * HOUR + 1500.0, True)):
        k = plain.frames_until(at)
        base = plain.block(k - 10, k).rate_dps[-1]
        extra_dph = [(g.block(k - 10, k).rate_dps[-1] - base) * 3600.0 / 100.0 for g in (c1, c2, c3)]
        nodes = plain.rows.chain.temperatures_degc(np.array([at - 0.5, at, at + 0.5]))
        outer_min = (nodes[2, 1] - nodes[0, 1]) * 60.0
        difference_min = outer_min - (nodes[2, 2] - nodes[0, 2]) * 60.0
        assert extra_dph == pytest.approx([outer_min, difference_min, nodes[1, 1] - nodes[1, 2]], abs=6e-3)
        assert (abs(extra_dph[0]) > 0.5) == moving


def test_hysteresis_takes_the_sign_of_the_last_setpoint_change():
    bench = Bench()
    plain, hysteretic = bench.gyro(), bench.gyro(replace(BARE, thermal=replace(NO_SHUPE, hysteresis_dph=10.0)))
    found = []
    for at, setpoint in ((100.0, 25.5), (200.0, 25.0)):
        bench.chamber.command(at, setpoint)
        k = plain.frames_until(at + 50.0)
        found.append(((hysteretic.block(k - 5, k).rate_dps - plain.block(k - 5, k).rate_dps) * 3600.0).mean())
    assert found == pytest.approx([5.0, -5.0], abs=1e-6)


def test_blocks_are_read_only_and_ranges_checked():
    gyro = Bench().gyro()
    block = gyro.block(5, 10)
    with pytest.raises(ValueError, match="read-only"):
        block.rate_dps[0] = 1.0
    assert [len(gyro.block(5, 5).rate_dps), len(gyro.block(5, 5).good)] == [0, 0]
    with pytest.raises(ValueError, match="no frames from 7 to 5"):
        gyro.block(7, 5)


@pytest.mark.parametrize("data_rate_hz", [1.0, 12.5, 400.0, 2000.0, 20_000.0])
def test_any_data_rate(data_rate_hz):
    bench = Bench(TableParameters())
    gyro = bench.gyro(replace(BARE, data_rate_hz=data_rate_hz))
    bench.table.energise(0.0)
    bench.table.command_rate(0.0, 60.0)
    k = gyro.frames_until(40.0)
    block = gyro.block(k // 2, k)
    assert block.rate_dps.mean() == pytest.approx(60.0 * 1.05, rel=0.03)
    assert len(block.good) == k - k // 2


@pytest.mark.parametrize(("arw_deg_sqrt_h", "response"), [(0.0, 0.0), (0.05, 0.9)])
def test_noise_fills_the_dead_band(arw_deg_sqrt_h, response):
    """A quiet gyro answers to nothing within ± 5 deg/h; noise of 30 deg/h a frame makes it answer nearly in full."""
    curves = replace(gyro_class("high_end").curves, dead_band_dph=5.0, bias_polynomial=())
    parameters = replace(BARE, model="curves", curves=curves, noise=replace(NO_NOISE, arw_deg_sqrt_h=arw_deg_sqrt_h))
    found = [
        Bench().gyro(parameters, earth_dps=rate_dph / 3600.0).block(0, 400_000).rate_dps.mean() * 3600.0
        for rate_dph in (-4.0, 4.0)
    ]
    assert (found[1] - found[0]) / 8.0 == pytest.approx(response, abs=0.1)
