"""Scale factor K, its nonlinearity, asymmetry, repeatability and temperature sensitivity (GJB 2426A, IEEE Std 952)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.metrics.figure import Figure, standard_deviation, with_u
from fitting.metrics.thermal import ROOM_DISTANCE_DEGC, sensitivity

_PPM = 1e6
_SOURCE = "GJB 2426A scale factor"


@dataclass(frozen=True)
class Line:
    """F = K W + F0 by least squares, with the covariance of (K, F0) from the residuals (n - 2)."""

    slope: float
    offset: float
    covariance: NDArray[np.float64]
    residuals: NDArray[np.float64]

    @property
    def slope_u(self) -> float:
        """Standard uncertainty of K from the scatter about the line."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def residual_std(self) -> float:
        """Scatter of one point about the line, n - 2."""
        return float(np.sqrt(self.residuals @ self.residuals / (len(self.residuals) - 2)))


def fit_line(rates_dps: NDArray[np.float64], outputs: NDArray[np.float64]) -> Line:
    """K and F0 over rates (m,) and outputs (m,), m >= 3 and at least two different rates."""
    if len(rates_dps) < 3 or np.ptp(rates_dps) == 0.0:
        raise ValueError(f"{len(rates_dps)} points at {np.unique(rates_dps).size} rates. Allowed: 3 points, 2 rates")
    centre, level = rates_dps.mean(), outputs.mean()
    w = rates_dps - centre
    power = float(w @ w)
    slope = float(w @ (outputs - level)) / power
    residuals = outputs - level - slope * w
    variance = float(residuals @ residuals) / (len(w) - 2)
    covariance = variance / power * np.array([[1.0, -centre], [-centre, power / len(w) + centre**2]])
    return Line(slope, float(level - slope * centre), covariance, residuals)


@dataclass(frozen=True)
class RateSet:
    """What a rate set says about K.

    reading_ppm (m,): residual over K times the rate, for each point; it diverges at low rates by construction.
    residuals_ppm (m,): residual over the largest output.
    """

    scale_factor: Figure
    offset: Figure
    nonlinearity: Figure
    asymmetry: Figure
    rates_dps: NDArray[np.float64]
    residuals_ppm: NDArray[np.float64]
    reading_ppm: NDArray[np.float64]


def rate_set(
    rates_dps: ArrayLike,
    outputs: ArrayLike,
    *,
    rest_before: ArrayLike = 0.0,
    rest_after: ArrayLike | None = None,
    table_u_ppm: float = 0.0,
    rest_in_halves: bool = False,
    unit: str = "output",
) -> RateSet:
    """K, F0, Kn and Ka from mean outputs (m,) at table rates (m,), counter-clockwise positive.

    rest_before, rest_after: mean outputs at rest around the set, or around each point (m,); their mean is taken off,
    which removes bias and earth rate. table_u_ppm: standard uncertainty of the table's mean rate, type B; it goes
    straight into K and cancels in Kn and Ka. rest_in_halves: let the rest point (0, 0) enter the fits of K+ and K-.
    """
    w = np.asarray(rates_dps, dtype=np.float64)
    before = np.asarray(rest_before, dtype=np.float64)
    rest = before if rest_after is None else 0.5 * (before + np.asarray(rest_after, dtype=np.float64))
    f = np.asarray(outputs, dtype=np.float64) - rest
    line = fit_line(w, f)
    with np.errstate(divide="ignore", invalid="ignore"):
        reading = np.where(w == 0.0, np.nan, line.residuals / (line.slope * w) * _PPM)
    asymmetry = _asymmetry(w, f, line.slope, rest_in_halves)
    return RateSet(
        _scale_factor(w, line, table_u_ppm, unit),
        _offset(line, unit),
        _nonlinearity(w, f, line),
        asymmetry,
        w,
        line.residuals / np.abs(f).max() * _PPM,
        reading,
    )


def _scale_factor(w: NDArray[np.float64], line: Line, table_u_ppm: float, unit: str) -> Figure:
    type_a, type_b = line.slope_u, abs(line.slope) * table_u_ppm / _PPM
    u = float(np.hypot(type_a, type_b))
    dof = (len(w) - 2) * (u / type_a) ** 4 if type_a > 0.0 else np.inf
    definition = (
        f"least-squares slope over {len(w)} rates from {w.min():g} to {w.max():g} deg/s, outputs at rest taken off; "
        f"u: scatter about the line, and table rate {table_u_ppm:g} ppm"
    )
    return with_u(
        "scale factor",
        "K",
        line.slope,
        f"{unit}/(deg/s)",
        u=u,
        dof=dof,
        n=len(w),
        definition=definition,
        source=_SOURCE,
    )


