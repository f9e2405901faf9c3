"""Quantities in YAML ('2 h', '-30 degC', '10 deg/s') become floats once, at the edge (law 11).

A unit is allowed for one dimension only; a dimension is named by the suffix that variable and field names carry
(`rate_dps`, `temperature_degc`), so that the suffix of a dataclass field says which units its YAML key takes.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Dimension:
    """Factors to the unit of the suffix, and an example for messages."""

    name: str
    factors: dict[str, float]
    example: str


_DEG = math.pi / 180.0
_SPELLINGS = {"°C": "degC", "°": "deg", "√": "sqrt", "²": "^2", "µ": "u", "sqrth": "sqrt(h)"}

DIMENSIONS: dict[str, Dimension] = {
    "s": Dimension("time", {"s": 1, "ms": 1e-3, "min": 60, "h": 3600, "d": 86400}, "2 h"),
    "degc": Dimension("temperature", {"degC": 1}, "-30 degC"),
    "k": Dimension("temperature difference", {"K": 1, "degC": 1}, "0.5 K"),
    "degc_min": Dimension(
        "temperature slope",
        {"degC/min": 1, "K/min": 1, "degC/h": 1 / 60, "K/h": 1 / 60, "degC/s": 60, "K/s": 60},
        "1 degC/min",
    ),
    "deg": Dimension("angle", {"deg": 1, "arcmin": 1 / 60, "arcsec": 1 / 3600, "rad": 1 / _DEG}, "90 deg"),
    "arcsec": Dimension("small angle", {"arcsec": 1, "arcmin": 60, "deg": 3600}, "1 arcsec"),
    "dps": Dimension("angular rate", {"deg/s": 1, "deg/min": 1 / 60, "deg/h": 1 / 3600, "rad/s": 1 / _DEG}, "10 deg/s"),
    "dps2": Dimension("angular acceleration", {"deg/s^2": 1, "deg/s2": 1}, "50 deg/s^2"),
    "dph": Dimension("drift rate", {"deg/h": 1, "deg/s": 3600}, "1 deg/h"),
    "deg_sqrt_h": Dimension("angle random walk", {"deg/sqrt(h)": 1}, "0.05 deg/sqrt(h)"),
    "dph_sqrt_h": Dimension("rate random walk", {"deg/h/sqrt(h)": 1}, "0.1 deg/h/sqrt(h)"),
    "dph_h": Dimension("rate ramp", {"deg/h/h": 1}, "0.01 deg/h/h"),
    "hz": Dimension("frequency", {"Hz": 1, "kHz": 1e3}, "100 Hz"),
    "ppm": Dimension("ratio", {"ppm": 1, "%": 1e4}, "100 ppm"),
    "ppm_k": Dimension("scale-factor slope", {"ppm/K": 1, "ppm/degC": 1}, "5 ppm/K"),
    "ppm_k2": Dimension("scale-factor curvature", {"ppm/K^2": 1, "ppm/degC^2": 1}, "0.1 ppm/K^2"),
    "dph_k": Dimension("bias slope", {"deg/h/K": 1, "deg/h/degC": 1}, "0.02 deg/h/K"),
    "v": Dimension("voltage", {"V": 1, "mV": 1e-3}, "28 V"),
    "a": Dimension("current", {"A": 1, "mA": 1e-3}, "2 A"),
    "w": Dimension("power", {"W": 1, "kW": 1e3}, "2 kW"),
    "w_k": Dimension("heat conductance", {"W/K": 1}, "100 W/K"),
    "j_k": Dimension("heat capacity", {"J/K": 1, "kJ/K": 1e3}, "4 kJ/K"),
    "byte": Dimension("size", {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9}, "2 GB"),
}

# ASCII digits, and no quantity is longer than this: the pattern may backtrack over a text that is almost a number.
_QUANTITY = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*([^0-9\s].*)?")
_LONGEST = 100
_LONGEST_READABLE_S = 1e11


def split_suffix(field: str) -> tuple[str, str | None]:
    """Split a field name into its YAML key and the suffix that names its dimension.

    >>> split_suffix("data_rate_hz"), split_suffix("slope_degc_min"), split_suffix("axis")
    (('data_rate', 'hz'), ('slope', 'degc_min'), ('axis', None))
    """
    for suffix in sorted(DIMENSIONS, key=len, reverse=True):
        if field.endswith("_" + suffix):
            return field[: -len(suffix) - 1], suffix
    return field, None


def parse_quantity(value: object, suffix: str) -> float:
    """Convert YAML `value` to a float in the unit of `suffix`.

    Raises ValueError that names the dimension, the units allowed and an example.

    >>> parse_quantity("2 h", "s"), parse_quantity("-30 °C", "degc"), parse_quantity("36 deg/h", "dps")
    (7200.0, -30.0, 0.01)
    """
    dimension = DIMENSIONS[suffix]
    units = ", ".join(dimension.factors)
    allowed = f"Allowed for {dimension.name}: a number with a unit out of {units}, e.g. '{dimension.example}'"
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"{shown(value)} is not a quantity. {allowed}")
    if not isinstance(value, str) and math.isfinite(value):
        raise ValueError(f"{value} has no unit. {allowed}")
    text = str(value).strip()
    match = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    if match is None:
        raise ValueError(f"{shown(text)} is not a finite number with a unit. {allowed}")
    number, unit = float(match[1]), (match[2] or "").strip()
    for spelling, plain in _SPELLINGS.items():
        unit = unit.replace(spelling, plain)
    if unit not in dimension.factors:
        reason = f"has the unit '{unit}', which is no unit of {dimension.name}" if unit else "has no unit"
        raise ValueError(f"'{text}' {reason}. {allowed}")
    result = number * dimension.factors[unit]
    if not math.isfinite(result):
        raise ValueError(f"'{text}' is too large. {allowed}")
    return result


def shown(value: object) -> str:
    """A YAML value as messages show it: short, whatever it is.

    >>> shown("10 deg/s"), shown(None), shown({"from": 1}), shown([1, 2]), shown(True), shown(5)
    ("'10 deg/s'", 'nothing', 'a mapping', 'a list', 'true', '5')
    """
    if value is None:
        return "nothing"
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value)
    text = text if len(text) <= _LONGEST else f"{text[:60]}…"
    return f"'{text}'" if isinstance(value, str) else text


def number(value: float) -> str:
    """A number of a message, with every figure that somebody wrote and none that arithmetic added.

    >>> number(0.1 + 0.2), number(-180.0), number(1002.115)
    ('0.3', '-180', '1002.115')
    """
    return f"{value:.9g}"


def format_duration(seconds: float) -> str:
    """Readable duration.

    >>> format_duration(563_000), format_duration(95), format_duration(0.4)
    ('6 d 12 h 23 min', '1 min 35 s', '0.4 s')
    """
    if seconds < 60 or seconds > _LONGEST_READABLE_S:
        return f"{seconds:.3g} s"
    days, rest = divmod(round(seconds), 86400)
    hours, rest = divmod(rest, 3600)
    minutes, secs = divmod(rest, 60)
    parts = [(days, "d"), (hours, "h"), (minutes, "min")] + ([(secs, "s")] if not days and not hours else [])
    return " ".join(f"{number} {unit}" for number, unit in parts if number)


def counted(count: int, what: str) -> str:
    """A count with its noun.

    >>> counted(1, "point"), counted(703, "point")
    ('1 point', '703 points')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"
