"""The rate table against step-by-step integration of its servo, and against what its specification form says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from simulated_hw.physics.parameters import TableParameters
from simulated_hw.physics.rate_table import TablePlant

CLEAN = TableParameters(
    rate_gain_sigma_ppm=0.0, angle_error_orders=(), angle_error_arcsec=(), rate_noise_dps=0.0, position_noise_deg=0.0
)


def running(parameters=CLEAN, seed=1):
    table = TablePlant(parameters, seed)
    table.energise(0.0)
    return table


def servo(reference, times, damping=0.7, hz=5.0):
    """θ, ω of the second-order servo following a rate reference, by integration."""
    natural = 2 * np.pi * hz

    def rhs(t, x):
        return [x[1], x[2], natural**2 * (reference(t) - x[1]) - 2 * damping * natural * x[2]]

    run = solve_ivp(rhs, (0.0, times[-1]), [0.0] * 3, t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.01)
    return run.y[0], run.y[1]


@pytest.mark.parametrize("damping", [0.7, 1.0, 1.6])
def test_a_rate_step_agrees_with_numerical_integration(damping):
    parameters = TableParameters(**{**vars(CLEAN), "servo_damping": damping})
    table = running(parameters)
    table.command_rate(1.0, 30.0)
    table.command_rate(1.2, -20.0)  # in the middle of the ramp up
    times = np.arange(0.0, 5.0, 0.01)

    def reference(t):
        if t < 1.2:
            return float(np.clip(100.0 * (t - 1.0), 0.0, 30.0))
        return max(20.0 - 100.0 * (t - 1.2), -20.0)

    angle, rate = servo(reference, times, damping)
    np.testing.assert_allclose([table.true_rate_dps(t) for t in times], rate, atol=1e-5)
    np.testing.assert_allclose(table.mean_rate_dps(times), np.diff(angle) / 0.01, atol=1e-5)


def test_overshoot_and_settling_time_are_those_of_a_good_table():
    table = running()
    table.command_rate(1.0, 10.0)
    t = np.arange(1.0, 6.0, 0.001)
    rate = np.array([table.true_rate_dps(x) for x in t])
    assert 0.01 < rate.max() / 10.0 - 1.0 < 0.05
    settled_s = t[np.flatnonzero(np.abs(rate - 10.0) > 0.001)[-1]] - 1.0
    assert 0.2 < settled_s < 2.0
    assert rate[-1] == 10.0


def test_position_moves_go_the_shortest_way_and_arrive():
    table = running()
    moves = [(1.0, 90.0), (10.0, 350.0), (20.0, 20.0), (30.0, 20.001), (40.0, 200.5)]
    angle = 0.0
    for begin, target in moves:
        table.command_position(begin, target)
        turned = float(np.sum(table.mean_rate_dps(np.array([begin, begin + 9.5])))) * 9.5
        way = (target - angle + 180.0) % 360.0 - 180.0
        assert turned == pytest.approx(way, abs=1e-7)
        assert table.position_deg(begin + 9.5) == pytest.approx(target, abs=2e-4)
        assert table.rate_dps(begin + 9.5) == 0.0
        angle = target
    assert table.mode == "position"


@given(rate=st.floats(-400.0, 400.0), after=st.floats(0.0, 6.0), target=st.floats(-720.0, 720.0))
@settings(max_examples=40, deadline=None)
def test_a_position_move_out_of_any_motion_arrives_without_exceeding_the_limits(rate, after, target):
    table = running()
    table.command_rate(1.0, rate)
    begin = 1.0 + after
    table.command_position(begin, target)
    assert (table.position_deg(begin + 20.0) - target + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=2e-4)
    mean = table.mean_rate_dps(np.arange(begin, begin + 20.0, 0.05))
    assert np.abs(mean).max() < max(abs(rate), 60.0) * 1.06 + 0.5
    assert np.abs(np.diff(mean)).max() / 0.05 < 100.0 * 1.2


def test_coasts_to_rest_when_released_and_is_caught_when_energised():
    table = running()
    table.command_rate(1.0, 90.0)
    table.release(5.0)
    assert table.true_rate_dps(8.0) == pytest.approx(90.0 * np.exp(-1.0), rel=1e-9)
    assert table.mean_rate_dps(np.array([5.0, 200.0]))[0] * 195.0 == pytest.approx(90.0 * 3.0, rel=1e-9)
    assert table.true_rate_dps(200.0) == 0.0
    with pytest.raises(RuntimeError, match="energise it"):
        table.command_rate(6.0, 1.0)
    assert not table.energised
    table.energise(8.0)
    assert table.true_rate_dps(12.0) == 0.0
    assert table.mean_rate_dps(np.array([8.0, 12.0]))[0] > 0.0


def ripple_table(order):
    table = TablePlant(
        TableParameters(**{**vars(CLEAN), "angle_error_orders": (order,), "angle_error_arcsec": (1.0,)}), seed=3
    )
    table.energise(0.0)
    table.command_rate(0.0, 10.0)
    return table


@pytest.mark.parametrize(
    ("order", "window_deg", "ppm"), [(1, 360, 0), (1, 10, 4.8), (36, 360, 0), (36, 10, 0), (36, 1, 172)]
)
def test_one_angle_error_spectrum_gives_the_rate_non_uniformity_of_every_window(order, window_deg, ppm):
    starts = np.linspace(10.0, 46.0, 361)
    table = ripple_table(order)
    means = [table.mean_rate_dps(np.array([t, t + window_deg / 10.0]))[0] for t in starts]
    assert np.abs(np.array(means) / 10.0 - 1.0).max() * 1e6 == pytest.approx(ppm, rel=0.02, abs=0.01)


def test_turns_too_fast_by_a_gain_error_that_its_readback_cannot_show():
    parameters = TableParameters(**{**vars(CLEAN), "rate_gain_sigma_ppm": 50.0})
    table = running(parameters, seed=4)
    table.command_rate(0.0, 100.0)
    assert abs(table.rate_gain_ppm) > 1.0
    assert table.true_rate_dps(20.0) == pytest.approx(100.0 * (1 + 1e-6 * table.rate_gain_ppm), rel=1e-12)
    assert table.rate_dps(20.0) == pytest.approx(100.0, abs=1e-9)
    assert 35.0 < np.std([TablePlant(parameters, seed).rate_gain_ppm for seed in range(80)]) < 65.0


def test_readbacks_have_noise_and_resolution_and_do_not_depend_on_the_order_of_asking():
    parameters = TableParameters(rate_gain_sigma_ppm=0.0, angle_error_orders=(), angle_error_arcsec=())
    table, other = running(parameters), running(parameters)
    for plant in (table, other):
        plant.command_rate(0.0, 50.0)
    times = np.arange(10.0, 30.0, 0.01)
    rates = np.array([table.rate_dps(t) for t in times])
    angles = np.array([table.position_deg(t) for t in times])
    assert rates.std() == pytest.approx(5e-4, rel=0.1)
    assert np.abs(rates * 1e4 - np.round(rates * 1e4)).max() < 1e-6
    assert angles.min() >= 0.0
    assert angles.max() < 360.0
    assert [other.rate_dps(t) for t in times[::-1]][::-1] == rates.tolist()


@given(
    st.lists(st.tuples(st.floats(0.05, 8.0), st.floats(-200.0, 200.0)), min_size=1, max_size=5),
    st.sampled_from([0.01, 1.0 / (100.0 * (1 + 8e-6)), 0.003, 0.6]),
)
@settings(max_examples=30, deadline=None)
def test_frames_are_the_mean_rates_between_their_edges(commands, frame_s):
    table = running(TableParameters())
    at = 0.0
    for wait, rate in commands:
        at += wait
        table.command_rate(at, rate)
    table.command_position(at + 3.0, 10.0)
    columns = max(1, round(1 / frame_s))
    first = 3 * columns
    rows = int((at + 12.0) / (columns * frame_s))
    frames = table.mean_rate_of_frames(first, rows, columns, frame_s)
    edges = np.arange(first, first + rows * columns + 1) * frame_s
    np.testing.assert_allclose(frames, table.mean_rate_dps(edges), rtol=0.0, atol=2e-8)


def test_late_frames_do_not_see_later_commands():
    table, told = running(TableParameters()), running(TableParameters())
    for plant in (table, told):
        plant.command_rate(1.0, 40.0)
    before = table.mean_rate_of_frames(0, 20, 100, 0.01)
    told.command_rate(10.005, -80.0)
    after = told.mean_rate_of_frames(0, 20, 100, 0.01)
    assert before[:1000].tobytes() == after[:1000].tobytes()
    assert not np.allclose(before[1000:], after[1000:])


@pytest.mark.parametrize(
    ("order", "message"),
    [
        (lambda t: t.command_rate(1.0, 400.1), "beyond ±400"),
        (lambda t: t.command_rate(1.0, float("nan")), "beyond"),
        (lambda t: t.command_position(1.0, float("inf")), "not a finite angle"),
        (lambda t: t.set_acceleration(0.0), "must be above 0, at most 500"),
        (lambda t: t.set_acceleration(501.0), "must be above 0, at most 500"),
        (lambda t: t.command_rate(-1.0, 1.0), "before the last one"),
    ],
)
def test_refuses_what_makes_no_sense(order, message):
    with pytest.raises(ValueError, match=message):
        order(running())


def test_the_acceleration_limit_holds_for_later_commands():
    table = running()
    table.set_acceleration(10.0)
    table.command_rate(0.0, 100.0)
    assert table.true_rate_dps(5.0) == pytest.approx(50.0, abs=1.0)
    assert (table.max_rate_dps, table.max_acceleration_dps2) == (400.0, 500.0)