def _offset(line: Line, unit: str) -> Figure:
    n = len(line.residuals)
    return with_u(
        "scale-factor line offset",
        "F0",
        line.offset,
        unit,
        u=float(np.sqrt(line.covariance[1, 1])),
        dof=n - 2,
        n=n,
        definition="output of the fitted line at zero rate, outputs at rest taken off; not the bias",
        source=_SOURCE,
    )


def _nonlinearity(w: NDArray[np.float64], f: NDArray[np.float64], line: Line) -> Figure:
    """Kn; its uncertainty is that of the residual which is largest, from the spread of all of them."""
    at = int(np.argmax(np.abs(line.residuals)))
    full_scale = float(np.abs(f).max())
    value = float(abs(line.residuals[at])) / full_scale * _PPM
    definition = (
        f"largest |F - (K W + F0)| over the largest |F|, in ppm of full scale, found at {w[at]:g} deg/s; u is the "
        "scatter of one point about the line, which holds curvature as well as noise"
    )
    return with_u(
        "scale-factor nonlinearity",
        "Kn",
        value,
        "ppm of full scale",
        u=line.residual_std / full_scale * _PPM,
        dof=len(w) - 2,
        n=len(w),
        definition=definition,
        source="GJB 2426A scale-factor nonlinearity",
    )


def _asymmetry(w: NDArray[np.float64], f: NDArray[np.float64], slope: float, rest: bool) -> Figure:
    """Ka from lines through each half on its own."""
    halves = []
    for side in (w > 0.0, w < 0.0):
        if np.count_nonzero(side) < 3:
            raise ValueError("fewer than 3 rates in one direction. Allowed: a symmetric set, 11 per direction by GJB")
        zero = np.zeros(1 if rest else 0)
        halves.append(fit_line(np.concatenate([zero, w[side]]), np.concatenate([zero, f[side]])))
    value = abs(halves[0].slope - halves[1].slope) / abs(slope) * _PPM
    variances = np.array([half.slope_u**2 for half in halves])
    dofs = np.array([len(half.residuals) - 2 for half in halves])
    dof = float(variances.sum() ** 2 / max(np.sum(variances**2 / dofs), np.finfo(np.float64).tiny))
    return with_u(
        "scale-factor asymmetry",
        "Ka",
        value,
        "ppm",
        u=float(np.sqrt(variances.sum())) / abs(slope) * _PPM,
        dof=dof,
        n=len(w),
        definition=f"|K+ - K-| / K, lines fitted to each direction, rest point {'in' if rest else 'not in'} the fits",
        source="GJB 2426A scale-factor asymmetry",
    )


def scale_factor_repeatability(factors: ArrayLike) -> Figure:
    """Kr: standard deviation of the K (Q,) of Q power cycles over their mean, in ppm."""
    k = np.asarray(factors, dtype=np.float64)
    return standard_deviation(
        k - k.mean(),
        "scale-factor repeatability",
        "Kr",
        "ppm",
        scale=_PPM / abs(float(k.mean())),
        definition=f"standard deviation (Q - 1) over the mean of K of Q = {len(k)} power cycles",
        source="GJB 2426A scale-factor repeatability",
    )


def scale_factor_temperature_sensitivity(
    temperatures_degc: ArrayLike, factors: ArrayLike, factors_u: ArrayLike, room_degc: float
) -> Figure:
    """Kt = max |(K_i - K_m) / (K_m (T_i - T_m))|, in ppm/degC, of K (m,) at soak temperatures (m,).

    m is the soak nearest room_degc; soaks closer to it than 10 degC do not count. factors_u: without the table's
    error, which all have in common.
    """
    t, k, u = (np.asarray(values, dtype=np.float64) for values in (temperatures_degc, factors, factors_u))
    steepest = sensitivity(t, k, u, room_degc)
    scale = _PPM / abs(float(k[steepest.room]))
    return with_u(
        "scale-factor temperature sensitivity",
        "Kt",
        scale * steepest.value,
        "ppm/degC",
        u=scale * steepest.u,
        dof=np.inf,
        n=len(t),
        definition=f"largest |(K_i - K_m)/(K_m (T_i - T_m))| over soaks, T_m = {t[steepest.room]:g} degC, "
        f"|T_i - T_m| >= {ROOM_DISTANCE_DEGC:g} degC, found at {t[steepest.at]:g} degC",
        source="GJB 2426A scale-factor temperature sensitivity",
    )
