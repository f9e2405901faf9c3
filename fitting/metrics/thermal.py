"""How bias depends on temperature and its rate: soaks, ramps, hysteresis."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.metrics.figure import Figure, with_u

# A ratio with T_i near T_m explodes; such soaks do not count (gyro test metrics, section 4).
ROOM_DISTANCE_DEGC = 10.0
_BIAS_SOURCE = "GJB 2426A bias temperature sensitivity"


@dataclass(frozen=True)
class Steepest:
    """The largest |(v_i - v_m) / (T_i - T_m)|, its standard uncertainty, and the rows i and m it came from."""

    value: float
    u: float
    at: int
    room: int


def sensitivity(
    temperatures_degc: NDArray[np.float64],
    values: NDArray[np.float64],
    values_u: NDArray[np.float64],
    room_degc: float,
) -> Steepest:
    """Over soaks at least 10 degC from the one nearest room_degc. ValueError: there is none."""
    room = int(np.argmin(np.abs(temperatures_degc - room_degc)))
    distance = temperatures_degc - temperatures_degc[room]
    counted = np.flatnonzero(np.abs(distance) >= ROOM_DISTANCE_DEGC)
    if not len(counted):
        raise ValueError(
            f"no soak is {ROOM_DISTANCE_DEGC:g} degC or more from {temperatures_degc[room]:g} degC. "
            "Allowed: soaks at low, room and high temperature"
        )
    slopes = (values[counted] - values[room]) / distance[counted]
    best = int(np.argmax(np.abs(slopes)))
    at = int(counted[best])
    u = float(np.hypot(values_u[at], values_u[room])) / abs(float(distance[at]))
    return Steepest(abs(float(slopes[best])), u, at, room)


@dataclass(frozen=True)
class BiasOverTemperature:
    """Bt, the table it comes from, and a polynomial through it.

    table (m, 3): temperature in degC, bias and its standard uncertainty in deg/h. polynomial: coefficients of
    1, T, T^2 ... in deg/h and degC; residual_rms_dph: about it, with n - p in the denominator (NaN for n = p).
    """

    sensitivity: Figure
    table: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    residual_rms_dph: float


def bias_temperature_sensitivity(
    temperatures_degc: ArrayLike, biases_dph: ArrayLike, biases_u_dph: ArrayLike, room_degc: float, degree: int = 2
) -> BiasOverTemperature:
    """Bt = max |(B_i - B_m) / (T_i - T_m)| in deg/h/degC over soaks (m,); m = the soak nearest room_degc.

    The maximum of noisy ratios is biased upwards by about their uncertainty; hence the table and the polynomial.
    """
    t, b, u = (np.asarray(values, dtype=np.float64) for values in (temperatures_degc, biases_dph, biases_u_dph))
    steepest = sensitivity(t, b, u, room_degc)
    figure = with_u(
        "bias temperature sensitivity",
        "Bt",
        steepest.value,
        "deg/h/degC",
        u=steepest.u,
        dof=np.inf,
        n=len(t),
        definition=f"largest |(B_i - B_m)/(T_i - T_m)| over soaks, T_m = {t[steepest.room]:g} degC, "
        f"|T_i - T_m| >= {ROOM_DISTANCE_DEGC:g} degC, found at {t[steepest.at]:g} degC",
        source=_BIAS_SOURCE,
    )
    degree = min(degree, len(t) - 1)
    polynomial = np.asarray(np.polynomial.polynomial.polyfit(t, b, degree), dtype=np.float64)
    residual = b - np.polynomial.polynomial.polyval(t, polynomial)
    left = len(t) - degree - 1
    rms = float(np.sqrt(residual @ residual / left)) if left else float("nan")
    return BiasOverTemperature(figure, np.column_stack([t, b, u]), polynomial, rms)


@dataclass(frozen=True)
class RampModel:
    """B = b0 + b1 T + b2 T^2 + b3 dT/dt [+ b4 (T_in - T_out)], in deg/h, degC and min.

    covariance: of the coefficients, residuals autocorrelated up to `lags` rows (Newey and West 1987).
    """

    coefficients: NDArray[np.float64]
    covariance: NDArray[np.float64]
    lags: int
    residual_rms_dph: float
    rate_sensitivity: Figure


def bias_temperature_rate_sensitivity(
    biases_dph: ArrayLike,
    temperature_degc: ArrayLike,
    slope_degc_min: ArrayLike,
    difference_degc: ArrayLike | None = None,
) -> RampModel:
    """b3 of the model above by least squares over averaged rows (n,) of ramps up and down.

    Rows follow each other in time, evenly. What the model leaves over is correlated from row to row: taken as white it
    would promise far too small an uncertainty. ValueError: fewer rows than twice the coefficients, or T and dT/dt
    that do not vary independently (one ramp only, or none).
    """
    b, t, slope = (np.asarray(values, dtype=np.float64) for values in (biases_dph, temperature_degc, slope_degc_min))
    columns = [np.ones_like(t), t, t**2, slope]
    if difference_degc is not None:
        columns.append(np.asarray(difference_degc, dtype=np.float64))
    matrix = np.column_stack(columns)
    scale = np.abs(matrix).max(axis=0)
    if len(b) < 2 * matrix.shape[1] or not scale.all() or np.linalg.cond(matrix / scale) > 1e8:
        raise ValueError(f"{len(b)} rows do not determine {matrix.shape[1]} coefficients. Allowed: ramps up and down")
    inverse = np.linalg.pinv(matrix / scale) / scale[:, np.newaxis]
    bread = inverse @ inverse.T
    coefficients = inverse @ b
    residual = b - matrix @ coefficients
    lags = int(4.0 * (len(b) / 100.0) ** (2.0 / 9.0))
    covariance = bread @ _newey_west(matrix * residual[:, np.newaxis], lags) @ bread
    left = len(b) - len(coefficients)
    covariance = covariance * len(b) / left
    rms = float(np.sqrt(residual @ residual / left))
    figure = with_u(
        "bias temperature-rate sensitivity",
        "B_dT",
        coefficients[3],
        "deg/h/(degC/min)",
        u=float(np.sqrt(covariance[3, 3])),
        dof=left,
        n=len(b),
        definition="b3 of B = b0 + b1 T + b2 T^2 + b3 dT/dt"
        + (" + b4 (T_in - T_out)" if difference_degc is not None else "")
        + f" by least squares; u for residuals correlated over {lags} rows (Newey-West)",
        source="GJB 2426A bias temperature-rate sensitivity",
    )
    return RampModel(coefficients, covariance, lags, rms, figure)


def _newey_west(scores: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """Long-run covariance of scores (n, p), Bartlett weights."""
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    return np.asarray(total)


def hysteresis(
    biases_dph: ArrayLike, temperature_degc: ArrayLike, slope_degc_min: ArrayLike, *, bin_degc: float, moving: float
) -> Figure:
    """Largest difference between the branches of a cycle at equal temperature, in deg/h, over averaged rows (n,).

    Rows with |dT/dt| below `moving` (degC/min) belong to neither branch. Both branches are averaged in bins of
    bin_degc; a bin counts with two rows or more of each. What it holds of a dT/dt effect is not taken out.
    ValueError: the branches share no bin.
    """
    b, t, slope = (np.asarray(values, dtype=np.float64) for values in (biases_dph, temperature_degc, slope_degc_min))
    up, down = (_branch(b, t, side, bin_degc) for side in (slope >= moving, slope <= -moving))
    shared = sorted(up.keys() & down.keys())
    if not shared:
        raise ValueError(f"no bin of {bin_degc:g} degC holds two rows of both branches. Allowed: ramps up and down")
    differences = np.array([up[k][0] - down[k][0] for k in shared])
    at = int(np.argmax(np.abs(differences)))
    where = shared[at]
    return with_u(
        "bias hysteresis",
        "B_hys",
        abs(float(differences[at])),
        "deg/h",
        u=float(np.hypot(up[where][1], down[where][1])),
        dof=up[where][2] + down[where][2],
        n=len(shared),
        definition=f"largest |B up - B down| at equal temperature, means in {len(shared)} bins of {bin_degc:g} degC, "
        f"found at {(where + 0.5) * bin_degc:g} degC",
        source="gyro test metrics, temperature programme",
    )


def _branch(
    b: NDArray[np.float64], t: NDArray[np.float64], side: NDArray[np.bool_], width: float
) -> dict[int, tuple[float, float, int]]:
    """For every bin: mean, its standard uncertainty (n - 1), and degrees of freedom."""
    bins = np.floor(t[side] / width).astype(np.int64)
    found = {}
    for key in np.unique(bins).tolist():
        values = b[side][bins == key]
        if len(values) > 1:
            found[key] = (float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values))), len(values) - 1)
    return found
