"""The chamber against an independent step-by-step integration of its equations, and against what chambers do."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.parameters import ChamberParameters

QUIET = ChamberParameters(probe_noise_k=0.0, probe_offset_sigma_k=0.0)
HOUR = 3600.0


def integrate(p, setpoint, breaks, times):
    """The chamber's equations with plain clipping of the controller's demand, between the setpoint's breaks."""

    def rhs(t, x):
        air, wall, load, probe, integral = x
        demand = p.controller_gain_w_k * (setpoint(t) - probe) + integral
        coldest = -(p.cooling_power_w + p.cooling_slope_w_k * (air - 25.0))
        power = min(max(demand, coldest), p.heating_power_w)
        into_wall, into_load = p.air_to_wall_w_k * (air - wall), p.air_to_load_w_k * (air - load)
        return [
            (power + p.fan_power_w - into_wall - into_load) / p.air_capacity_j_k,
            (into_wall + p.wall_to_room_w_k * (p.room_degc - wall)) / p.wall_capacity_j_k,
            (into_load + p.dut_power_w) / p.load_capacity_j_k,
            (air - probe) / p.probe_lag_s,
            p.controller_gain_w_k / p.controller_integral_s * (setpoint(t) - probe)
            - (demand - power) / p.controller_tracking_s,
        ]

    x = [p.room_degc] * 4 + [-p.fan_power_w]
    out = np.empty((len(times), 5))
    edges = [0.0, *breaks, times[-1] + 1.0]
    for begin, end in pairwise(edges):
        mine = (times >= begin) & (times < end)
        run = solve_ivp(
            rhs, (begin, end), x, t_eval=np.append(times[mine], end), rtol=1e-8, atol=1e-8, method="LSODA", max_step=20
        )
        out[mine], x = run.y.T[:-1], run.y[:, -1]
    return out


def course(start, *legs):
    """A setpoint made of (time, final, K/s) legs."""

    def at(t):
        value = start
        for index, (begin, final, pace) in enumerate(legs):
            end = legs[index + 1][0] if index + 1 < len(legs) else np.inf
            if t >= begin:
                moved = pace * (min(t, end) - begin)
                value = final if abs(final - value) <= moved else value + np.copysign(moved, final - value)
        return value

    return at


@pytest.mark.parametrize(
    ("changes", "final", "ramp"),
    [({}, -30.0, 1.0), ({}, 90.0, None), ({}, -60.0, None), ({"max_ramp_degc_min": None}, 60.0, None)],
    ids=["ramp", "heat", "cool", "jump"],
)
def test_agrees_with_numerical_integration(changes, final, ramp):
    p = dataclasses.replace(QUIET, **changes)
    chamber = ChamberPlant(p, seed=1)
    chamber.command(100.0, final, ramp)
    pace = (ramp or p.max_ramp_degc_min or 1e9) / 60.0
    times = np.arange(0.0, 2.5 * HOUR, 20.0)
    ends = 100.0 + abs(final - 25.0) / pace
    expected = integrate(p, course(25.0, (100.0, final, pace)), [100.0, ends], times)
    np.testing.assert_allclose(chamber.states(times)[:, :4], expected[:, :4], atol=2e-4)
    assert chamber.probe_degc(4000.0) == pytest.approx(expected[200, 3], abs=2e-4)


def test_a_command_in_the_middle_of_a_ramp_and_of_saturation_starts_from_the_setpoint_as_it_is():
    chamber = ChamberPlant(QUIET, seed=1)
    chamber.command(0.0, -60.0, None)
    chamber.command(900.0, 80.0, 3.0)
    assert chamber.setpoint_degc(900.0) == pytest.approx(25.0 - 15 * 4.0)
    times = np.arange(0.0, 1.5 * HOUR, 20.0)
    turn_s = 900.0 + 115.0 / 3.0 * 60.0
    setpoint = course(25.0, (0.0, -60.0, 4.0 / 60.0), (900.0, 80.0, 3.0 / 60.0))
    expected = integrate(QUIET, setpoint, [900.0, turn_s], times)
    np.testing.assert_allclose(chamber.states(times)[:, :4], expected[:, :4], atol=2e-4)


def reached_s(chamber, begin_s, value, band):
    t = begin_s + np.arange(0.0, 4 * HOUR, 10.0)
    outside = np.flatnonzero(np.abs(chamber.air_degc(t) - value) > band)
    return t[outside[-1]] - begin_s


def test_reaches_minus_30_and_60_at_1_degree_a_minute_with_overshoot_and_creep():
    chamber = ChamberPlant(QUIET, seed=1)
    for begin, final in ((0.0, -30.0), (4 * HOUR, -25.0), (8 * HOUR, 60.0)):
        before = chamber.final_setpoint_degc
        chamber.command(begin, final, 1.0)
        ramp_s = abs(final - before) * 60.0
        t = begin + np.arange(0.0, 4 * HOUR, 10.0)
        over = np.max((chamber.air_degc(t) - final) * np.sign(final - before))
        assert 0.2 < over < 1.0
        during = chamber.air_degc(t[t < begin + ramp_s])
        setpoint = np.array([chamber.setpoint_degc(x) for x in t[t < begin + ramp_s]])
        assert np.max(np.abs(during - setpoint)) < 1.5
        assert ramp_s < reached_s(chamber, begin, final, 0.1) < ramp_s + 0.75 * HOUR
        air, wall = chamber.states(np.array([begin + ramp_s + 1200.0, begin + ramp_s + 1800.0]))[:, :2].T
        assert abs(air[0] - final) < 0.75
        assert abs(wall[1] - wall[0]) > 0.02  # the wall creeps on after the air has arrived


