"""Threshold, resolution and dead zone by the 50 % criterion."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.metrics.small_rates import dead_zone, dwell_s, resolution, threshold

APPLIED = np.array([-0.5, -0.2, -0.1, -0.05, -0.02, 0.0, 0.02, 0.05, 0.1, 0.2, 0.5])


def gyro(rate: NDArray[np.float64], below: float, above: float) -> NDArray[np.float64]:
    """Silent between below and above, right outside."""
    return np.where((rate > below) & (rate < above), 0.0, rate)


def test_the_worse_direction_counts() -> None:
    figure = threshold(APPLIED, gyro(APPLIED, -0.06, 0.03), 0.002)
    assert figure.value == 0.1 and figure.low == 0.05
    assert figure.u == pytest.approx(0.05 / 12**0.5)


def test_half_of_the_expected_change_is_enough() -> None:
    assert threshold(APPLIED, 0.5 * APPLIED, 0.002).value == 0.02
    with pytest.raises(ValueError, match="larger rates"):
        threshold(APPLIED, 0.49 * APPLIED, 0.002)


def test_a_hole_above_a_felt_rate_counts() -> None:
    response = APPLIED.copy()
    response[APPLIED == 0.1] = 0.0
    assert threshold(APPLIED, response, 0.002).value == 0.2


def test_resolution_is_about_a_rate() -> None:
    figure = resolution(APPLIED, gyro(APPLIED, -0.01, 0.03), 0.002, 9.6)
    assert figure.value == 0.05 and figure.name == "resolution" and "9.6 deg/h" in figure.definition


def test_dead_zone_is_the_width_of_silence() -> None:
    figure = dead_zone(APPLIED, gyro(APPLIED, -0.06, 0.03), 0.002)
    assert figure.value == pytest.approx(0.05 + 0.02)
    assert (figure.low, figure.high) == pytest.approx((0.07, 0.15))
    assert dead_zone(APPLIED, APPLIED, 0.002).value == 0.0
    with pytest.raises(ValueError, match="one direction"):
        dead_zone([0.1, 0.2, 0.3], [0.1, 0.2, 0.3], 0.001)


def test_noise_must_be_a_tenth_of_the_smallest_step() -> None:
    """Section 6: N = 0.005, dW = 0.1 deg/h take 900 s."""
    assert dwell_s(0.005, 0.1) == pytest.approx(900.0)
    with pytest.raises(ValueError, match="Average longer"):
        threshold(APPLIED, APPLIED, 0.003)
