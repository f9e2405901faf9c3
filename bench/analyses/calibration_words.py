"""Figures of a calibration as text: digits that the uncertainty allows, and limits that say what they are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

# Figures of the fit: their lower limit is 0 if the record does not need the term; then only the upper one is a claim.
FITTED = ("Qn", "N", "B", "Krw", "R")


def digits(value: float | None, u: float | None, least: int = 4) -> str:
    """A number to two digits of its uncertainty, or with `least` significant digits if there is none.

    >>> digits(1.0000483, 2.03e-05), digits(0.0493955, 0.0132), digits(432.0, None), digits(None, None)
    ('1.000048', '0.049', '432', '–')
    """
    if value is None:
        return "–"
    if not u or not math.isfinite(u):
        return f"{value:.{least}g}"
    places = max(0, 1 - math.floor(math.log10(u)))
    return f"{value:.{places}f}" if places <= 12 else f"{value:.{least}g}"


def polynomial_of(table: Mapping[str, Any]) -> str:
    """The polynomial through a table of bias over temperature, and what it leaves.

    >>> polynomial_of({"polynomial": [0.04, -1e-4, 2e-6], "residual_rms_dph": 0.01})
    'B = 0.04 - 0.0001 T + 2e-06 T^2 deg/h, T in degC; residual rms 0.01 deg/h'
    """
    first, *others = table["polynomial"]
    terms = [f"{'-' if c < 0 else '+'} {abs(c):.4g} T{f'^{k}' if k > 1 else ''}" for k, c in enumerate(others, 1)]
    rms = table["residual_rms_dph"]
    left = "" if rms is None else f"; residual rms {rms:.3g} deg/h"
    return f"B = {' '.join([f'{first:.4g}', *terms])} deg/h, T in degC{left}"


def value_of(one: Mapping[str, Any]) -> str:
    """The value of a figure's record; a fitted term that the record does not need has only an upper limit.

    >>> value_of({"symbol": "R", "value": 0.002, "u": 0.01, "low": 0.0, "high": 0.04})
    'below 0.040'
    """
    if is_upper_limit(one):
        return f"below {digits(one['high'], one['u'])}"
    return digits(one["value"], one["u"])


def is_upper_limit(one: Mapping[str, Any]) -> bool:
    """Whether only the upper limit may be quoted."""
    return one["symbol"] in FITTED and not one["low"] and one["high"] is not None


def limits_of(one: Mapping[str, Any]) -> str:
    """The limits for 95 %; of a bound nothing more is said.

    >>> limits_of({"symbol": "Br", "value": 0.5, "u": 0.1, "low": 0.312, "high": 1.23})
    '0.31 to 1.23'
    """
    if is_upper_limit(one) or one["low"] is None or one["high"] is None:
        return "–"
    return f"{digits(one['low'], one['u'])} to {digits(one['high'], one['u'])}"


def expanded_of(one: Mapping[str, Any]) -> str:
    """Half the width of the limits for 95 %, for figures whose limits lie evenly about them; else the limits.

    >>> expanded_of({"symbol": "B0", "value": 0.05, "u": 0.0132, "low": 0.0235, "high": 0.0765})
    '± 0.026'
    """
    if is_upper_limit(one) or one["low"] is None or one["high"] is None:
        return "–"
    above, below = one["high"] - one["value"], one["value"] - one["low"]
    if one["u"] and abs(above - below) < 0.02 * (above + below):
        return f"± {digits(0.5 * (above + below), one['u'])}"
    return limits_of(one)