def test_says_the_truth_when_it_cannot():
    weak = ChamberPlant(dataclasses.replace(QUIET, cooling_power_w=1000.0), seed=1)
    weak.command(0.0, -60.0, None)
    t = np.arange(0.0, 24 * HOUR, 60.0)
    assert -35.0 < weak.air_degc(t).min() < -20.0
    assert weak.power_percent(20 * HOUR) == -100.0
    assert weak.final_setpoint_degc == -60.0
    # Balance: full cooling power = fan + dut + what comes through the wall.
    air, wall = weak.states(np.array([23 * HOUR]))[0, :2]
    assert 1000.0 + 15.0 * (air - 25.0) == pytest.approx(120.0 + 10.0 + 2.0 * (25.0 - wall), abs=0.5)


def test_no_windup_after_a_long_time_at_full_power():
    weak = ChamberPlant(dataclasses.replace(QUIET, heating_power_w=400.0), seed=1)
    weak.command(0.0, 90.0, None)
    assert weak.power_percent(HOUR) == 100.0
    t = np.arange(0.0, 30 * HOUR, 60.0)
    assert weak.air_degc(t).max() < 91.0


@given(st.lists(st.floats(0.0, 6 * HOUR), max_size=6), st.lists(st.floats(0.0, 8 * HOUR), min_size=1, max_size=8))
@settings(max_examples=25, deadline=None)
def test_asking_changes_nothing_and_the_past_can_be_asked_for(asked, late):
    quiet, nosy = ChamberPlant(QUIET, seed=1), ChamberPlant(QUIET, seed=1)
    for begin, final in ((0.0, -10.0), (2 * HOUR, 40.0), (4.5 * HOUR, 35.0)):
        for instant in asked:
            if instant <= begin:
                nosy.states(np.array([instant, instant + HOUR]))
        quiet.command(begin, final, 2.0)
        nosy.command(begin, final, 2.0)
    times = np.array(late)
    one, other = quiet.states(times), nosy.states(np.sort(times))[np.argsort(np.argsort(times))]
    assert one.tobytes() == other.tobytes()


def test_rests_at_room_temperature_until_told():
    chamber = ChamberPlant(QUIET, seed=1)
    np.testing.assert_allclose(chamber.air_degc(np.arange(0.0, 5 * HOUR, 100.0)), 25.0, atol=0.05)
    assert chamber.setpoint_degc(HOUR) == chamber.final_setpoint_degc == 25.0
    assert -100.0 < chamber.power_percent(HOUR) < 0.0  # it cools the fan's heat away


def test_the_probe_lags_and_reads_with_noise_and_a_hidden_offset_that_the_seed_decides():
    loud = ChamberParameters(probe_noise_k=0.02, probe_offset_sigma_k=0.1)
    one, same, other = (ChamberPlant(loud, seed) for seed in (1, 1, 2))
    times = np.arange(0.0, 2000.0, 0.5)
    readings = np.array([one.probe_degc(t) for t in times])
    assert readings.tolist() == [same.probe_degc(t) for t in times]
    assert readings.std() == pytest.approx(0.02, rel=0.1)
    assert readings.mean() - 25.0 == pytest.approx(one.probe_offset_k, abs=0.01)
    assert one.probe_offset_k != other.probe_offset_k
    offsets = [ChamberPlant(loud, seed).probe_offset_k for seed in range(60)]
    assert 0.07 < np.std(offsets) < 0.13
    quiet = ChamberPlant(QUIET, 1)
    quiet.command(0.0, 60.0, 1.0)
    assert quiet.states(np.array([1800.0]))[0, 0] - quiet.probe_degc(1800.0) == pytest.approx(15.0 / 60.0, abs=0.02)


def test_counts_thermal_excursions():
    chamber = ChamberPlant(QUIET, seed=1)
    chamber.command(10.0, 30.0, 1.0)
    chamber.command(20.0, 30.0, 2.0)  # another ramp to the same setpoint is no new excursion
    chamber.command(30.0, 20.0, 1.0)
    assert chamber.excursions(np.array([0.0, 10.0, 29.9, 30.0])).tolist() == [0, 1, 1, 2]
    assert [chamber.direction(n) for n in range(3)] == [0, 1, -1]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ((0.0, -60.1, None), "outside -60 … 90"),
        ((0.0, float("nan"), None), "outside"),
        ((0.0, 0.0, 0.0), "must be above 0"),
        ((-1.0, 0.0, None), "before the last one"),
    ],
)
def test_refuses_what_makes_no_sense(command, message):
    with pytest.raises(ValueError, match=message):
        ChamberPlant(QUIET, seed=1).command(*command)


def test_the_machine_limits_the_ramp():
    chamber = ChamberPlant(QUIET, seed=1)
    chamber.command(0.0, 60.0, 10.0)
    assert chamber.setpoint_degc(60.0) == pytest.approx(29.0)
    assert chamber.limits_degc == (-60.0, 90.0)
