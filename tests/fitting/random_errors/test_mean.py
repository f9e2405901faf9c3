"""The uncertainty of a mean against what two successive means really do."""

import numpy as np
import pytest
from scipy.stats import t as student

from fitting.random_errors.allan import allan_curve
from fitting.random_errors.mean import noise_from_curve, noise_of_mean
from fitting.random_errors.noise_model import design
from tests.fitting.random_errors import generators as g


def test_white_noise_gives_sigma_over_root_n() -> None:
    found = [noise_of_mean(g.white(np.random.default_rng(seed), 3600, 1.0, 0.005), 1.0) for seed in range(40)]
    expected = 60.0 * 0.005 / 3600.0**0.5
    assert np.median([noise.u for noise in found]) == pytest.approx(expected, rel=0.1)
    assert np.median([noise.white_u for noise in found]) == pytest.approx(expected, rel=0.05)
    assert all(noise.dof >= 1.0 for noise in found)


def test_flicker_does_not_average_down() -> None:
    """B = 0.2 deg/h and N = 0.005: sigma / sqrt(n) would say 0.012 deg/h for 600 s; the floor is 0.133."""
    rate = g.white(np.random.default_rng(1), 20_000, 1.0, 0.005) + g.flicker(np.random.default_rng(2), 20_000, 1.0, 0.2)
    noise = noise_from_curve(allan_curve(rate, 1.0), 600.0)
    assert noise.u == pytest.approx(0.1334, rel=0.15)
    assert noise.white_u < 0.02 and noise.dof > 20.0


@pytest.mark.parametrize(("b", "rrw"), [(0.0, 0.0), (0.05, 0.0), (0.02, 0.0), (0.0, 0.2)])
def test_the_next_mean_lies_where_the_uncertainty_says(b: float, rrw: float) -> None:
    n, inside = 1800, 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        rate = g.white(rng, 2 * n, 1.0, 0.005)
        rate = rate + (g.flicker(rng, 2 * n, 1.0, b) if b else g.random_walk(rng, 2 * n, 1.0, rrw))
        noise = noise_of_mean(rate[:n], 1.0)
        difference = abs(rate[n:].mean() - rate[:n].mean()) / 2.0**0.5
        inside += difference <= student.ppf(0.975, noise.dof) * noise.u
    assert inside >= 90


def test_the_naive_rule_fails_where_ours_holds() -> None:
    truth = np.sqrt(design(np.array([1800.0]))[0] @ np.array([0.0, 0.005, 0.05, 0.0, 0.0]) ** 2)
    rng = np.random.default_rng(3)
    rate = g.white(rng, 1800, 1.0, 0.005) + g.flicker(rng, 1800, 1.0, 0.05)
    assert rate.std() / 1800**0.5 < 0.3 * truth
    assert noise_of_mean(rate, 1.0).u > 0.6 * truth


def test_a_noiseless_record_and_a_short_one() -> None:
    assert noise_of_mean(np.full(100, 5.0), 1.0).u == 0.0
    with pytest.raises(ValueError, match="30 or more"):
        noise_of_mean(np.zeros(29), 1.0)
