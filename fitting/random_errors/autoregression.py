"""AR(2) with a constant, y_k = phi1 y_(k-1) + phi2 y_(k-2) + c + a_k, for many series at once.

Least squares by normal equations on the series without their means (of the very rows that enter): the constant then
drops out of the 2 x 2 system, and it stays well conditioned however large the mean is beside the noise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Autoregression:
    """phi1, phi2, constant (...): one value per series; *_u: their standard errors; noise_variance: of a_k, RSS / n.

    The standard errors use RSS / n as least squares for time series does (maximum likelihood), not RSS / (n - 3).
    mean: of the series, from which the constant may also be had: `constant_of_mean`.
    """

    phi1: NDArray[np.float64]
    phi2: NDArray[np.float64]
    constant: NDArray[np.float64]
    phi1_u: NDArray[np.float64]
    phi2_u: NDArray[np.float64]
    constant_u: NDArray[np.float64]
    noise_variance: NDArray[np.float64]
    mean: NDArray[np.float64]

    @property
    def constant_of_mean(self) -> NDArray[np.float64]:
        """c = mean (1 - phi1 - phi2): reference experiment `north`."""
        return np.asarray(self.mean * (1.0 - self.phi1 - self.phi2))

    @property
    def largest_root(self) -> NDArray[np.float64]:
        """Modulus of the larger root of z^2 - phi1 z - phi2."""
        root = np.sqrt(np.asarray(self.phi1**2 + 4.0 * self.phi2, dtype=np.complex128))
        return np.asarray(np.maximum(np.abs(self.phi1 + root), np.abs(self.phi1 - root)) / 2.0)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Both roots inside the unit circle: the model has a mean, c / (1 - phi1 - phi2)."""
        return np.asarray(self.largest_root < 1.0)


def fit_ar2(series: ArrayLike) -> Autoregression:
    """Fit every series of (..., n) on its own.

    ValueError: fewer than 6 samples, values that are not finite, or a series that is constant (phi is then anything).
    """
    y = np.asarray(series, dtype=np.float64)
    if y.shape[-1] < 6:
        raise ValueError(f"{y.shape[-1]} samples for three parameters. Allowed: 6 or more")
    mean = y.mean(axis=-1)
    if not np.isfinite(mean).all():
        raise ValueError("samples that are not finite: AR(2) needs a record without gaps. Fill or cut it first")
    return _solve(y - mean[..., np.newaxis], mean)


def _solve(d: NDArray[np.float64], mean: NDArray[np.float64]) -> Autoregression:
    """Normal equations of the centred series d (..., n)."""
    rows = d.shape[-1] - 2
    # The sums over y_k, y_(k-1) and y_(k-2) are three products of the whole series less what stands at its ends.
    c0, c1, c2, total = _dot(d, d), _dot(d[..., 1:], d[..., :-1]), _dot(d[..., 2:], d[..., :-2]), d.sum(axis=-1)
    a, b, y, z = d[..., 0], d[..., 1], d[..., -2], d[..., -1]
    m0, m1, m2 = (total - a - b) / rows, (total - a - z) / rows, (total - y - z) / rows
    s11, s22 = c0 - a * a - z * z - rows * m1 * m1, c0 - y * y - z * z - rows * m2 * m2
    s12, s01, s02 = c1 - y * z - rows * m1 * m2, c1 - a * b - rows * m0 * m1, c2 - rows * m0 * m2
    determinant = s11 * s22 - s12 * s12
    if not np.all(determinant > 0.0):
        raise ValueError("a series is constant or a perfect line: phi1 and phi2 are not determined. Is it frozen?")
    phi1, phi2 = (s01 * s22 - s02 * s12) / determinant, (s02 * s11 - s01 * s12) / determinant
    offset = m0 - phi1 * m1 - phi2 * m2
    residual = d[..., 2:] - offset[..., np.newaxis]
    residual -= phi1[..., np.newaxis] * d[..., 1:-1]
    residual -= phi2[..., np.newaxis] * d[..., :-2]
    variance = _dot(residual, residual) / rows
    # Levels of the regressors themselves: the constant is the intercept at y = 0, far from the data.
    at1, at2 = mean + m1, mean + m2
    leverage = (at1 * at1 * s22 - 2.0 * at1 * at2 * s12 + at2 * at2 * s11) / determinant
    constant = offset + mean * (1.0 - phi1 - phi2)
    u1, u2 = np.sqrt(variance * s22 / determinant), np.sqrt(variance * s11 / determinant)
    of_constant = np.sqrt(variance * (1.0 / rows + leverage))
    return Autoregression(phi1, phi2, constant, u1, u2, of_constant, variance, mean)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("...k,...k->...", a, b))
