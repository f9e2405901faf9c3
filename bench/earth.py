"""The earth's rotation as a gyro on a vertical table axis sees it."""

from __future__ import annotations

import math

# IERS mean rate, 7.292115e-5 rad/s = 15.041067 deg/h (gyro_test_metrics section 9).
EARTH_RATE_DPS = math.degrees(7.292115e-5)


def earth_rate_dps(latitude_deg: float | None) -> float:
    """Vertical component at a latitude, counter-clockwise positive with the input axis up; 0 if it is not known.

    >>> round(earth_rate_dps(45.0) * 3600, 4)
    10.6356
    """
    return 0.0 if latitude_deg is None else EARTH_RATE_DPS * math.sin(math.radians(latitude_deg))
