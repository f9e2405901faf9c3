"""What level axes feel, against vectors in east, north, up and against fine integration over a frame."""

import numpy as np
import pytest

from simulated_hw.physics.axes import (
    EARTH_RATE_DPS,
    LevelAxis,
    Tilt,
    VerticalAxis,
    earth_rate_dps,
    level_earth_rate_dps,
    tilt_of,
)
from simulated_hw.physics.parameters import TableParameters
from simulated_hw.physics.rate_table import TablePlant

EXACT_TABLE = TableParameters(rate_gain_sigma_ppm=0.0, angle_error_orders=(), angle_error_arcsec=())
LEVEL = Tilt(0.0, 0.0)
FRAME_S = 0.01


def table_at(position_deg, parameters=EXACT_TABLE):
    table = TablePlant(parameters, seed=1)
    table.energise(0.0)
    table.command_position(0.0, position_deg)
    return table


def felt_by_vectors(azimuth_deg, rise, lean, lean_azimuth_deg, latitude_deg):
    """Earth rate and gravity along an axis of a table that leans, by rotating vectors (Rodrigues)."""
    a, toward = np.radians(azimuth_deg), np.radians(lean_azimuth_deg)
    flat = np.array([np.cos(rise) * np.sin(a), np.cos(rise) * np.cos(a), np.sin(rise)])
    # the up axis goes over to the azimuth `toward`: a turn about the level axis 90 deg to its left
    axis = np.array([-np.cos(toward), np.sin(toward), 0.0])
    turned = flat * np.cos(lean) + np.cross(axis, flat) * np.sin(lean) + axis * (axis @ flat) * (1 - np.cos(lean))
    earth = EARTH_RATE_DPS * np.array([0.0, np.cos(np.radians(latitude_deg)), np.sin(np.radians(latitude_deg))])
    return turned @ earth, turned[2]


@pytest.mark.parametrize("position_deg", [0.0, 47.0, 180.0, 305.0])
@pytest.mark.parametrize("azimuth_deg", [0.0, 35.0, -90.0])
def test_a_still_level_axis_feels_the_earth_and_gravity_as_vectors_say(position_deg, azimuth_deg):
    table = table_at(position_deg)
    axis = LevelAxis(table, 40.0, azimuth_deg, 300.0, tilt_of(200.0, 70.0))
    frames = 10_000, 4, 100, FRAME_S
    rise, lean = np.radians(300.0 / 3600.0), np.radians(200.0 / 3600.0)
    rate_dps, pull_g = felt_by_vectors(azimuth_deg - position_deg, rise, lean, 70.0, 40.0)
    assert axis.mean_rate_of_frames(*frames) == pytest.approx(np.full(400, rate_dps), abs=1e-5 * EARTH_RATE_DPS)
    assert axis.mean_pull_of_frames(*frames) == pytest.approx(np.full(400, pull_g), abs=1e-8)
    now = np.array([100.0, 200.0])
    assert axis.rate_dps(now) == pytest.approx([rate_dps] * 2, abs=1e-5 * EARTH_RATE_DPS)
    assert axis.azimuth_deg(now) == pytest.approx([(azimuth_deg - position_deg) % 360.0] * 2, abs=1e-9)


def test_components_of_the_earths_rotation():
    assert level_earth_rate_dps(None) == earth_rate_dps(None) == 0.0
    assert np.hypot(level_earth_rate_dps(40.0), earth_rate_dps(40.0)) == pytest.approx(EARTH_RATE_DPS)
    assert level_earth_rate_dps(90.0) == pytest.approx(0.0, abs=1e-18)
    axis = VerticalAxis(table_at(0.0), 0.003)
    assert (axis.mean_rate_of_frames(10_000, 1, 100, FRAME_S) == 0.003).all()


def integrated(axis, table, frame, frame_s):
    times = (frame + (np.arange(2000) + 0.5) / 2000) * frame_s
    azimuth = np.radians(axis.azimuth_deg(times))
    return level_earth_rate_dps(40.0) * np.cos(azimuth).mean()


@pytest.mark.parametrize("parameters", [EXACT_TABLE, TableParameters()], ids=["exact", "usual"])
def test_frames_of_a_turning_axis_are_means_over_the_frame(parameters):
    """At a constant rate exactly, at changing rates to a hundred thousandth of the earth's rate."""
    table = TablePlant(parameters, seed=1)
    table.energise(0.0)
    table.command_rate(1.0, 50.0)
    axis = LevelAxis(table, 40.0, 12.0, 0.0, LEVEL)
    for first, tolerance in ((100, 1e-5), (120, 1e-5), (2000, 1e-8)):
        frames = axis.mean_rate_of_frames(first, 1, 10, 0.05)
        expected = [integrated(axis, table, k, 0.05) for k in range(first, first + 10)]
        # ripple of the table moves the angle within a frame by less than an arcsec
        slack = tolerance if parameters is EXACT_TABLE else max(tolerance, 1e-5)
        assert frames == pytest.approx(expected, abs=slack * EARTH_RATE_DPS)


def test_a_rise_leaks_the_tables_rate_and_nothing_else_does():
    table = TablePlant(EXACT_TABLE, seed=1)
    table.energise(0.0)
    table.command_rate(0.0, 30.0)
    flat, risen = (LevelAxis(table, 40.0, 12.0, rise, LEVEL) for rise in (0.0, 100.0))
    extra = risen.mean_rate_of_frames(5000, 1, 100, FRAME_S) - flat.mean_rate_of_frames(5000, 1, 100, FRAME_S)
    rise = np.radians(100.0 / 3600.0)
    assert extra == pytest.approx(np.full(100, (30.0 + earth_rate_dps(40.0)) * rise), rel=1e-6)


def test_angles_are_the_integral_of_the_mean_rate():
    table = TablePlant(TableParameters(), seed=3)
    table.energise(0.0)
    for at_s, rate_dps in ((1.0, 40.0), (3.3, -20.0), (7.0, 0.0)):
        table.command_rate(at_s, rate_dps)
    edges = np.arange(0.0, 12.0, 0.07)
    turned = np.diff(table.angles_deg(edges))
    assert (turned + 180.0) % 360.0 - 180.0 == pytest.approx(table.mean_rate_dps(edges) * np.diff(edges), abs=1e-9)
