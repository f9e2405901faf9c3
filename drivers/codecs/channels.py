"""Channels: what a gyro's frame carries besides rate, temperature, status and counter.

A channel is named by what it is and the unit of its values: `anode_degc`, `rate_y_dps`, `accel_x_g`. The name is its
column in raw files and records, so that every number there says its unit.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

# The columns every frame may have, and those that raw files and records add: no channel is called like one of them.
RESERVED = ("rate", "temperature", "counter", "status", "index", "rate_dps", "temperature_degc", "good")

# suffix of a name -> its unit
UNITS: Mapping[str, str] = MappingProxyType(
    {
        "degc": "degC",
        "k": "K",
        "dps": "deg/s",
        "dph": "deg/h",
        "deg": "deg",
        "g": "g",
        "mps2": "m/s^2",
        "v": "V",
        "a": "A",
        "w": "W",
        "pa": "Pa",
        "ut": "uT",
        "hz": "Hz",
        "s": "s",
        "ppm": "ppm",
        "percent": "%",
        "counts": "",
    }
)
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*_([a-z0-9]+)")


def unit_of(name: str) -> str:
    """The unit a channel's name ends in. Raises ValueError saying what a name must be.

    >>> unit_of("anode_degc"), unit_of("rate_y_dps")
    ('degC', 'deg/s')
    """
    found = _NAME.fullmatch(name)
    if found is None or found[2] not in UNITS:
        raise ValueError(
            f"'{name}' is no name of a channel. Allowed: small letters, digits and _, ending in the unit "
            f"({', '.join('_' + unit for unit in UNITS)}), like anode_degc"
        )
    if name in RESERVED:
        raise ValueError(f"'{name}' is a column every frame has; give the channel another name, like anode_degc")
    return UNITS[found[2]]
