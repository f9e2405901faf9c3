"""North seeking against rotation matrices, the figures of the notes, and simulated seekings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fitting.north import (
    Level,
    Smoothing,
    compare_smoothing,
    four_position_heading_deg,
    heading_deg,
    heading_error_mil,
    heading_u_deg,
    two_position_heading_deg,
    two_position_one_gyro,
)

LATITUDE = 39.9
EARTH_DPH = 15.041067 * np.array([0.0, np.cos(np.radians(LATITUDE)), np.sin(np.radians(LATITUDE))])  # east north up


def body(heading: float, tilt_x: float = 0.0, tilt_y: float = 0.0) -> NDArray[np.float64]:
    """Rows: x, y, z of a body in east-north-up; tilted about its own x and y, then turned to a heading."""
    level = Rotation.from_euler("z", 90.0 - heading, degrees=True)
    return np.asarray((level * Rotation.from_euler("xy", [tilt_x, tilt_y], degrees=True)).as_matrix().T)


def true_heading(axes: NDArray[np.float64]) -> float:
    """Azimuth of the horizontal projection of x."""
    return float(np.degrees(np.arctan2(axes[0, 0], axes[0, 1])) % 360.0)


angles = st.floats(0.0, 359.9)
tilts = st.floats(-10.0, 10.0)


@given(angles, tilts, tilts)
def test_heading_of_a_tilted_body(heading: float, tilt_x: float, tilt_y: float) -> None:
    axes = body(heading, tilt_x, tilt_y)
    rates, up = axes @ EARTH_DPH, axes[:, 2]
    found = heading_deg(rates[0], rates[1], LATITUDE, Level(up[0], up[1]))
    assert heading_error_mil(found, true_heading(axes), 360.0) == pytest.approx(0.0, abs=1e-4)


@given(angles, tilts, tilts)
def test_two_positions_cancel_the_biases_of_gyros_and_accelerometers(
    heading: float, tilt_x: float, tilt_y: float
) -> None:
    axes = body(heading, tilt_x, tilt_y)
    turned = np.diag([-1.0, -1.0, 1.0]) @ axes
    rates = np.array([a @ EARTH_DPH for a in (axes, turned)]) + np.array([3.0, -2.0, 0.0])
    up = np.array([a[:, 2] for a in (axes, turned)]) + np.array([0.01, -0.02, 0.0])
    half = 0.5 * (up[0] - up[1])
    found = two_position_heading_deg(rates[:, 0], rates[:, 1], LATITUDE, Level(half[0], half[1]))
    assert heading_error_mil(found, true_heading(axes), 360.0) == pytest.approx(0.0, abs=1e-4)


@given(angles, st.booleans(), st.floats(10.0, 60.0))
def test_four_positions_need_neither_latitude_nor_bias_nor_scale(
    heading: float, clockwise: bool, latitude: float
) -> None:
    steps = (1.0 if clockwise else -1.0) * np.array([0.0, 90.0, 180.0, 270.0])
    rates = 1.03 * (EARTH_DPH[1] * np.cos(np.radians(heading + steps)) + 7.0)
    found = four_position_heading_deg(rates, latitude, clockwise=clockwise)
    assert heading_error_mil(found, heading) == pytest.approx(0.0, abs=1e-9)
    formula = np.degrees(np.arctan2((-1.0 if clockwise else 1.0) * (rates[1] - rates[3]), rates[0] - rates[2]))
    assert heading_error_mil(found, formula) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("heading", [20.0, 90.0, 160.0])
def test_one_gyro_in_two_positions(heading: float) -> None:
    horizontal = EARTH_DPH[1]
    signal = horizontal * np.cos(np.radians(heading))
    found = two_position_one_gyro(0.4 + signal, 0.4 - signal, LATITUDE)
    assert found.heading_deg == pytest.approx(heading, abs=1e-4)
    assert found.bias_dph == pytest.approx(0.4)
    assert found.slope_deg_per_dph == pytest.approx(
        np.degrees(1.0 / (horizontal * np.sin(np.radians(heading)))), rel=1e-5
    )


def test_one_gyro_worst_pointing_north() -> None:
    assert two_position_one_gyro(11.5389, -11.5389, LATITUDE).slope_deg_per_dph > 500.0
    with pytest.raises(ValueError, match="use two gyros"):
        two_position_one_gyro(12.0, -12.0, LATITUDE)


def test_an_uncorrected_tilt_costs_tilt_times_tan_latitude() -> None:
    """Section 9: d(psi) is about theta tan(lat) for a body pointing east and tilted about its y axis."""
    tilt = 0.1
    errors = [
        abs(float(heading_error_mil(heading_deg(*(axes @ EARTH_DPH)[:2], LATITUDE), true_heading(axes), 360.0)))
        for axes in (body(psi, tilt, 0.0) for psi in np.arange(0.0, 360.0, 15.0))
    ]
    assert max(errors) == pytest.approx(tilt * np.tan(np.radians(LATITUDE)), rel=0.01)


@pytest.mark.parametrize(("arw", "seconds", "arcmin"), [(0.005, 100.0, 6.3), (0.005, 300.0, 3.7), (0.001, 100.0, 1.3)])
def test_noise_of_a_heading(arw: float, seconds: float, arcmin: float) -> None:
    sigma = 60.0 * arw / seconds**0.5
    assert 60.0 * heading_u_deg(sigma, 40.0) == pytest.approx(arcmin, abs=0.06)
    rng = np.random.default_rng(0)
    h = EARTH_DPH[1]
    x, y = h * np.cos(0.7), h * np.sin(0.7)
    noise = sigma * rng.standard_normal((2, 2, 20_000))
    found = two_position_heading_deg(np.array([[x], [-x]]) + noise[0], np.array([[y], [-y]]) + noise[1], LATITUDE)
    assert found.std() == pytest.approx(heading_u_deg(sigma, LATITUDE), rel=0.03)


def test_mil_of_both_circles_the_short_way_round() -> None:
    assert heading_error_mil(359.9, 0.2) == pytest.approx(-0.3 * 6000.0 / 360.0)
    assert heading_error_mil(0.2, 359.9, 6400.0) == pytest.approx(0.3 * 6400.0 / 360.0)


def seekings(count: int, n: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Records (count, 2, 4, n) at 1 Hz with white noise, N = 0.005 deg/sqrt(h), 20 ug; and the true headings."""
    rng = np.random.default_rng(seed)
    headings = rng.uniform(0.0, 360.0, count)
    records = np.empty((count, 2, 4, n))
    truth = np.empty(count)
    for i, heading in enumerate(headings):
        axes = body(float(heading), *rng.uniform(-0.2, 0.2, 2))
        truth[i] = true_heading(axes)
        for position, sign in enumerate((1.0, -1.0)):
            turned = np.diag([sign, sign, 1.0]) @ axes
            level = [*(turned @ EARTH_DPH)[:2], *turned[:2, 2]]
            records[i, position] = (np.array(level) + np.array([0.5, -0.3, 1e-4, 2e-4]))[:, np.newaxis]
    sigma = np.array([0.3, 0.3, 20e-6, 20e-6])
    records += sigma[:, np.newaxis] * rng.standard_normal(records.shape)
    return records, truth


