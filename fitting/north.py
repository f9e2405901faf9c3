"""North seeking with gyros whose input axes lie level: heading from two or four positions, and what smoothing does.

Conventions. Body axes x, y, z are right-handed with z up; heading is the angle of x from north, clockwise seen from
above, so that y points to heading - 90 deg. An axis at heading psi feels H cos(psi) of the earth rate plus V times the
sine of its elevation, with H = w_E cos(latitude), V = w_E sin(latitude). The table turns the body about z.

With n the north and u the up direction in body axes, the gyro vector is H n + V u and (u_x, u_y) is what level
accelerometers read in g. In the second of two positions, a half turn later, n_x, n_y, u_x, u_y have changed sign:
half differences hold neither gyro nor accelerometer bias.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from fitting.earth import horizontal_dph, vertical_dph
from fitting.random_errors.autoregression import fit_ar2
from fitting.random_errors.kalman import SmoothingModel, smooth

# The literature of these experiments divides the circle into 6000 mil; NATO divides it into 6400.
MILS_PER_CIRCLE = 6000.0


@dataclass(frozen=True)
class Level:
    """Sines of the elevation of x and y above the horizon, from level accelerometers in g; (...) like the rates.

    From two positions: their half differences.
    """

    up_x: ArrayLike = 0.0
    up_y: ArrayLike = 0.0


LEVEL = Level()


def heading_deg(
    rate_x_dph: ArrayLike, rate_y_dph: ArrayLike, latitude_deg: float, level: Level = LEVEL
) -> NDArray[np.float64]:
    """Heading of x in 0 ... 360 deg from the rates about x and y (...), free of bias, in deg/h.

    Exact for any tilt: the vertical part V u is taken off, and the rest is turned into the horizontal plane. On a
    level body the latitude does not matter, and a scale factor common to both axes never does.
    """
    horizontal, vertical = horizontal_dph(latitude_deg), vertical_dph(latitude_deg)
    up_x, up_y = np.asarray(level.up_x, dtype=np.float64), np.asarray(level.up_y, dtype=np.float64)
    up_z = np.sqrt(1.0 - up_x**2 - up_y**2)
    north_x = (np.asarray(rate_x_dph, dtype=np.float64) - vertical * up_x) / horizontal
    north_y = (np.asarray(rate_y_dph, dtype=np.float64) - vertical * up_y) / horizontal
    north_z = -(north_x * up_x + north_y * up_y) / up_z
    east_x = north_y * up_z - north_z * up_y  # east = north x up
    return np.asarray(np.degrees(np.arctan2(east_x, north_x)) % 360.0)


def two_position_heading_deg(
    rate_x_dph: ArrayLike, rate_y_dph: ArrayLike, latitude_deg: float, level: Level = LEVEL
) -> NDArray[np.float64]:
    """From two gyros x, y in two positions half a turn apart: rates (2, ...) each. Biases cancel."""
    x, y = (np.asarray(rate, dtype=np.float64) for rate in (rate_x_dph, rate_y_dph))
    return heading_deg(0.5 * (x[0] - x[1]), 0.5 * (y[0] - y[1]), latitude_deg, level)


@dataclass(frozen=True)
class OneGyroHeading:
    """cos(psi) = (w1 - w2) / 2H: heading in 0 ... 180 deg, which is as well 360 - heading; bias in deg/h.

    slope_deg_per_dph: change of heading per deg/h of error of w1 - w2 / 2; infinite pointing north or south.
    """

    heading_deg: float
    bias_dph: float
    slope_deg_per_dph: float


def two_position_one_gyro(first_dph: float, second_dph: float, latitude_deg: float) -> OneGyroHeading:
    """One level gyro in two positions half a turn apart. ValueError: their difference exceeds the earth rate."""
    horizontal = horizontal_dph(latitude_deg)
    cosine = (first_dph - second_dph) / (2.0 * horizontal)
    if abs(cosine) > 1.0:
        raise ValueError(
            f"half the difference is {0.5 * (first_dph - second_dph):.6g} deg/h, the horizontal earth rate at "
            f"{latitude_deg:g} deg is {horizontal:.6g}. Check K and the latitude; pointing north, use two gyros"
        )
    psi = float(np.arccos(cosine))
    sine = float(np.sin(psi))
    slope = float(np.degrees(1.0 / (horizontal * sine))) if sine > 0.0 else float("inf")
    return OneGyroHeading(float(np.degrees(psi)), 0.5 * (first_dph + second_dph), slope)


def four_position_heading_deg(
    rates_dph: ArrayLike, latitude_deg: float, *, clockwise: bool = True, level: Level = LEVEL
) -> NDArray[np.float64]:
    """One gyro at 0, 90, 180, 270 deg: rates (4, ...); clockwise: the sense of the steps, seen from above.

    psi = atan2(-(w2 - w4), w1 - w3) for clockwise steps: after the first one the gyro lies where -y was.
    """
    w1, w2, w3, w4 = np.asarray(rates_dph, dtype=np.float64)
    sign = -1.0 if clockwise else 1.0
    return heading_deg(0.5 * (w1 - w3), sign * 0.5 * (w2 - w4), latitude_deg, level)


def heading_u_deg(rate_u_dph: float, latitude_deg: float) -> float:
    """Standard uncertainty of a heading from two gyros in two positions, or one in four: u / (sqrt(2) H).

    >>> round(60 * heading_u_deg(60 * 0.005 / 100**0.5, 40.0), 1)
    6.3
    """
    return float(np.degrees(rate_u_dph / (np.sqrt(2.0) * horizontal_dph(latitude_deg))))


def heading_error_mil(
    heading: ArrayLike, true_heading: ArrayLike, mils_per_circle: float = MILS_PER_CIRCLE
) -> NDArray[np.float64]:
    """Heading minus truth, both in deg, the short way round, in mil of the stated circle."""
    turn = (np.asarray(heading, dtype=np.float64) - np.asarray(true_heading, dtype=np.float64) + 180.0) % 360.0 - 180.0
    return np.asarray(turn * mils_per_circle / 360.0)


@dataclass(frozen=True)
class Smoothing:
    """How each sensor is smoothed: AR(2) with constant over the first fit_s seconds, then the Kalman filter.

    bias_stability (sensors,): in the unit of each sensor; its square is R, as published. It is the spread of block
    means, and may be far below the noise of one sample: the filter then believes every sample.
    """

    interval_s: float
    bias_stability: ArrayLike
    fit_s: float = 30.0

    def means(self, records: NDArray[np.float64]) -> NDArray[np.float64]:
        """Means of the smoothed traces of records (n, ..., sensors): (..., sensors)."""
        sensors = np.broadcast_to(np.asarray(self.bias_stability, dtype=np.float64), records.shape[1:])
        flat = records.reshape(len(records), -1)
        fitted = fit_ar2(flat[: round(self.fit_s / self.interval_s)].T)
        model = SmoothingModel(
            fitted.phi1,
            fitted.phi2,
            fitted.constant_of_mean,
            fitted.noise_variance,
            sensors.ravel() ** 2,
            fitted.constant_u**2,
        )
        # The first sample starts the filter and has no state of its own; it counts as it is.
        total = flat[0] + smooth(flat, model).value.sum(axis=0)
        return np.asarray((total / len(flat)).reshape(records.shape[1:]))


@dataclass(frozen=True)
class SmoothingComparison:
    """Heading errors (seekings,) in mil from plain and from smoothed means, against the truth.

    change_mil2: mean of after^2 - before^2, paired by seeking; change_u_mil2: its standard error.
    """

    before_mil: NDArray[np.float64]
    after_mil: NDArray[np.float64]
    mils_per_circle: float
    change_mil2: float
    change_u_mil2: float

    @property
    def rms_before_mil(self) -> float:
        """Root mean square error without smoothing."""
        return float(np.sqrt(np.mean(self.before_mil**2)))

    @property
    def rms_after_mil(self) -> float:
        """Root mean square error with smoothing."""
        return float(np.sqrt(np.mean(self.after_mil**2)))

    @property
    def verdict(self) -> str:
        """One sentence: does smoothing improve the heading, at 95 %?"""
        n = len(self.before_mil)
        sure = abs(self.change_mil2) > float(stdtrit(n - 1, 0.975)) * self.change_u_mil2
        effect = ("improves" if self.change_mil2 < 0.0 else "worsens") if sure else "does not change"
        scope = "" if sure else f" by more than chance in {n} seekings"
        return (
            f"smoothing {effect} the north error{scope}: {self.rms_before_mil:.4g} mil before, "
            f"{self.rms_after_mil:.4g} mil after ({self.mils_per_circle:g} mil to the circle)"
        )


def compare_smoothing(
    records: ArrayLike,
    true_heading_deg: ArrayLike,
    latitude_deg: float,
    smoothing: Smoothing,
    mils_per_circle: float = MILS_PER_CIRCLE,
) -> SmoothingComparison:
    """Seek north from plain and from smoothed means of the same records, many times.

    records: (seekings, 2 positions, 4 sensors, n): gyros x and y in deg/h, accelerometers x and y in g.
    true_heading_deg: (seekings,) of x in the first position. ValueError: fewer than 2 seekings.
    """
    data = np.asarray(records, dtype=np.float64)
    if data.ndim != 4 or data.shape[1:3] != (2, 4) or len(data) < 2:
        raise ValueError(f"records {data.shape}. Allowed: (2 or more seekings, 2 positions, 4 sensors, samples)")
    plain = data.mean(axis=-1)
    smoothed = np.array([smoothing.means(np.moveaxis(seeking, -1, 0)) for seeking in data])
    before, after = (
        heading_error_mil(_two_positions(means, latitude_deg), true_heading_deg, mils_per_circle)
        for means in (plain, smoothed)
    )
    change = after**2 - before**2
    u = float(change.std(ddof=1)) / float(np.sqrt(len(change)))
    return SmoothingComparison(before, after, mils_per_circle, float(change.mean()), u)


def _two_positions(means: NDArray[np.float64], latitude_deg: float) -> NDArray[np.float64]:
    """Headings (seekings,) from means (seekings, 2, 4)."""
    half = 0.5 * (means[:, 0] - means[:, 1])
    return heading_deg(half[:, 0], half[:, 1], latitude_deg, Level(half[:, 2], half[:, 3]))
