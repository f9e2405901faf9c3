"""Noise identification, degrees of freedom and limits against allantools."""

import numpy as np
import pytest
from allantools import ci
from scipy.stats import chi2

from fitting.random_errors.confidence import chi_square_factors, equivalent_dof, identify_noise, interval
from tests.fitting.random_errors import generators

FACTORS = np.array([1, 2, 5, 10, 40, 111])


@pytest.mark.parametrize("alpha", [2, 1, 0, -1, -2])
@pytest.mark.parametrize("points", [1001, 30_001])
def test_closed_forms_are_those_of_nist_sp_1065(alpha: int, points: int) -> None:
    factors = FACTORS[1:]
    theirs = [ci.edf_simple(points, m, alpha) for m in factors]
    assert equivalent_dof(np.full(len(factors), alpha), factors, points) == pytest.approx(theirs, rel=1e-12)


@pytest.mark.parametrize("alpha", [0, -1, -2])
def test_closed_forms_agree_with_greenhall_and_riley(alpha: int) -> None:
    factors = FACTORS[2:]
    theirs = [ci.edf_greenhall(alpha, 2, m, 1001, overlapping=True) for m in factors]
    assert equivalent_dof(np.full(len(factors), alpha), factors, 1001) == pytest.approx(theirs, rel=0.15)


def test_flicker_at_one_sample_is_not_the_misprint() -> None:
    general = ci.edf_greenhall(-1, 2, 1, 1001, overlapping=True)
    ours = equivalent_dof(np.array([-1]), np.array([1]), 1001)[0]
    assert ours == pytest.approx(general, rel=0.05)
    assert ci.edf_simple(1001, 1, -1) < 1.0


def test_the_table_of_relative_errors() -> None:
    """Gyro test metrics, section 8.3: 1 / sqrt(2 edf) at T/tau = 9, 50, 500."""
    samples = 90_000
    for ratio, white, flicker, walk in ((9, 0.21, 0.24, 0.28), (50, 0.08, 0.09, 0.10), (500, 0.026, 0.028, 0.032)):
        edf = equivalent_dof(np.array([0, -1, -2]), np.full(3, samples // ratio), samples + 1)
        assert 1.0 / np.sqrt(2.0 * edf) == pytest.approx([white, flicker, walk], rel=0.05)


def test_limits_are_chi_square() -> None:
    low, high = interval(np.array([2.0]), np.array([7.3]), 0.9)
    assert low[0] == pytest.approx(2.0 * np.sqrt(7.3 / chi2.ppf(0.95, 7.3)))
    assert high[0] == pytest.approx(2.0 * np.sqrt(7.3 / chi2.ppf(0.05, 7.3)))
    assert [round(float(f), 2) for f in chi_square_factors(9.0, 0.95)] == [0.69, 1.83]


@pytest.mark.parametrize(("alpha", "seed"), [(2, 0), (0, 1), (-2, 2)])
def test_the_type_of_noise_is_recognised(alpha: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rate = {
        2: np.diff(rng.standard_normal(5001)),
        0: rng.standard_normal(5000),
        -2: generators.random_walk(rng, 5000, 1.0, 1.0),
    }[alpha]
    factors = np.array([1, 2, 4, 8])
    expected = [ci.autocorr_noise_id(rate, int(m), data_type="freq")[0] for m in factors]
    assert identify_noise(rate, factors).tolist() == expected == [alpha] * 4


def test_flicker_is_recognised() -> None:
    rate = generators.flicker(np.random.default_rng(5), 20_000, 1.0, 1.0)
    assert identify_noise(rate, np.array([4, 16, 64])).tolist() == [-1, -1, -1]


def test_too_few_means_keep_the_last_type_and_chance_does_not_flatten_the_spectrum() -> None:
    walk = generators.random_walk(np.random.default_rng(6), 1000, 1.0, 1.0)
    assert identify_noise(walk, np.array([1, 10, 400])).tolist() == [-2, -2, -2]
    for seed in range(20):
        white = np.random.default_rng(seed).standard_normal(1000)
        assert max(identify_noise(white, np.array([1, 10, 20, 33, 100]))[1:]) <= 0


def test_a_constant_record_is_taken_as_white() -> None:
    assert identify_noise(np.full(100, 3.0), np.array([1, 2])).tolist() == [0, 0]
