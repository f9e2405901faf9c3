"""The earth's rotation, level and vertical, at a latitude."""

from math import cos, degrees, radians, sin

# IERS mean rate, 7.292115e-5 rad/s = 15.041067 deg/h; 1 deg/h is 1 arcsec/s.
EARTH_RATE_DPH = degrees(7.292115e-5) * 3600.0


def vertical_dph(latitude_deg: float) -> float:
    """Up component, positive on the northern hemisphere.

    >>> round(vertical_dph(39.9), 4)
    9.6481
    """
    return EARTH_RATE_DPH * sin(radians(latitude_deg))


def horizontal_dph(latitude_deg: float) -> float:
    """North component.

    >>> round(horizontal_dph(39.9), 4)
    11.539
    """
    return EARTH_RATE_DPH * cos(radians(latitude_deg))
