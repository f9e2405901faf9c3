"""What a limit may be on: its name in words, and the unit its figures are shown in."""

from __future__ import annotations

from dataclasses import dataclass

# Below this limit a rate is shown in deg/h.
SMALL_DPS = 1e-3


@dataclass(frozen=True)
class Shown:
    """A figure times `factor` is in `unit`; the unit is empty for ratios."""

    words: str
    unit: str
    factor: float = 1.0

    def text(self, value: float, digits: int = 4) -> str:
        """A figure as a message has it.

        >>> shown("std_dps", 0.01 / 3600).text(0.01 / 3600)
        '0.01 deg/h'
        """
        return f"{value * self.factor:.{digits}g} {self.unit}".rstrip()


_WORDS = {
    "max_abs_dps": "largest error",
    "std_dps": "standard deviation",
    "times_floor": "standard deviation in noise floors",
    "rms_mil": "rms error",
}


def shown(quantity: str, limit: float | None) -> Shown:
    """How figures of a quantity are shown beside this limit; an unknown quantity as it is."""
    words = _WORDS.get(quantity, quantity.replace("_", " "))
    if quantity.endswith("_dps"):
        small = limit is not None and abs(limit) < SMALL_DPS
        return Shown(words, "deg/h", 3600.0) if small else Shown(words, "deg/s")
    return Shown(words, "mil" if quantity.endswith("_mil") else "")
