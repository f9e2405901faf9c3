"""The five noise terms of an Allan curve, and how Allan variances of one record scatter together.

c = (Q^2, N^2, B^2, K^2, R^2) in arcsec^2, deg^2/h, (deg/h)^2, (deg/h)^2/h, (deg/h/h)^2. An Allan variance is a
quadratic form of a Gaussian record, so its spread follows from the covariance of the second differences z of the angle,

    R(u) = sum_ab w_a w_b k(u + (a - b) m),  w = (1, -2, 1),

with k(t) = Q^2 delta(t), -N^2 |t| / 2, B^2 t^2 ln|t| / (2 pi), K^2 |t|^3 / 12: generalised covariances, exact for
means over the sampling interval, whatever it is (after Greenhall and Riley 2003). Equivalent degrees of freedom come
from the sum over lags, at every averaging time; correlations between averaging times from the integral over frequency.
"""

from math import log, pi

import numpy as np
from numpy.typing import NDArray

TERMS = 5
QUANTISATION, WHITE, FLICKER, WALK, RAMP = range(TERMS)
_S_PER_H = 3600.0
# Lags are summed to 3 m, as Greenhall and Riley do: white noise and random walk end at 2 m, flicker dies off as u^-2.
_LAGS_PER_FACTOR, _FURTHEST = 16, 3
# Points a decade of the frequency grid; the sine to the fourth is averaged, not followed, above a tenth of a cycle.
_FREQUENCIES_PER_DECADE = 200


