"""The two precisions of exported code, and what rounding may do in each."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import RATE, RATE_INPUT

Name = Literal["double", "float"]
# Roundings of the magnitude that an output may be off: a few of arithmetic and of exp, tanh and sqrt of any libm.
UNITS = 8.0
_STEP = 1e-4


@dataclass(frozen=True)
class Precision:
    """A floating type of C. suffix: of its literals and of math.h; mark: of the names of the code."""

    name: Name
    dtype: type[np.floating[Any]]
    size: int
    suffix: str
    mark: str

    @property
    def unit(self) -> float:
        """Largest relative error of one rounding."""
        return 0.5 * float(np.finfo(self.dtype).eps)

    def literal(self, value: float) -> str:
        """The shortest text that reads back as the same number of this type."""
        return f"{self.dtype(value)!s}{self.suffix}"


DOUBLE = Precision("double", np.float64, 8, "", "")
FLOAT = Precision("float", np.float32, 4, "f", "_f")
PRECISIONS: Mapping[str, Precision] = {"double": DOUBLE, "float": FLOAT}


def in_precision(compensation: Compensation, precision: Precision) -> Compensation:
    """The same model with each of its numbers rounded to a precision, to be evaluated in double."""
    if precision is DOUBLE:
        return compensation
    return replace(
        compensation,
        model=_rounded(compensation.model),
        reach=_rounded(compensation.reach),
        rate_slope=_rounded(compensation.rate_slope),
    )


def _rounded(value: Any) -> Any:
    """Arrays and numbers of a model, which is a dataclass of them and of its like, as float32 has them."""
    if isinstance(value, float):
        return float(np.float32(value))
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.astype(np.float32).astype(np.float64)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{one.name: _rounded(getattr(value, one.name)) for one in fields(value)})
    return value


def rounding_bound(
    compensation: Compensation, form: Form, rows: NDArray[np.float64], precision: Precision
) -> NDArray[np.float64]:
    """How far the output for rows (n, k) of code in a precision may be from the model's in double, (n,).

    To first order: the sums of the model, and for a row outside its way back into the training range.
    """
    held, outside = compensation.reach.bring_inside(rows)
    moved = np.zeros(len(rows))
    reach = compensation.reach
    for k in range(rows.shape[1]):
        step = np.zeros(rows.shape[1])
        step[k] = _STEP * reach.half_range[k]
        slope = (compensation.model.predict(held + step) - compensation.model.predict(held - step)) / (2.0 * step[k])
        moved += np.abs(slope) * (np.abs(reach.centre[k]) + reach.half_range[k])
    if compensation.output == RATE:
        rate = compensation.inputs.index(RATE_INPUT)
        moved += np.abs(compensation.rate_slope) * (np.abs(rows[:, rate]) + np.abs(held[:, rate]))
    return np.asarray(UNITS * precision.unit * (form.magnitude(held) + np.where(outside, moved, 0.0)))
