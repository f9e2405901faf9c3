"""Kalman filter of the AR(2)-with-constant model, for many sensors and runs at once.

State x = (y_k, y_(k-1), c), measured z_k = y_k + noise:

    x_k = [[phi1, phi2, 1], [1, 0, 0], [0, 0, 1]] x_(k-1) + (a_k, 0, 0),  R = variance of the measurement noise.

Sensors do not share a state, so the 12-state filter of four sensors (reference experiment `north`) is four of these,
exactly. Gains and covariances depend on the model only, never on the data: they are computed once per sensor and
serve every run of it. c has no noise of its own, so that its gain falls as 1/k for ever: there is no steady state to
take a short cut to.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

# A float, or an array over sensors or runs. Up to _FEW of them are filtered one after the other as floats, which
# python adds an order of magnitude faster than arrays of that length.
Values = Any
_FEW = 12


@dataclass(frozen=True)
class SmoothingModel:
    """What the filter believes. Values are floats, or arrays (sensors,) for several sensors.

    process_variance: of a_k; measurement_variance: R, by reference experiment `north` the square of the bias
    stability; constant_variance: of c at the start, its squared standard error from the fit.
    """

    phi1: ArrayLike
    phi2: ArrayLike
    constant: ArrayLike
    process_variance: ArrayLike
    measurement_variance: ArrayLike
    constant_variance: ArrayLike


@dataclass(frozen=True)
class Smoothed:
    """The filter after each measurement from the second on: state (n - 1, 3, ...), covariance (n - 1, 3, 3, sensors).

    For one sensor the last axis of the covariance is missing.
    """

    state: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def value(self) -> NDArray[np.float64]:
        """The smoothed signal y, (n - 1, ...)."""
        return self.state[:, 0]

    @property
    def constant(self) -> NDArray[np.float64]:
        """The estimate of c, (n - 1, ...)."""
        return self.state[:, 2]


def smooth(measurements: ArrayLike, model: SmoothingModel) -> Smoothed:
    """Filter measurements (n,) or (n, runs) of one sensor, (n, sensors) or (n, runs, sensors) of several.

    The first two measurements start it: x = (z_1, z_0, c) with covariance diag(R, R, constant_variance); the filter
    then runs over z_2 ... and the first row returned is that start. ValueError: fewer than 3 measurements, not finite.
    """
    z = np.asarray(measurements, dtype=np.float64)
    if len(z) < 3 or not np.isfinite(z).all():
        raise ValueError(f"{len(z)} measurements, or some not finite. Allowed: 3 or more, without gaps; fill them")
    columns = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in vars(model).values()))
    if columns[0].ndim == 0:
        return _one_sensor(z, [float(column) for column in columns])
    if z.ndim < 2 or z.shape[-1] != len(columns[0]):
        raise ValueError(f"measurements {z.shape} for {len(columns[0])} sensors. Allowed: the last axis runs over them")
    if len(columns[0]) > _FEW:
        gains, covariance = _gains(list(columns), len(z) - 1)
        return Smoothed(_states(z, list(columns), gains), covariance)
    sensors = [_one_sensor(z[..., i], [float(column[i]) for column in columns]) for i in range(len(columns[0]))]
    return Smoothed(*(np.stack([getattr(one, name) for one in sensors], axis=-1) for name in ("state", "covariance")))


def _one_sensor(z: NDArray[np.float64], parameters: list[Values]) -> Smoothed:
    """z (n,) or (n, runs); the gains are floats."""
    gains, covariance = _gains(parameters, len(z) - 1)
    if z.ndim == 1 or z.shape[1] > _FEW:
        return Smoothed(_states(z, parameters, gains), covariance)
    return Smoothed(np.stack([_states(run, parameters, gains) for run in z.T], axis=-1), covariance)


def _gains(parameters: list[Values], count: int) -> tuple[list[tuple[Values, Values, Values]], NDArray[np.float64]]:
    """Kalman gains for every step but the start, and covariances from the start on, (count, 3, 3, ...).

    Each step predicts F P F' + Q and updates by a measurement of y, written out for the six different entries.
    """
    phi1, phi2, _, process, noise, p33 = parameters
    p11, p22 = noise, noise
    p12 = p13 = p23 = 0.0 * noise
    gains: list[tuple[Values, Values, Values]] = []
    history = [p11, p12, p13, p22, p23, p33]
    for _ in range(count - 1):
        row1 = phi1 * p11 + phi2 * p12 + p13
        row2 = phi1 * p12 + phi2 * p22 + p23
        row3 = phi1 * p13 + phi2 * p23 + p33
        first = phi1 * row1 + phi2 * row2 + row3 + process
        total = first + noise
        k2, k3 = row1 / total, row3 / total
        gains.append((first / total, k2, k3))
        kept = noise / total  # 1 - k1, without its cancellation
        p22, p23, p33 = p11 - k2 * row1, p13 - k2 * row3, p33 - k3 * row3
        p11, p12, p13 = first * kept, row1 * kept, row3 * kept
        history += (p11, p12, p13, p22, p23, p33)
    upper: NDArray[np.float64] = np.array(history)
    upper = upper.reshape(count, 6, *upper.shape[1:])
    full = upper[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]]
    return gains, full.reshape(count, 3, 3, *upper.shape[2:])


def _states(
    z: NDArray[np.float64], parameters: list[Values], gains: list[tuple[Values, Values, Values]]
) -> NDArray[np.float64]:
    """The state after every measurement, (n - 1, 3, ...)."""
    phi1, phi2, constant = parameters[:3]
    rows: list[Any] = z.tolist() if z.ndim == 1 else list(z)
    before, now = rows[:2]
    constant = constant + 0.0 * now
    history = [now, before, constant]
    for measured, (k1, k2, k3) in zip(rows[2:], gains, strict=True):
        predicted = phi1 * now + phi2 * before + constant
        innovation = measured - predicted
        now, before, constant = predicted + k1 * innovation, now + k2 * innovation, constant + k3 * innovation
        history += (now, before, constant)
    found: NDArray[np.float64] = np.array(history)
    return found.reshape(-1, 3, *found.shape[1:])