def design(tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """A (t, 5) with Allan variance = A c in (deg/h)^2; IEEE Std 952 annex C, in the units above and tau in s."""
    tau = np.asarray(tau_s, dtype=np.float64)
    hours = tau / _S_PER_H
    flat = np.full(tau.shape, 2.0 * log(2.0) / pi)
    return np.stack([3.0 / tau**2, 1.0 / hours, flat, hours / 3.0, hours**2 / 2.0], axis=-1)


def _shapes(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """R(t m) of white noise, flicker and random walk for N^2 m = B^2 m^2 = K^2 m^3 = 1, (3, ...)."""
    total = np.zeros((3, *t.shape))
    for shift, weight in ((-2, 1.0), (-1, -4.0), (0, 6.0), (1, -4.0), (2, 1.0)):
        x = np.abs(t + shift)
        logarithm = np.log(np.where(x > 0.0, x, 1.0))
        total += weight * np.stack([-x / 2.0, x**2 * logarithm / (2.0 * pi), x**3 / 12.0])
    return total


class AllanSpread:
    """Joint spread of the Allan variances of a record of `samples` at averaging factors (t,)."""

    def __init__(self, factors: NDArray[np.int64], interval_s: float, samples: int) -> None:
        m = np.asarray(factors, dtype=np.float64)
        self.design = design(m * interval_s)
        self._factors, self._interval_s = m, interval_s
        self._differences = samples + 1 - 2 * m
        if self._differences.min() < 1:
            raise ValueError(f"averaging factor {int(m.max())} is more than half of {samples} samples. Leave it out")
        self._prepare_lags()
        self._prepare_frequencies(samples)

    def _prepare_lags(self) -> None:
        """Shapes (3, t, lags) and the weight of every lag in a mean over all pairs of differences, (t, lags)."""
        step = np.maximum(1.0, self._factors / _LAGS_PER_FACTOR)[:, np.newaxis]
        lag = step * np.arange(_LAGS_PER_FACTOR * _FURTHEST + 1)
        n = self._differences[:, np.newaxis]
        inside = (lag < n) & (lag <= _FURTHEST * self._factors[:, np.newaxis])
        self._weights = np.where(inside, 2.0 * step * (n - lag) / n**2, 0.0)
        self._weights[:, 0] *= 0.5
        self._lag_shapes = _shapes(lag / self._factors[:, np.newaxis])
        # Quantisation is white in angle: it lives on three single lags, of the same weight as one pair of samples.
        single = np.arange(3) * self._factors[:, np.newaxis]
        self._single_weights = np.where(single < n, 2.0 * (n - single) / n**2, 0.0) * [0.5, 1.0, 1.0]
        self._single_shapes = _shapes(np.broadcast_to(np.arange(3.0), single.shape))

    def _prepare_frequencies(self, samples: int) -> None:
        """Transfer of each Allan variance (t, f) and one-sided spectra of the noise terms per unit of c, (4, f)."""
        decades = np.log10(3.0 * samples)
        exponent = np.linspace(-decades, 0.0, int(_FREQUENCIES_PER_DECADE * decades) + 2)
        f = 0.5 * 10.0**exponent
        sine = np.sin(pi * f)
        m = self._factors[:, np.newaxis]
        self._transfer = np.sin(pi * f * m) ** 4 / (m * sine) ** 2 * np.sqrt(f)  # sqrt(df), twice in a product
        self._spectra = np.stack([sine**2, np.ones_like(f), 1.0 / sine, 1.0 / sine**2])

    def _in_samples(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Q^2, N^2, B^2, K^2 with the sampling interval as unit of time, rates in deg/h."""
        dt = self._interval_s
        return np.asarray(c[:RAMP] * [1.0 / dt**2, _S_PER_H / dt, 1.0, dt / _S_PER_H])

    def dof(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Equivalent degrees of freedom 2 mean^2 / variance of every Allan variance, (t,)."""
        q, noise = self._in_samples(c)[0], self._in_samples(c)[1:]
        m = self._factors
        scaled = noise[:, np.newaxis] * np.stack([m, m**2, m**3])
        smooth = np.einsum("kt,ktl->tl", scaled, self._lag_shapes)
        at_single = np.einsum("kt,ktl->tl", scaled, self._single_shapes)
        delta = q * np.array([6.0, -4.0, 1.0])
        squares = (smooth**2 * self._weights).sum(axis=1)
        squares += ((2.0 * at_single + delta) * delta * self._single_weights).sum(axis=1)
        # A ramp adds its square to the mean, and its product with the mean difference to the spread.
        ramp = 2.0 * m**2 * (self.design[:, RAMP] * c[RAMP])
        of_mean = (smooth * self._weights).sum(axis=1) + (delta * self._single_weights).sum(axis=1)
        variance = 2.0 * squares + 4.0 * ramp * np.maximum(of_mean, 0.0)
        mean = at_single[:, 0] + 6.0 * q + ramp
        # A ramp alone has no spread at all; 2e12 degrees of freedom say so without infinity.
        return np.asarray(2.0 * mean**2 / np.maximum(variance, 1e-12 * mean**2 + np.finfo(np.float64).tiny))

    def correlation(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Correlation of the Allan variances, (t, t): integral of S(f)^2 |H_i|^2 |H_j|^2, normalised."""
        q2, n2, b2, k2 = self._in_samples(c)
        spectrum = np.array([8.0 * q2, 2.0 * n2, b2, 0.5 * k2]) @ self._spectra
        rows = self._transfer * spectrum
        gram = rows @ rows.T
        if not gram[0, 0] > 0.0:  # a ramp and nothing else
            return np.eye(len(gram))
        scale = np.sqrt(np.diag(gram))
        return np.asarray(gram / np.outer(scale, scale))

    def covariance(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of the Allan variances, (t, t), in (deg/h)^4."""
        spread = self.design @ c * np.sqrt(2.0 / self.dof(c))
        return self.correlation(c) * np.outer(spread, spread)

    def draw(self, c: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Allan variances of records with coefficients c, from standard normals (draws, t).

        Each has the chi-square distribution of its degrees of freedom (Wilson and Hilferty 1931), joined by a Gaussian
        copula with the correlations above.
        """
        correlation = self.correlation(c)
        factor = np.linalg.cholesky(correlation + 1e-9 * np.eye(len(correlation)))
        ninth = 2.0 / (9.0 * self.dof(c))
        cube = np.maximum(1.0 - ninth + np.sqrt(ninth) * (normals @ factor.T), 0.0)
        return np.asarray(self.design @ c * cube**3)