def test_plain_means_reach_what_their_noise_allows() -> None:
    records, truth = seekings(60, 200, 1)
    found = compare_smoothing(records, truth, LATITUDE, Smoothing(1.0, [0.01, 0.01, 1e-6, 1e-6], fit_s=30.0))
    expected = heading_u_deg(0.3 / 200**0.5, LATITUDE) * 6000.0 / 360.0
    assert found.rms_before_mil == pytest.approx(expected, rel=0.25)


def test_smoothing_with_a_small_r_changes_nothing() -> None:
    """R far below the noise of a sample: the filter believes every sample, and the mean stays what it was."""
    records, truth = seekings(30, 200, 2)
    found = compare_smoothing(records, truth, LATITUDE, Smoothing(1.0, [1e-4, 1e-4, 1e-8, 1e-8]))
    assert found.after_mil == pytest.approx(found.before_mil, abs=0.03 * found.rms_before_mil)
    assert "does not change" in found.verdict


def test_smoothing_that_clings_to_the_first_30_s_worsens_the_mean() -> None:
    records, truth = seekings(60, 300, 3)
    found = compare_smoothing(records, truth, LATITUDE, Smoothing(1.0, [3.0, 3.0, 2e-4, 2e-4]))
    assert found.rms_after_mil > 1.05 * found.rms_before_mil
    assert found.change_mil2 > 2.0 * found.change_u_mil2 and "worsens" in found.verdict
    assert "6000 mil" in found.verdict


def test_the_verdict_follows_the_paired_difference() -> None:
    records, truth = seekings(20, 100, 4)
    found = compare_smoothing(records, truth, LATITUDE, Smoothing(1.0, [0.3, 0.3, 2e-5, 2e-5]), 6400.0)
    change = found.after_mil**2 - found.before_mil**2
    assert found.change_mil2 == pytest.approx(change.mean())
    assert found.change_u_mil2 == pytest.approx(change.std(ddof=1) / 20**0.5)
    assert "6400 mil" in found.verdict


def test_records_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="2 positions, 4 sensors"):
        compare_smoothing(np.zeros((3, 4, 2, 100)), np.zeros(3), LATITUDE, Smoothing(1.0, [1.0] * 4))
