"""The north seeker: what two positions tell of its azimuth, and that no frame depends on who looked when."""

from dataclasses import replace

import numpy as np
import pytest

from simulated_hw.physics.axes import level_earth_rate_dps
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro_classes import gyro_class
from simulated_hw.physics.gyro_parameters import NoiseParameters
from simulated_hw.physics.parameters import ChamberParameters, SiteParameters, TableParameters
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.seeker import gyro_unit

SEEKER = gyro_class("north")
STILL = replace(SEEKER.seeker.accelerometer, noise_ug_sqrt_hz=0.0, instability_ug=0.0, lsb_ug=0.0)
QUIET = replace(
    SEEKER,
    noise=NoiseParameters(0.0, 0.0, 0.0, 0.0, 0.0),
    seeker=replace(SEEKER.seeker, accelerometer=STILL),
)
CHANNELS = ("rate_y_dps", "accel_x_g", "accel_y_g")
SITE = SiteParameters(latitude_deg=40.0, azimuth_deg=35.0)
READY_S = 4 * 3600.0


class Bench:
    """A table with a seeker on it, in a room."""

    def __init__(self, parameters=SEEKER, seed=1, serial="N"):
        self.chamber, self.table = ChamberPlant(ChamberParameters(), seed), TablePlant(TableParameters(), seed)
        self.seeker = self.unit(parameters, seed, serial)
        self.table.energise(0.0)

    def unit(self, parameters=SEEKER, seed=1, serial="N"):
        return gyro_unit(parameters, self.chamber, self.table, seed=seed, serial=serial, site=SITE)

    def measured(self, at_s, position_deg, lasting_s):
        self.table.command_position(at_s, position_deg)
        first = self.seeker.frames_until(at_s + 30.0)
        end = self.seeker.frames_until(at_s + 30.0 + lasting_s)
        block = self.seeker.block(first, end)
        return np.array([block.rate_dps.mean(), *(block.channels[name].mean() for name in CHANNELS)])


def sought_deg(bench, at_s, lasting_s):
    """Two positions: half the difference is free of bias, and the two gyros' give the azimuth."""
    first, second = bench.measured(at_s, 0.0, lasting_s), bench.measured(at_s + lasting_s + 30.0, 180.0, lasting_s)
    north, east = (first - second)[:2] / 2.0
    return float(np.degrees(np.arctan2(east, north)))


def test_two_positions_find_the_azimuth():
    upright = replace(QUIET, seeker=replace(QUIET.seeker, table_tilt_arcsec=0.0))
    assert sought_deg(Bench(upright), READY_S, 20.0) == pytest.approx(35.0, abs=2e-3)
    bench = Bench(QUIET)
    # a table that leans east makes the vertical earth rate look like an east one: lean x tan(latitude)
    off_deg = 20.0 / 3600.0 * np.sin(np.radians(70.0)) * np.tan(np.radians(40.0))
    assert abs(sought_deg(bench, READY_S, 20.0) - 35.0) == pytest.approx(off_deg, abs=2e-3)
    truth = bench.seeker.truth(np.array([READY_S + 25.0, READY_S + 90.0]))
    assert truth["azimuth_deg"] == pytest.approx([35.0, 215.0], abs=1e-3)
    assert truth["input_rate_dps"][0] == pytest.approx(level_earth_rate_dps(40.0) * np.cos(np.radians(35.0)), rel=1e-3)


def test_accelerometers_see_the_tilt_of_table_and_mounting():
    bench = Bench(QUIET)
    first, second = bench.measured(READY_S, 0.0, 20.0), bench.measured(READY_S + 60.0, 180.0, 20.0)
    arcsec = np.degrees(1.0) * 3600.0
    lean_x, lean_y = (first - second)[2:] / 2.0 * arcsec
    # leaning 20 arcsec to azimuth 70: x looks 35 deg beside it, y, to the left of x, 125 deg
    assert lean_x == pytest.approx(-20.0 * np.cos(np.radians(35.0 - 70.0)), abs=0.05)
    assert lean_y == pytest.approx(-20.0 * np.cos(np.radians(-55.0 - 70.0)), abs=0.05)


def test_seeking_errs_by_what_the_gyros_noise_makes_of_it():
    """The published unit errs by 1.8 mil (6000 to the circle); of that order, around zero, and new each time."""
    bench = Bench()
    errors = np.array([sought_deg(bench, READY_S + n * 320.0, 120.0) - 35.0 for n in range(40)]) / 360.0 * 6000.0
    assert 0.8 < np.sqrt(np.mean(errors**2)) < 2.5
    assert abs(errors.mean()) < 4.0 * errors.std() / np.sqrt(len(errors))


def test_no_channel_depends_on_who_looked_when():
    watched, left_alone = Bench(), Bench()
    parts = {name: [] for name in CHANNELS}
    read = 0
    for at_s in (30.0, 77.7, 100.0, 260.0):
        end = watched.seeker.frames_until(at_s)
        block = watched.seeker.block(read, end)
        for name in CHANNELS:
            parts[name].append(block.channels[name])
        read = end
        for bench in (watched, left_alone):
            bench.table.command_position(at_s, at_s)
    whole = left_alone.seeker.block(0, read)
    for name in CHANNELS:
        assert np.concatenate(parts[name]).tobytes() == whole.channels[name].tobytes()


def test_its_sensors_have_noise_of_their_own_and_another_dut_changes_nothing():
    bench = Bench()
    other = bench.unit(serial="other").block(0, 20_000)
    block = bench.seeker.block(0, 20_000)
    alone = Bench().seeker.block(0, 20_000)
    assert all(block.channels[name].tobytes() == alone.channels[name].tobytes() for name in CHANNELS)
    noises = [
        block.rate_dps,
        *(block.channels[name] for name in CHANNELS),
        other.rate_dps,
        other.channels["rate_y_dps"],
    ]
    correlation = np.corrcoef([np.diff(noise) for noise in noises])
    assert np.abs(correlation - np.eye(6)).max() < 0.05


def test_hidden_azimuth_and_bias_of_y():
    drawn = [
        gyro_unit(
            replace(QUIET, seeker=replace(QUIET.seeker, azimuth_sigma_deg=10.0)),
            ChamberPlant(ChamberParameters(), 1),
            TablePlant(TableParameters(), 1),
            seed=seed,
            serial="N",
            site=SiteParameters(azimuth_deg=180.0),
        )
        for seed in range(100)
    ]
    azimuths = [unit.truth(np.array([10.0]))["azimuth_deg"][0] for unit in drawn]
    assert np.std(azimuths) == pytest.approx(10.0, rel=0.25)
    block = drawn[0].block(0, 100)
    turn_on = drawn[0].companion.hidden()["turn_on_bias_y_dph"] - drawn[0].rows.turn_on_bias_dph
    difference_dph = (block.channels["rate_y_dps"] - block.rate_dps).mean() * 3600.0
    assert difference_dph == pytest.approx(QUIET.seeker.bias_y_dph + turn_on, abs=1e-6)
    assert block.good.all()
