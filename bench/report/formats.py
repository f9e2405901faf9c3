"""Numbers, durations and sizes as the report prints them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

MISSING = "–"
MINUS = "\N{MINUS SIGN}"
THIN = "\N{NARROW NO-BREAK SPACE}"


def significant(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits, never in exponent form; '–' where there is no number.

    >>> significant(11.6008), significant(-0.00028412), significant(4.0), significant(None)
    ('11.6', '−0.000284', '4.00', '–')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0:
        return "0"
    exponent = int(f"{abs(value):.{digits - 1}e}".partition("e")[2])
    text = f"{abs(value):.{max(0, digits - 1 - exponent)}f}"
    return (MINUS if value < 0 else "") + text


def fixed(value: float | None, decimals: int) -> str:
    """`value` with a fixed number of decimals and a true minus sign; '–' where there is no number."""
    if value is None or not math.isfinite(value):
        return MISSING
    text = f"{abs(value):.{decimals}f}"
    return (MINUS if value < 0 and float(text) else "") + text


def count(value: float | None) -> str:
    """A whole number with its thousands set apart.

    >>> count(84360000) == "84{0}360{0}000".format(THIN), count(703), count(None)
    (True, '703', '–')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{round(value):,}".replace(",", THIN).replace("-", MINUS)


def duration(seconds: float | None) -> str:
    """A duration in the two units that matter.

    >>> duration(583_440), duration(200), duration(38.24), duration(None)
    ('162 h 04 min', '3 min 20 s', '38.2 s', '–')
    """
    if seconds is None or not math.isfinite(seconds):
        return MISSING
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    if seconds < 3599.5:
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest:02d} s"
    hours, rest = divmod(round(seconds / 60), 60)
    return f"{hours} h {rest:02d} min"


def ratio(before: float | None, after: float | None) -> str:
    """How many times larger `before` is than `after`, to two digits (three from 100 on).

    >>> ratio(4.62, 0.0153), ratio(4.62, 0.18), ratio(4.62, 1.7), ratio(4.62, None)
    ('302', '26', '2.7', '–')
    """
    if before is None or not after or not math.isfinite(before) or not math.isfinite(after):
        return MISSING
    times = before / after
    return significant(times, 2) if times < 9.95 else count(float(f"{times:.3g}"))


def setpoint(value: float | None) -> str:
    """A setpoint as it was asked for: no more decimals than it needs.

    >>> setpoint(-30.0), setpoint(2.5)
    ('−30', '2.5')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{value:.6g}".replace("-", MINUS)


def fault(error: Exception, path: Path) -> str:
    """What went wrong with the file, without the folders of the machine the report was written on.

    >>> fault(ValueError("/lab/results/r1/points.csv: no columns"), Path("/lab/results/r1/points.csv"))
    'points.csv: no columns'
    """
    return str(error).replace(str(path), path.name)


def decimals_missing(texts: Iterable[str]) -> list[int]:
    """How many digits of padding each text of a column needs so that the decimal points stand below each other.

    >>> decimals_missing(["11.60", "0.0153", "–"])
    [2, 0, 4]
    """
    decimals = [len(text.partition(".")[2]) if _is_number(text) else 0 for text in texts]
    most = max(decimals, default=0)
    return [most - places for places in decimals]


def _is_number(text: str) -> bool:
    return text.replace(MINUS, "").replace(".", "", 1).isdigit()


def unbroken(name: str) -> str:
    """`name` with a word joiner behind each hyphen, so that a narrow column does not break 'gyro-a' in two."""
    return name.replace("-", "-\N{WORD JOINER}")


def listed(words: Sequence[str]) -> str:
    """'a', 'a and b', 'a, b and c'.

    >>> listed(["a"]), listed(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else list(words))
