"""How well an Allan deviation is known: type of noise, equivalent degrees of freedom, chi-square limits.

alpha is the exponent of the rate's spectrum: 2 quantisation, 1 flicker of angle, 0 angle random walk, -1 bias
instability, -2 rate random walk.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

# Lag-1 identification is meant for 30 averages or more (Riley and Greenhall 2004).
_FEWEST_MEANS = 30
_WHITE = 0


def identify_noise(rate: NDArray[np.float64], factors: NDArray[np.int64]) -> NDArray[np.int64]:
    """alpha at every averaging factor by the lag-1 autocorrelation of the means (Riley and Greenhall 2004), (t,).

    rate: (n,) without gaps. Fewer than 30 means cannot tell: such factors take the type of the longest that could,
    or white noise if none could. The spectrum of a sum of power laws only gets steeper towards low frequencies: after
    the first alpha <= 0 a positive one is chance, and would promise far too many degrees of freedom; it counts as 0.
    """
    angle = np.concatenate([[0.0], np.cumsum(rate - rate.mean())])
    found = np.empty(len(factors), np.int64)
    last = _WHITE
    for i, m in enumerate(factors.tolist()):
        means = np.diff(angle[::m]) / m
        if len(means) >= _FEWEST_MEANS:
            last = min(_identify(means), 2 if last > 0 or i == 0 else 0)
        found[i] = last
    return found


def _identify(means: NDArray[np.float64]) -> int:
    """Difference until the lag-1 autocorrelation says stationary; alpha in -2 ... 2."""
    time = np.arange(len(means)) - 0.5 * (len(means) - 1)
    series = means - means.mean()
    series -= time * (time @ series) / (time @ time)
    for differences in range(3):
        series = series - series.mean()
        power = float(series @ series)
        if power == 0.0:
            return _WHITE
        r1 = float(series[:-1] @ series[1:]) / power
        rho = r1 / (1.0 + r1)
        if rho < 0.25:
            break
        series = np.diff(series) if differences < 2 else series
    return int(np.clip(-round(2.0 * rho) - 2 * differences, -2, 2))


def equivalent_dof(exponent: NDArray[np.int64], factors: NDArray[np.int64], points: int) -> NDArray[np.float64]:
    """Degrees of freedom of overlapping Allan variances (t,); NIST SP 1065 table 5, points = samples + 1.

    Flicker rate at m = 1 is 2 (N - 2)^2 / (2.3 N - 4.9) as in Stein 1985: the table prints the square without its
    exponent, which would leave less than one degree of freedom for any record. At least 1 everywhere.
    """
    n, m = float(points), np.asarray(factors, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        forms = {
            2: (n + 1) * (n - 2 * m) / (2 * (n - m)),
            1: np.exp(np.sqrt(np.log((n - 1) / (2 * m)) * np.log((2 * m + 1) * (n - 1) / 4))),
            0: (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5),
            -1: np.where(m < 2, 2 * (n - 2) ** 2 / (2.3 * n - 4.9), 5 * n**2 / (4 * m * (n + 3 * m))),
            -2: (n - 2) / (m * (n - 3) ** 2) * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2),
        }
    edf = np.select([exponent == alpha for alpha in forms], list(forms.values()))
    return np.asarray(np.maximum(np.nan_to_num(edf, nan=1.0), 1.0))


def chi_square_factors(dof: NDArray[np.float64] | float, coverage: float) -> tuple[NDArray[np.float64], ...]:
    """What a standard deviation with `dof` is multiplied by to get its lower and upper limit.

    >>> [round(float(factor), 2) for factor in chi_square_factors(5.0, 0.95)]
    [0.62, 2.45]
    """
    half = 0.5 * np.asarray(dof, dtype=np.float64)
    upper, lower = (gammaincinv(half, 0.5 + side * 0.5 * coverage) for side in (1.0, -1.0))
    return np.sqrt(half / upper), np.sqrt(half / lower)


def interval(
    deviation: NDArray[np.float64], edf: NDArray[np.float64], coverage: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Limits of deviations (t,) with edf (t,): sqrt(edf s^2 / chi^2), NIST SP 1065 eq. 45."""
    low, high = chi_square_factors(edf, coverage)
    return deviation * low, deviation * high
