"""Power of a DUT: gaps and cycles, cooling down, warming up, and a turn-on of its own each time."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.gyro_classes import gyro_class
from simulated_hw.physics.gyro_parameters import NoiseParameters, SensorParameters, ThermalParameters
from simulated_hw.physics.parameters import ChamberParameters, TableParameters
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.thermal import ThermalChain, fog_network

HOUR = 3600.0


def switched(*times_s):
    power = PowerHistory()
    for number, at_s in enumerate(times_s):
        power.switch(at_s, on=bool(number % 2))
    return power


def test_gaps_and_cycles():
    power = switched(100.0, 160.0, 300.0)
    assert power.gaps(50.0) == []
    assert power.gaps(120.0) == [(100.0, 160.0)]
    assert power.gaps(1e9) == [(100.0, 160.0), (300.0, inf)]
    assert power.cycles(np.array([0.0, 120.0, 160.0, 500.0])).tolist() == [0, 0, 1, 1]
    assert [power.is_on(t) for t in (0.0, 99.9, 100.0, 159.9, 160.0, 300.0)] == [True, True, False, False, True, False]
    assert PowerHistory().gaps(1e9) == [] and switched(0.0).is_on(0.0) is False


def test_switching_to_what_it_is_changes_nothing_and_time_does_not_go_back():
    power = switched(100.0)
    power.switch(150.0, on=False)
    assert power.commands_s == [100.0]
    with pytest.raises(ValueError, match="before the last time"):
        power.switch(50.0, on=True)


def test_an_unpowered_gyro_cools_down_and_a_powered_one_warms_up_again():
    chamber, thermal, sensor = ChamberPlant(ChamberParameters(), 1), ThermalParameters(), SensorParameters()
    power = switched(2 * HOUR, 4 * HOUR)
    chain = ThermalChain(chamber, fog_network(thermal, sensor), power)
    times = np.arange(0.0, 6 * HOUR, 119.0)
    found = chain.temperatures_degc(times)

    def slopes(t, x):
        heating = thermal.self_heating_k if power.is_on(t) else 0.0
        air = chamber.air_degc(np.array([t]))[0]
        housing, outer, inner, reading = x
        return [
            (air + heating - housing) / thermal.housing_s,
            (housing - outer) / thermal.coil_outer_s,
            (outer - inner) / thermal.coil_inner_s,
            ((outer + inner) / 2 - reading) / sensor.lag_s,
        ]

    expected = solve_ivp(slopes, (0.0, times[-1]), [25.0] * 4, t_eval=times, rtol=1e-7, atol=1e-7, max_step=30.0).y.T
    np.testing.assert_allclose(found, expected, atol=5e-3)
    assert found[-1, 2] - chain.temperatures_degc(np.array([4 * HOUR]))[0, 2] > 2.5


def gyro_with(power, **changes):
    chamber, table = ChamberPlant(ChamberParameters(), 1), TablePlant(TableParameters(), 1)
    quiet = replace(gyro_class("navigation"), noise=NoiseParameters(0.0, 0.0, 0.0, 0.0, 0.0), **changes)
    return GyroUnit(quiet, chamber, table, seed=1, serial="A", power=power)


def bias_dph(gyro, at_s):
    k = gyro.frames_until(at_s)
    return float(gyro.block(k - 100, k).rate_dps.mean()) * 3600.0


def test_every_power_on_has_its_own_turn_on_bias_and_keeps_it():
    cold = replace(gyro_class("navigation").thermal, self_heating_k=0.0)
    sigma = 5.0
    power = switched(*(n * 100.0 for n in range(1, 401)))
    gyro = gyro_with(power, turn_on_bias_sigma_dph=sigma, thermal=cold)
    never = gyro_with(PowerHistory(), turn_on_bias_sigma_dph=0.0, thermal=cold)
    drawn = np.array([bias_dph(gyro, t + 90.0) - bias_dph(never, t + 90.0) for t in range(200, 40_000, 200)])
    assert drawn.std() == pytest.approx(sigma, rel=0.15) and abs(drawn.mean()) < 4 * sigma / np.sqrt(len(drawn))
    early, late = (bias_dph(gyro, t) - bias_dph(never, t) for t in (220.0, 295.0))
    assert early == pytest.approx(late, abs=1e-6)
    assert gyro.rows.turn_on(0)[0] == gyro.rows.turn_on_bias_dph


def test_the_scale_factor_has_a_turn_on_of_its_own_too():
    gyro = gyro_with(PowerHistory(), turn_on_scale_sigma_ppm=50.0)
    ppm = np.array([gyro.rows.turn_on(n)[1] for n in range(1000)])
    assert ppm.std() == pytest.approx(50.0, rel=0.08)
    assert gyro_with(PowerHistory()).rows.turn_on(3)[1] == 0.0


def test_what_was_sent_before_a_switch_does_not_change_by_it():
    power = PowerHistory()
    watched, twin = gyro_with(power), gyro_with(switched(130.0, 200.0))
    end = watched.frames_until(130.0)
    before = watched.block(0, end).rate_dps.copy()
    power.switch(130.0, on=False)
    power.switch(200.0, on=True)
    assert before.tobytes() == twin.block(0, end).rate_dps.tobytes()
    later = slice(watched.frames_until(200.0), watched.frames_until(900.0))
    assert (
        watched.block(later.start, later.stop).rate_dps.tobytes()
        == twin.block(later.start, later.stop).rate_dps.tobytes()
    )
