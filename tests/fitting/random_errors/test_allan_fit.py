"""Coefficients recovered from simulated records, their limits, and what is not claimed."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import nnls

from fitting.random_errors.allan import AllanCurve, allan_curve
from fitting.random_errors.allan_fit import fit_allan, fit_variances
from fitting.random_errors.noise_model import design
from tests.fitting.random_errors import generators as g

HOURS_12 = 43_200


def record(seed: int, n: int, arw: float, b: float = 0.0, rrw: float = 0.0, ramp: float = 0.0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    rate = g.white(rng, n, 1.0, arw) + g.ramp(n, 1.0, ramp)
    if b:
        rate = rate + g.flicker(rng, n, 1.0, b)
    return rate + g.random_walk(rng, n, 1.0, rrw) if rrw else rate


def test_an_exact_curve_gives_its_coefficients_back() -> None:
    tau = np.geomspace(1.0, 1e5, 50)
    c = np.array([0.1, 0.005, 0.02, 0.01, 0.003]) ** 2
    assert fit_variances(tau, design(tau) @ c, np.full(50, 100.0)) == pytest.approx(c, rel=1e-6)


def test_a_single_iteration_is_scipys_weighted_nnls() -> None:
    """Five iterations end where scipy's nnls, weighted by the final model, ends as well."""
    curve = allan_curve(record(1, HOURS_12, 0.005, 0.02, 0.01), 1.0)
    c = fit_variances(curve.tau_s, curve.deviation_dph**2, curve.edf)
    weights = np.sqrt(curve.edf / 2.0) / (design(curve.tau_s) @ c)
    matrix = design(curve.tau_s) * weights[:, np.newaxis]
    scale = np.linalg.norm(matrix, axis=0)
    expected = nnls(matrix / scale, curve.deviation_dph**2 * weights)[0] / scale
    assert c == pytest.approx(expected, rel=0.02, abs=1e-12)


def test_white_flicker_and_quantisation_are_found_in_12_hours() -> None:
    rate = g.quantised(record(3, HOURS_12, 0.005, 0.02), 1.0, 0.5)
    fit = fit_allan(allan_curve(rate, 1.0))
    assert fit.angle_random_walk.value == pytest.approx(0.005, rel=0.02)
    assert fit.quantisation.value == pytest.approx(0.5 / 12**0.5, rel=0.06)
    assert fit.bias_instability.value == pytest.approx(0.02, rel=0.3)
    assert all(found.claimed for found in fit.coefficients[:3])
    for found, truth in zip(fit.coefficients[:3], (0.5 / 12**0.5, 0.005, 0.02), strict=True):
        assert found.low <= truth <= found.high
        assert 0.1 < found.u / (found.high - found.low) < 0.5


def test_a_ramp_is_found() -> None:
    fit = fit_allan(allan_curve(record(4, HOURS_12, 0.005, ramp=0.05), 1.0))
    assert fit.rate_ramp.claimed and fit.rate_ramp.value == pytest.approx(0.05, rel=0.15)
    assert not fit.bias_instability.claimed


def test_b_is_not_claimed_from_white_noise_and_the_minimum_is_kept_apart() -> None:
    curve = allan_curve(record(5, HOURS_12, 0.005), 1.0)
    fit = fit_allan(curve)
    assert not fit.bias_instability.claimed and fit.bias_instability.low == 0.0
    assert 0.0 < fit.bias_instability.high < 0.02
    assert fit.minimum.deviation_dph == curve.deviation_dph.min() > 0.0
    assert fit.minimum.low_dph < fit.minimum.deviation_dph < fit.minimum.high_dph


def test_white_noise_and_random_walk_alone_have_a_minimum_that_is_not_b() -> None:
    """sqrt(2 N K / sqrt 3) = 0.0241 deg/h at sqrt 3 N / K: a minimum without any flicker."""
    fit = fit_allan(allan_curve(record(6, HOURS_12, 0.005, rrw=0.1), 1.0))
    assert fit.minimum.deviation_dph == pytest.approx(0.0241, rel=0.15)
    assert not fit.bias_instability.claimed and fit.rate_random_walk.claimed


def test_deterministic_under_its_seed() -> None:
    curve = allan_curve(record(7, 7200, 0.005), 1.0)
    assert fit_allan(curve, draws=200).coefficients == fit_allan(curve, draws=200).coefficients
    assert fit_allan(curve, draws=200, seed=1).coefficients != fit_allan(curve, draws=200).coefficients


def test_the_fitted_curve_passes_the_measured_one() -> None:
    curve = allan_curve(record(8, HOURS_12, 0.005, 0.02), 1.0)
    ratio = fit_allan(curve, draws=100).deviation_dph(curve.tau_s) / curve.deviation_dph
    assert np.abs((ratio - 1.0) * np.sqrt(2.0 * curve.edf)).max() < 4.0


def test_a_record_too_short_to_tell_terms_apart_says_so() -> None:
    """Six averaging times for five terms: a limit that was not there would be invented."""
    fit = fit_allan(allan_curve(np.random.default_rng(0).standard_normal(60), 1.0), draws=200)
    assert any(np.isinf(found.high) for found in fit.coefficients)
    assert all(found.low <= found.value <= found.high for found in fit.coefficients)


def test_a_ramp_without_noise() -> None:
    fit = fit_allan(allan_curve(g.ramp(1000, 1.0, 2.0), 1.0), draws=200)
    assert fit.rate_ramp.value == pytest.approx(2.0, rel=1e-6)
    assert fit.angle_random_walk.value < 1e-6


def test_what_cannot_be_fitted_is_said() -> None:
    with pytest.raises(ValueError, match="averaging times for 5 coefficients"):
        fit_allan(allan_curve(np.random.default_rng(0).standard_normal(40), 1.0, [1, 2, 3]))
    with pytest.raises(ValueError, match="frozen"):
        fit_allan(allan_curve(np.full(1000, 2.0), 1.0))


def covered(curves: list[AllanCurve], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of curves whose limits hold the truth, (5,)."""
    hits = np.zeros(5)
    for curve in curves:
        found = fit_allan(curve).coefficients
        hits += [k.low <= t <= k.high for k, t in zip(found, truth, strict=True)]
    return np.asarray(hits / len(curves))


@pytest.mark.campaign
def test_95_percent_limits_hold_the_truth_in_90_to_99_percent_of_60_records() -> None:
    truth = np.array([0.5 / 12**0.5, 0.005, 0.02, 0.0, 0.0])
    records = [g.quantised(record(seed, HOURS_12, 0.005, 0.02), 1.0, 0.5) for seed in range(60)]
    share = covered([allan_curve(rate, 1.0) for rate in records], truth)
    assert (share[:3] >= 0.90).all() and 0.90 <= share[:3].mean() <= 0.99, share
    assert (share[3:] >= 0.95).all(), "a coefficient of zero is inside its upper limit more often than not"
