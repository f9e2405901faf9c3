"""The joint spread of Allan variances against Greenhall and Riley's algorithm and against simulated records."""

import numpy as np
import pytest
from allantools import ci

from fitting.random_errors.allan import allan_variances, averaging_factors
from fitting.random_errors.noise_model import AllanSpread, design
from tests.fitting.random_errors import generators


def test_columns_in_the_units_of_ieee_952() -> None:
    """Each coefficient is read where the standard reads it: Q at sqrt(3) s, N at 1 h, K at 3 h, R at sqrt(2) h."""
    rows = design(np.array([3.0**0.5, 3600.0, 3600.0, 3.0 * 3600.0, 2.0**0.5 * 3600.0]))
    assert rows.diagonal() == pytest.approx([1.0, 1.0, 0.664283**2, 1.0, 1.0], rel=1e-5)


@pytest.mark.parametrize(("term", "alpha"), [(0, 2), (1, 0), (2, -1), (3, -2)])
def test_degrees_of_freedom_are_greenhall_and_rileys(term: int, alpha: int) -> None:
    factors = np.array([40, 100, 400, 1111])
    spread = AllanSpread(factors, 1.0, 10_000)
    theirs = [ci.edf_greenhall(alpha, 2, int(m), 10_001, overlapping=True) for m in factors]
    assert spread.dof(np.eye(5)[term]) == pytest.approx(theirs, rel=0.02)


def test_exact_for_white_noise_at_one_sample() -> None:
    """Var of the mean of (y_(k+1) - y_k)^2: correlation -1/2 of neighbours, so edf = 2n/3 but for the ends."""
    n = 1000
    exact = n / (1.0 + 2.0 * 0.25 * (n - 1) / n)
    assert AllanSpread(np.array([1]), 1.0, n + 1).dof(np.eye(5)[1]) == pytest.approx(exact, rel=1e-12)


def test_covariance_of_simulated_records() -> None:
    n, dt, c = 2000, 2.0, np.array([0.0, 0.005**2, 0.0, 0.3**2, 0.0])
    factors = averaging_factors(n, per_decade=4)
    rng = np.random.default_rng(8)
    curves = np.array(
        [
            allan_variances(generators.white(rng, n, dt, 0.005) + generators.random_walk(rng, n, dt, 0.3), factors)[0]
            for _ in range(1500)
        ]
    )
    spread = AllanSpread(factors, dt, n)
    assert curves.mean(axis=0) == pytest.approx(spread.design @ c, rel=0.05)
    assert curves.std(axis=0) == pytest.approx(np.sqrt(np.diag(spread.covariance(c))), rel=0.1)
    assert np.corrcoef(curves.T) == pytest.approx(spread.correlation(c), abs=0.1)


def test_a_ramp_adds_mean_and_certainty() -> None:
    n, dt = 3000, 1.0
    c = np.array([0.0, 0.005**2, 0.0, 0.0, 0.5**2])
    factors = np.array([30, 100, 333])
    rng = np.random.default_rng(9)
    drift = generators.ramp(n, dt, 0.5)
    curves = np.array([allan_variances(generators.white(rng, n, dt, 0.005) + drift, factors)[0] for _ in range(1500)])
    spread = AllanSpread(factors, dt, n)
    assert curves.mean(axis=0) == pytest.approx(spread.design @ c, rel=0.03)
    assert 2.0 * (curves.mean(axis=0) / curves.std(axis=0)) ** 2 == pytest.approx(spread.dof(c), rel=0.2)


def test_draws_have_the_mean_and_the_covariance() -> None:
    c = np.array([0.0, 0.005**2, 0.02**2, 0.0, 0.0])
    spread = AllanSpread(averaging_factors(5000), 1.0, 5000)
    draws = spread.draw(c, np.random.default_rng(0).standard_normal((20_000, len(spread.design))))
    assert draws.mean(axis=0) == pytest.approx(spread.design @ c, rel=0.02)
    assert draws.std(axis=0) == pytest.approx(np.sqrt(np.diag(spread.covariance(c))), rel=0.05)


def test_too_long_a_factor_is_refused() -> None:
    with pytest.raises(ValueError, match="more than half"):
        AllanSpread(np.array([1, 60]), 1.0, 100)
