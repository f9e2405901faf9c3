"""Noise coefficients from an Allan curve: weighted non-negative least squares on the variance, limits by bootstrap.

Variances of independent terms add, deviations do not; a polynomial through the deviations finds a tenth of B
(Lv et al., Optik 126, 2015). Rows are weighted by sqrt(edf / 2) / model, and the model is fitted five times.

Limits come from a parametric bootstrap with inverted test: a coefficient's lower limit is where a record of that
coefficient (the others fitted again) would give an estimate as large as ours in (1 - coverage) / 2 of all cases, its
upper limit where one as small. Records are not simulated: their Allan variances are drawn from their joint
distribution (`noise_model.AllanSpread`), which depends on the coefficients and on the length only, so that a record of
1e7 samples costs no more than one of 1000.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.random_errors.allan import AllanCurve
from fitting.random_errors.noise_model import FLICKER, QUANTISATION, RAMP, TERMS, WALK, WHITE, AllanSpread, design
from fitting.random_errors.nonnegative import nonnegative

_ITERATIONS = 5
_DRAWS = 1000
# Limits are found to this share of themselves: far below their own spread from 1000 draws.
_LIMIT_TOLERANCE = 0.02
_NAMES = (
    ("quantisation", "Q", "arcsec"),
    ("angle random walk", "N", "deg/sqrt(h)"),
    ("bias instability", "B", "deg/h"),
    ("rate random walk", "K", "deg/h/sqrt(h)"),
    ("rate ramp", "R", "deg/h/h"),
)


@dataclass(frozen=True)
class Coefficient:
    """One coefficient with its bootstrap standard deviation u and its limits.

    low = 0: the record does not need this term; then only `high` may be quoted, as an upper limit. It is infinite if
    the record is too short to tell the term from others.
    """

    name: str
    symbol: str
    unit: str
    value: float
    u: float
    low: float
    high: float

    @property
    def claimed(self) -> bool:
        """The fit needs this term: without it an estimate this large would be rarer than (1 - coverage) / 2."""
        return self.low > 0.0


@dataclass(frozen=True)
class AllanMinimum:
    """The lowest point of the curve; not the bias instability, which is a coefficient of the fit."""

    deviation_dph: float
    tau_s: float
    low_dph: float
    high_dph: float


@dataclass(frozen=True)
class AllanFit:
    """Q N B K R in that order, and the minimum of the measured curve.

    coverage: of the limits; values (5,): squares of the coefficients, as `noise_model.design` takes them.
    """

    coefficients: tuple[Coefficient, ...]
    minimum: AllanMinimum
    values: NDArray[np.float64]
    coverage: float
    draws: int
    seed: int

    @property
    def quantisation(self) -> Coefficient:
        """Q in arcsec."""
        return self.coefficients[QUANTISATION]

    @property
    def angle_random_walk(self) -> Coefficient:
        """N in deg/sqrt(h)."""
        return self.coefficients[WHITE]

    @property
    def bias_instability(self) -> Coefficient:
        """B in deg/h; the flat part of the curve is 0.664 B."""
        return self.coefficients[FLICKER]

    @property
    def rate_random_walk(self) -> Coefficient:
        """K in deg/h/sqrt(h)."""
        return self.coefficients[WALK]

    @property
    def rate_ramp(self) -> Coefficient:
        """R in deg/h/h."""
        return self.coefficients[RAMP]

    def deviation_dph(self, tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The fitted curve at tau_s (t,)."""
        return np.sqrt(design(tau_s) @ self.values)


