"""How well the mean of a record is known when its noise is correlated.

The standard deviation divided by sqrt(n) holds for white noise only. For flicker and random walk no average has a
limit; what can be said is how far two successive means of this length differ: the Allan deviation at tau = the length
of the record, from the coefficients N, B and K fitted to its Allan variances. A ramp is a drift, not a noise of the
mean, and is left out; so is quantisation, which adds nothing beyond seconds. Without flicker and walk the result is
sigma / sqrt(n).

One record says little about noise as slow as itself: that is in the degrees of freedom, which may be few. A long
static record of the same gyro says more: `noise_from_curve` takes its curve and any duration.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.random_errors.allan import AllanCurve, allan_curve, averaging_factors
from fitting.random_errors.allan_fit import Estimator, fit_variances
from fitting.random_errors.noise_model import FLICKER, RAMP, WALK, WHITE, AllanSpread, design

_FEWEST = 30


@dataclass(frozen=True)
class NoiseOfMean:
    """Standard uncertainty of the mean of a record, its degrees of freedom (1 or more), and its part of white noise.

    In the unit of the record; white_u is what a naive sigma / sqrt(n) would say of the angle random walk.
    """

    u: float
    dof: float
    white_u: float


def noise_of_mean(rate_dph: ArrayLike, interval_s: float, duration_s: float | None = None) -> NoiseOfMean:
    """Uncertainty of a mean over duration_s (default: the record) of noise like that of rate_dph (n,).

    Averaging times up to half the record are used: few differences are better than none where the answer is sought.
    ValueError: fewer than 30 samples.
    """
    rate = np.asarray(rate_dph, dtype=np.float64)
    if len(rate) < _FEWEST:
        raise ValueError(f"{len(rate)} samples: how they are correlated cannot be seen. Allowed: {_FEWEST} or more")
    curve = allan_curve(rate, interval_s, averaging_factors(len(rate), longest=len(rate) // 2))
    return noise_from_curve(curve, len(rate) * interval_s if duration_s is None else duration_s)


def noise_from_curve(curve: AllanCurve, duration_s: float) -> NoiseOfMean:
    """The same from an Allan curve in deg/h."""
    variances = curve.deviation_dph**2
    if not variances.any():
        return NoiseOfMean(0.0, np.inf, 0.0)
    spread = AllanSpread(curve.factors, curve.interval_s, curve.samples)
    c = fit_variances(curve.tau_s, variances, curve.edf, terms=RAMP)
    at_duration = design(np.array([duration_s]))[0]
    parts = np.zeros_like(c)
    parts[[WHITE, FLICKER, WALK]] = (at_duration * c)[[WHITE, FLICKER, WALK]]
    sensitivity = at_duration * (parts > 0.0) @ _gains(spread, curve.edf, c)
    of_variance = float(sensitivity @ spread.covariance(c) @ sensitivity)
    variance = float(parts.sum())
    dof = 2.0 * variance**2 / of_variance if of_variance > 0.0 else np.inf
    return NoiseOfMean(float(np.sqrt(variance)), max(dof, 1.0), float(np.sqrt(parts[WHITE])))


def _gains(spread: AllanSpread, edf: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of the coefficients with respect to the variances, (5, t); zero for coefficients at zero."""
    used = c > 0.0
    gains = np.zeros((len(c), len(edf)))
    gains[used] = Estimator(spread.design[:, used], edf, spread.design @ c).gains()
    return gains
