"""Turn-on time."""

import numpy as np
import pytest

from fitting.metrics.start import turn_on_time

BAND = (-0.1, 0.1)


def cold_start(tau_s: float, seed: int) -> np.ndarray:
    time = np.arange(3600.0) + 0.5
    return np.exp(-time / tau_s) + 0.01 * np.random.default_rng(seed).standard_normal(3600)


def test_the_longest_of_several_starts() -> None:
    """exp(-t / 200) falls below 0.1 at 460 s; at 300 s of time constant at 691 s."""
    figure = turn_on_time([cold_start(200.0, 1), cold_start(300.0, 2)], 1.0, 10.0, BAND)
    assert figure.value == pytest.approx(700.0, abs=11.0)
    assert figure.n == 2 and figure.u > 10.0 / 12**0.5


def test_an_excursion_later_starts_the_count_again() -> None:
    rate = cold_start(200.0, 3)
    rate[2000:2010] += 5.0
    assert turn_on_time([rate], 1.0, 10.0, BAND).value == 2020.0


def test_a_gyro_that_never_arrives() -> None:
    with pytest.raises(ValueError, match="never"):
        turn_on_time([cold_start(1e5, 4)], 1.0, 10.0, BAND)