class Estimator:
    """The weighted fit of matrix (t, p) for one set of weights, which makes it linear but for x >= 0."""

    def __init__(self, matrix: NDArray[np.float64], edf: NDArray[np.float64], expected: NDArray[np.float64]) -> None:
        """expected: the variances (t,) that the weights sqrt(edf / 2) / expected are taken from."""
        weights = 0.5 * edf / np.maximum(expected, np.finfo(np.float64).tiny) ** 2
        self._weighted = matrix * weights[:, np.newaxis]
        self.gram = matrix.T @ self._weighted

    def estimate(self, variances: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coefficients (s, p) of curves (s, t)."""
        return nonnegative(self.gram, variances @ self._weighted)

    def gains(self) -> NDArray[np.float64]:
        """d c / d variances (p, t), where no coefficient is at zero."""
        return np.asarray(np.linalg.solve(self.gram, self._weighted.T))

    def estimate_others(self, variances: NDArray[np.float64], term: int, value: float) -> NDArray[np.float64]:
        """Coefficients (5,) of one curve (t,) with one of them given."""
        others = np.arange(TERMS) != term
        target = variances @ self._weighted - self.gram[term] * value
        c = np.full(TERMS, value)
        c[others] = nonnegative(self.gram[np.ix_(others, others)], target[np.newaxis, others])[0]
        return c


def fit_variances(
    tau_s: NDArray[np.float64], variances: NDArray[np.float64], edf: NDArray[np.float64], terms: int = TERMS
) -> NDArray[np.float64]:
    """c (5,) of one Allan curve: variances in (deg/h)^2, edf, both (t,). Only the first `terms` may be above zero."""
    matrix = design(tau_s)[:, :terms]
    expected = variances
    for _ in range(_ITERATIONS):
        c = Estimator(matrix, edf, expected).estimate(variances[np.newaxis])[0]
        expected = matrix @ c
    return np.concatenate([c, np.zeros(TERMS - terms)])


class _Bootstrap:
    """Estimates that records with given coefficients would give; the same normals every time, so that limits vary
    smoothly with the coefficients."""

    def __init__(self, curve: AllanCurve, draws: int, seed: int) -> None:
        self._spread = AllanSpread(curve.factors, curve.interval_s, curve.samples)
        self._edf, self._variances = curve.edf, curve.deviation_dph**2
        self._normals = np.random.default_rng(seed).standard_normal((draws, len(curve.factors)))

    def beyond(self, term: int) -> float:
        """A coefficient that would lift every Allan variance a millionfold: if the fit misses even that, it is blind
        to this term."""
        return float(np.sqrt(1e6 * np.max(self._variances / self._spread.design[:, term])))

    def estimates(self, c: NDArray[np.float64]) -> NDArray[np.float64]:
        """(draws, 5)."""
        estimator = Estimator(self._spread.design, self._edf, self._spread.design @ c)
        return estimator.estimate(self._spread.draw(c, self._normals))

    def tail(self, term: int, observed: NDArray[np.float64], upper: bool) -> Callable[[float], float]:
        """Share of records with coefficient `value` whose estimate is at least (at most, for upper) the observed."""
        fitted = Estimator(self._spread.design, self._edf, self._spread.design @ observed)

        def share(value: float) -> float:
            found = self.estimates(fitted.estimate_others(self._variances, term, value))[:, term]
            return float(np.mean(found <= observed[term] if upper else found >= observed[term]))

        return share


def fit_allan(curve: AllanCurve, *, coverage: float = 0.95, draws: int = _DRAWS, seed: int = 0) -> AllanFit:
    """Coefficients, limits and minimum of an Allan curve in deg/h. Deterministic for a seed.

    ValueError: fewer averaging times than coefficients, or a record without any noise.
    """
    variances = curve.deviation_dph**2
    if len(variances) < TERMS:
        raise ValueError(f"{len(variances)} averaging times for {TERMS} coefficients. Record longer")
    if not variances.any():
        raise ValueError("every Allan deviation is zero: the record is constant. Is the gyro's output frozen?")
    observed = fit_variances(curve.tau_s, variances, curve.edf)
    bootstrap = _Bootstrap(curve, draws, seed)
    scatter = np.sqrt(bootstrap.estimates(observed)).std(axis=0)
    found = []
    for term, names in enumerate(_NAMES):
        low, high = _limits(bootstrap, term, observed, float(scatter[term]), 0.5 * (1.0 - coverage))
        found.append(Coefficient(*names, float(np.sqrt(observed[term])), float(scatter[term]), low, high))
    return AllanFit(tuple(found), _minimum(curve), observed, coverage, draws, seed)


def _minimum(curve: AllanCurve) -> AllanMinimum:
    lowest = int(np.argmin(curve.deviation_dph))
    figures = (curve.deviation_dph, curve.tau_s, curve.low_dph, curve.high_dph)
    return AllanMinimum(*(float(values[lowest]) for values in figures))


def _limits(
    bootstrap: _Bootstrap, term: int, observed: NDArray[np.float64], scatter: float, rare: float
) -> tuple[float, float]:
    """Lower and upper limit of sqrt(c[term])."""
    value = float(np.sqrt(observed[term]))
    as_large = bootstrap.tail(term, observed, upper=False)
    low = 0.0
    if value > 0.0 and as_large(0.0) <= rare:
        low = _crossing(lambda root: as_large(root**2) - rare, 0.0, value)
    as_small = bootstrap.tail(term, observed, upper=True)
    beyond = bootstrap.beyond(term)
    step = max(scatter, 1e-3 * value, 1e-6 * beyond)
    high = value + 2.0 * step
    while as_small(high**2) > rare:
        if high > beyond:
            return low, float("inf")
        step *= 2.0
        high += step
    return low, _crossing(lambda root: rare - as_small(root**2), value, high)


def _crossing(rising: Callable[[float], float], below: float, above: float) -> float:
    """Where a rising function changes sign, by bisection."""
    while above - below > _LIMIT_TOLERANCE * 0.5 * (above - 0.9 * below):
        middle = 0.5 * (below + above)
        if rising(middle) > 0.0:
            above = middle
        else:
            below = middle
    return 0.5 * (below + above)
