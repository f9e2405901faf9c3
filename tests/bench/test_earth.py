"""The vertical earth rate against published figures."""

import pytest

from bench.earth import earth_rate_dps


@pytest.mark.parametrize(
    ("latitude_deg", "deg_per_h"),
    # 15.041067 deg/h is one turn in a sidereal day of 86164.0905 s; 7.5205 is its half at 30 degrees.
    [(90.0, 360.0 * 3600 / 86164.0905), (-90.0, -15.041067), (30.0, 7.5205), (0.0, 0.0), (45.0, 10.63564)],
)
def test_vertical_component(latitude_deg: float, deg_per_h: float) -> None:
    assert earth_rate_dps(latitude_deg) * 3600 == pytest.approx(deg_per_h, abs=1e-4)


def test_an_unknown_latitude_adds_nothing() -> None:
    assert earth_rate_dps(None) == 0.0
