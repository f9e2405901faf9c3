"""The units of the `rlg` and `bp` experiments have the published noise and the published drift over their cycles."""

import numpy as np
import pytest
from scipy.signal import lfilter

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro_classes import GYRO_CLASSES, gyro_class
from simulated_hw.physics.parameters import ChamberParameters, SiteParameters, TableParameters
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.seeker import gyro_unit

HOUR = 3600.0
SITE = SiteParameters(latitude_deg=40.0)
MEAN_S = 100.0
# The published standard deviations of 100 s means in the first dwell, deg/h.
RLG_DPH = {"rlg_a": 0.0052, "rlg_b": 0.0044, "rlg_c": 0.0056}
# Rows of the first dwell of the `rlg` cycle, the warming up left out.
SETTLED = slice(36, 90)


def slow_cycle(chamber):
    """25 degC for 2.5 h, 1 degC/min to -30, 2.5 h, back, 2.5 h: 9.33 h, 336 rows of 100 s."""
    chamber.command(2.5 * HOUR, -30.0, 1.0)
    chamber.command(5.0 * HOUR + 3300.0, 25.0, 1.0)
    return 0.0, 336


def stepped_cycle(chamber):
    """From room temperature to 60 degC, down to -40 and up again by 20 degC, 0.4 degC/min, 30 min each."""
    at_s, before = 2.5 * HOUR, 25.0
    for setpoint in (60.0, 40.0, 20.0, 0.0, -20.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0):
        chamber.command(at_s, setpoint, 0.4)
        at_s += abs(setpoint - before) / 0.4 * 60.0 + 1800.0
        before = setpoint
    return 2.5 * HOUR, int((at_s - 2.5 * HOUR) // MEAN_S)


def no_cycle(chamber):
    return 3 * HOUR, 300


def means(name, cycle, seed=1, room_degc=25.0):
    """100 s means: bias in deg/h (n,), temperatures (n, sensors)."""
    parameters = gyro_class(name)
    chamber = ChamberPlant(ChamberParameters(room_degc=room_degc), seed)
    table = TablePlant(TableParameters(), seed)
    gyro = gyro_unit(parameters, chamber, table, seed=seed, serial=name, site=SITE)
    begin_s, count = cycle(chamber)
    frames = round(MEAN_S * parameters.data_rate_hz)
    first = gyro.frames_until(begin_s)
    rows = []
    for at in range(first, first + count * frames, frames):
        block = gyro.block(at, at + frames)
        columns = [block.rate_dps, block.temperature_degc, *block.channels.values()]
        rows.append([column.mean() for column in columns])
    table_of = np.array(rows)
    return table_of[:, 0] * 3600.0 - 15.041067 * np.sin(np.radians(40.0)), table_of[:, 1:]


def quadratic(temperatures):
    z = (temperatures - 0.0) / 30.0
    pairs = [z[:, i] * z[:, j] for i in range(z.shape[1]) for j in range(i, z.shape[1])]
    return np.stack([np.ones(len(z)), *z.T, *pairs], axis=1)


def residual(features, target):
    return target - features @ np.linalg.lstsq(features, target, rcond=None)[0]


@pytest.mark.parametrize("name", RLG_DPH)
def test_ring_lasers_are_those_of_the_experiment(name):
    bias, felt = means(name, slow_cycle)
    other, other_felt = means(name, slow_cycle, seed=2)
    assert len(bias) == 336
    floors = [cycle[SETTLED].std() for cycle in (bias, other)]
    assert np.mean(floors) == pytest.approx(RLG_DPH[name], rel=0.15)
    assert bias.std() == pytest.approx(0.03, rel=0.15)
    # three temperatures tell all but a linear law does not: the nominal 0.01 deg/h are reached by a curved one only
    three = slice(1, 4)
    assert residual(np.column_stack([np.ones(336), felt[:, three]]), bias).std() > 0.01
    weights = np.linalg.lstsq(quadratic(felt[:, three]), bias, rcond=None)[0]
    left = other - quadratic(other_felt[:, three]) @ weights
    assert left.std() < 1.15 * RLG_DPH[name]
    assert abs(left.mean()) < 0.01


def test_the_case_is_the_frames_temperature():
    _, felt = means("rlg_a", no_cycle)
    assert (felt[:, 0] == felt[:, 1]).all()
    settled = felt[-1]
    r = gyro_class("rlg_a").ring_laser
    assert settled[2] - settled[1] == pytest.approx(r.anode_heating_k, abs=0.05)
    assert settled[3] - settled[1] == pytest.approx(r.cathode_heating_k, abs=0.05)


def lag_bank(temperature):
    """Chebyshev polynomials of the temperature, and its distance from its own past at four ages."""
    columns = [np.polynomial.chebyshev.chebvander((temperature - 10.0) / 60.0, 4)]
    for age in (2, 5, 10, 20):
        keep = np.exp(-1.0 / age)
        past = lfilter([1 - keep], [1, -keep], temperature, zi=[keep * temperature[0]])[0]
        columns.append((temperature - past)[:, None])
    return np.concatenate(columns, axis=1)


def test_the_stepped_cycle_gyro_is_that_of_the_experiment():
    room, _ = means("bp", no_cycle)
    assert room.std() == pytest.approx(0.011, rel=0.12)
    bias, felt = means("bp", stepped_cycle, room_degc=23.0)
    other, other_felt = means("bp", stepped_cycle, seed=2, room_degc=26.0)
    assert bias.std() == pytest.approx(0.09, rel=0.06)
    assert other.std() == pytest.approx(0.09, rel=0.06)
    # temperature and its rate do not tell all, its history does: what the published models lack is state
    now = np.column_stack([np.polynomial.chebyshev.chebvander(felt[:, 0] / 70.0, 4), np.gradient(felt[:, 0])])
    assert residual(now, bias).std() > 1.8 * 0.011
    weights = np.linalg.lstsq(lag_bank(felt[:, 0]), bias, rcond=None)[0]
    left = (other - lag_bank(other_felt[:, 0]) @ weights)[10:]
    assert left.std() < 1.15 * 0.011


def test_an_unknown_class_lists_those_there_are():
    with pytest.raises(ValueError, match=r"no gyro class 'rlg'; there are ts_a, .*rlg_a, .*north"):
        gyro_class("rlg")
    assert gyro_class("north").noise.bias_instability_dph == 0.0196
    assert list(GYRO_CLASSES)[:2] == ["ts_a", "ts_b"]
