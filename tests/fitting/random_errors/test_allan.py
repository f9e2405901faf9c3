"""Allan deviations against published vectors, allantools, and the definition written out."""

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.random_errors.allan import allan_curve, allan_variances, averaging_factors
from tests.fitting.random_errors import generators

NBS14 = [892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0]


def nist_1000() -> NDArray[np.float64]:
    """n <- 16807 n mod 2147483647 from 1234567890, divided by the modulus: NIST SP 1065."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


def test_nbs14_vector() -> None:
    overlapping, _ = allan_variances(NBS14, [1, 2])
    plain, _ = allan_variances(NBS14, [1, 2], overlapping=False)
    assert np.sqrt(overlapping) == pytest.approx([91.22945, 85.95287], rel=1e-7)
    assert np.sqrt(plain) == pytest.approx([91.22945, 115.8082], rel=5e-7)


def test_nist_1000_point_vector() -> None:
    overlapping, _ = allan_variances(nist_1000(), [1, 10, 100])
    plain, _ = allan_variances(nist_1000(), [10, 100], overlapping=False)
    assert np.sqrt(overlapping) == pytest.approx([0.2922319, 0.09159953, 0.03241343], rel=3e-7)
    assert np.sqrt(plain) == pytest.approx([0.09965736, 0.03897804], rel=3e-7)


@pytest.mark.parametrize("offset", [0.0, 15.0, 1e6])
def test_equal_to_allantools(offset: float) -> None:
    rng = np.random.default_rng(3)
    rate = offset + generators.white(rng, 100_003, 0.01, 0.005) + generators.random_walk(rng, 100_003, 0.01, 5.0)
    factors = averaging_factors(len(rate), longest=len(rate) // 2)
    variances, counts = allan_variances(rate, factors)
    _, theirs, _, n = allantools.oadev(rate, rate=1.0, data_type="freq", taus=factors.astype(float))
    assert np.sqrt(variances) == pytest.approx(theirs, rel=1e-9)
    assert np.array_equal(counts, n)


@given(st.lists(st.floats(-1e3, 1e3) | st.just(float("nan")), min_size=6, max_size=40), st.integers(1, 5))
@settings(deadline=None, max_examples=60)
def test_gaps_only_take_away_the_differences_that_touch_them(rate: list[float], m: int) -> None:
    values = np.array(rate)
    squares = []
    for k in range(len(values) - 2 * m + 1):
        window = values[k : k + 2 * m]
        if np.isfinite(window).all():
            squares.append(0.5 * (window[m:].mean() - window[:m].mean()) ** 2)
    if not np.isfinite(values).any():
        return
    variances, counts = allan_variances(values, [m])
    assert counts[0] == len(squares)
    assert np.isnan(variances[0]) if not squares else variances[0] == pytest.approx(np.mean(squares), abs=1e-8)


def test_a_gap_is_never_closed_up() -> None:
    """Two levels with a gap between them: closing up would show the step."""
    rate = np.concatenate([np.zeros(50), [np.nan], np.full(50, 100.0)])
    variances, _ = allan_variances(rate, [1, 5, 20])
    assert variances == pytest.approx([0.0, 0.0, 0.0], abs=1e-18)


def test_white_noise_has_its_asymptote() -> None:
    curve = allan_curve(generators.white(np.random.default_rng(0), 200_000, 0.5, 0.005), 0.5)
    assert curve.tau_s[0] == 0.5 and curve.samples == 200_000
    error = curve.deviation_dph / (60.0 * 0.005 / np.sqrt(curve.tau_s)) - 1.0
    assert np.abs(error * np.sqrt(2.0 * curve.edf)).max() < 4.0


def test_block_borders_do_not_matter() -> None:
    """A record of many blocks in one go, and as the definition says."""
    rate = np.random.default_rng(1).standard_normal(70_001)
    for m in (1, 777, 20_000):
        angle = np.concatenate([[0.0], np.cumsum(rate)])
        second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
        assert allan_variances(rate, [m])[0][0] == pytest.approx(np.mean(second**2) / (2 * m**2), rel=1e-10)


def test_factors_are_log_spaced_and_end_at_a_ninth() -> None:
    factors = averaging_factors(9_000_000)
    assert factors[0] == 1 and factors[-1] == 1_000_000
    assert np.array_equal(factors, np.unique(factors))
    assert averaging_factors(100, longest=50)[-1] == 50 - 10  # the step after it is 10^1.7 = 50.1


def test_what_cannot_be_done_is_said() -> None:
    with pytest.raises(ValueError, match="at least 9 samples"):
        averaging_factors(8)
    with pytest.raises(ValueError, match="half the record"):
        averaging_factors(100, longest=51)
    with pytest.raises(ValueError, match="none of the 3 samples"):
        allan_variances([np.nan] * 3, [1])


def test_gaps_that_leave_nothing_shorten_the_curve() -> None:
    rate = np.random.default_rng(2).standard_normal(1000)
    rate[::50] = np.nan
    curve = allan_curve(rate, 1.0)
    assert curve.factors[-1] <= 24 and curve.missing == 20
    assert (curve.differences > 0).all()
