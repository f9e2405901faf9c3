"""What goes into a model and what comes out: names and units, as a model file states them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fitting.strict_json import Refused, member, number

MOST_INPUTS = 64
_NAME = re.compile("[a-z][a-z0-9_]{0,63}")


@dataclass(frozen=True)
class Column:
    """A named quantity: name in lower case with underscores, unit as text ('degC', 'degC/min', 'deg/s', ...)."""

    name: str
    unit: str

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(
                f"the name {self.name[:40]!r} is not allowed; lower case letters, digits and underscores, up to 64"
            )
        if not (self.unit.isascii() and self.unit.isprintable() and len(self.unit) <= 20):
            raise ValueError(f"the unit {self.unit[:40]!r} is not allowed; up to 20 printable ASCII characters")


TEMPERATURE = Column("temperature", "degC")
RATE_INPUT = Column("rate_output", "deg/s")
CAMPAIGN_INPUTS = (TEMPERATURE, RATE_INPUT)

RATE = Column("rate", "deg/s")
BIAS_ERROR_DPS = Column("bias_error", "deg/s")
BIAS_ERROR_DPH = Column("bias_error", "deg/h")
OUTPUTS = (RATE, BIAS_ERROR_DPS, BIAS_ERROR_DPH)

_SUFFIX = {"deg/s": "dps", "deg/h": "dph"}


def figure_name(stem: str, output: Column) -> str:
    """Name of a figure in the unit of the output, as in training_std_dps."""
    return f"{stem}_{_SUFFIX[output.unit]}"


def checked_inputs(inputs: Sequence[Column] | None, n_inputs: int) -> tuple[Column, ...]:
    """The inputs of an estimator of n_inputs columns; ValueError if they do not fit it or each other."""
    if inputs is None:
        if n_inputs != len(CAMPAIGN_INPUTS):
            raise ValueError(
                f"it was fitted on {n_inputs} inputs instead of temperature and rate; name them with inputs=[Column...]"
            )
        return CAMPAIGN_INPUTS
    if len(inputs) != n_inputs:
        raise ValueError(f"{len(inputs)} inputs are named and it was fitted on {n_inputs}")
    if len({column.name for column in inputs}) != len(inputs):
        raise ValueError("two inputs have the same name")
    return tuple(inputs)


def read_column(where: str, described: dict[str, Any]) -> Column:
    """Name and unit of an input or of the output; mean and std must be numbers."""
    for key in ("mean", "std"):
        number(described.get(key), f"{where}{key}")
    name, unit = (member(described, key, str, where) for key in ("name", "unit"))
    try:
        return Column(name, unit)
    except ValueError as error:
        raise Refused(f"{where[:-1]}: {error}") from None
