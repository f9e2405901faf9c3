"""What a sensitive axis on the table feels: the table's rate, the earth's rotation, and gravity.

The input of a frame is a mean over the frame, exact at rest and at any constant rate. While the table changes its rate
within a frame, the way is exact and its cosine is off by less than a hundred thousandth of the earth's rate.
"""

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.rate_table import TablePlant

# Sidereal rotation, 7.292115e-5 rad/s (WGS 84).
EARTH_RATE_DPS = 15.041067 / 3600.0
_DEG = np.pi / 180.0
_ARCSEC = _DEG / 3600.0

Floats = NDArray[np.float64]


def earth_rate_dps(latitude_deg: float | None) -> float:
    """The vertical component of the earth's rotation, 0 if the latitude is not given."""
    return 0.0 if latitude_deg is None else EARTH_RATE_DPS * sin(latitude_deg * _DEG)


def level_earth_rate_dps(latitude_deg: float | None) -> float:
    """The northward component of the earth's rotation, 0 if the latitude is not given."""
    return 0.0 if latitude_deg is None else EARTH_RATE_DPS * cos(latitude_deg * _DEG)


class InputAxis(Protocol):
    """The axis of a gyro."""

    earth_dps: float

    def mean_rate_of_frames(self, first: int, rows: int, columns: int, frame_s: float) -> Floats:
        """True mean rate of frames first … first + rows·columns - 1; its owner may change the array."""
        ...

    def rate_dps(self, times_s: Floats) -> Floats:
        """True rate at rising times, without the table's ripple."""
        ...


@dataclass
class VerticalAxis:
    """Along the table's axis, up. earth_dps: the vertical component of the earth's rotation."""

    table: TablePlant
    earth_dps: float

    def mean_rate_of_frames(self, first: int, rows: int, columns: int, frame_s: float) -> Floats:
        """See InputAxis."""
        rate = self.table.mean_rate_of_frames(first, rows, columns, frame_s)
        if self.earth_dps:
            rate += self.earth_dps
        return rate

    def rate_dps(self, times_s: Floats) -> Floats:
        """See InputAxis."""
        return np.array([self.table.true_rate_dps(t) for t in times_s.tolist()]) + self.earth_dps


@dataclass(frozen=True)
class Tilt:
    """How far the table's axis leans (rad), and the azimuth it leans to (deg)."""

    size: float
    azimuth_deg: float


class LevelAxis:
    """In the table's plane and turning with it, but for its own small rise out of that plane.

    azimuth_deg: clockwise from north, at table angle 0. latitude_deg: None leaves the earth's rotation out.
    """

    def __init__(
        self, table: TablePlant, latitude_deg: float | None, azimuth_deg: float, rise_arcsec: float, tilt: Tilt
    ) -> None:
        self._table, self._azimuth_deg, self._tilt = table, azimuth_deg, tilt
        self._rise = rise_arcsec * _ARCSEC
        # What a gyro in the vertical would have of the earth's rotation: leaks in by the rise.
        self.earth_dps = earth_rate_dps(latitude_deg)
        self._north_dps = level_earth_rate_dps(latitude_deg)

    def azimuth_deg(self, times_s: Floats) -> Floats:
        """True azimuth at rising times, 0 … 360 deg clockwise from north."""
        return np.asarray(np.mod(self._azimuth_deg - self._table.angles_deg(times_s), 360.0))

    def rate_dps(self, times_s: Floats) -> Floats:
        """See InputAxis."""
        table_dps = np.array([self._table.true_rate_dps(t) for t in times_s.tolist()])
        return self._felt(self.azimuth_deg(times_s), np.zeros(len(times_s)), table_dps)

    def mean_rate_of_frames(self, first: int, rows: int, columns: int, frame_s: float) -> Floats:
        """See InputAxis."""
        middle_deg, turn_deg, table_dps = self._frames(first, rows, columns, frame_s)
        return self._felt(middle_deg, turn_deg, table_dps)

    def mean_pull_of_frames(self, first: int, rows: int, columns: int, frame_s: float) -> Floats:
        """Mean specific force along the axis in g: the sine of its rise above the horizon."""
        middle_deg, turn_deg, _ = self._frames(first, rows, columns, frame_s)
        return self._elevation(middle_deg, turn_deg)

    def _frames(self, first: int, rows: int, columns: int, frame_s: float) -> tuple[Floats, Floats, Floats]:
        """Azimuth half way, way turned counter-clockwise, and table rate of each frame."""
        count = rows * columns
        table_dps = self._table.mean_rate_of_frames(first, rows, columns, frame_s)
        starts_s = np.arange(first, first + count, dtype=np.float64) * frame_s
        turn_deg = table_dps * frame_s
        return self._azimuth_deg - (self._table.angles_deg(starts_s) + 0.5 * turn_deg), turn_deg, table_dps

    def _felt(self, azimuth_deg: Floats, turn_deg: Floats, table_dps: Floats) -> Floats:
        level = self._north_dps * np.cos(azimuth_deg * _DEG) * _mean_factor(turn_deg)
        return np.asarray(level + self.earth_dps * self._elevation(azimuth_deg, turn_deg) + table_dps * self._rise)

    def _elevation(self, azimuth_deg: Floats, turn_deg: Floats) -> Floats:
        lean = self._tilt.size * np.cos((azimuth_deg - self._tilt.azimuth_deg) * _DEG) * _mean_factor(turn_deg)
        return np.asarray(self._rise - lean)


def _mean_factor(turn_deg: Floats) -> Floats:
    """What the mean over a turn is of the cosine half way: sin(x)/x of half the turn."""
    return np.sinc(turn_deg / 360.0)


def tilt_of(size_arcsec: float, azimuth_deg: float) -> Tilt:
    """A tilt by its size in arcsec."""
    return Tilt(radians(size_arcsec / 3600.0), azimuth_deg)
