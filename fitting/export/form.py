"""What a form of model is made of once it leaves Python: tables, C statements, costs, rounding."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitting.modelfiles.columns import Column


@dataclass(frozen=True)
class Operations:
    """Arithmetic of one evaluation. functions: calls of exp, tanh or sqrt."""

    adds: int = 0
    multiplies: int = 0
    divides: int = 0
    functions: int = 0
    compares: int = 0

    def __add__(self, other: "Operations") -> "Operations":
        return Operations(*(a + b for a, b in zip(self.counts(), other.counts(), strict=True)))

    def counts(self) -> tuple[int, int, int, int, int]:
        """In the order of the fields."""
        return self.adds, self.multiplies, self.divides, self.functions, self.compares


class Label(NamedTuple):
    """What a column of a table holds, and its unit; '' for a plain number."""

    name: str
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """Coefficients by rows and named columns: values (rows, columns), in C one array, row by row.

    whole: they are small whole numbers from 0, such as powers, and stay so in C.
    """

    name: str
    columns: tuple[Label, ...]
    values: NDArray[np.float64]
    whole: bool = False

    @classmethod
    def of(cls, name: str, columns: Sequence[Label], values: Any, whole: bool = False) -> "Table":
        """From anything with rows x columns values."""
        array = np.asarray(values, dtype=np.float64)
        rows = array.size // len(columns) if columns else 0
        return cls(name, tuple(columns), array.reshape(rows, len(columns)), whole)

    @property
    def size(self) -> int:
        """Number of values."""
        return int(self.values.size)


@dataclass(frozen=True)
class Form:
    """A model as tables and C.

    sizes: constants of the C code by name, beside INPUTS. body: statements of `static real model(const real *x)`
    over tables and sizes; `real` is the type and REAL_EXP, REAL_TANH, REAL_SQRT its functions; it is called for rows
    inside the training range only. magnitude: for such rows (n, k) the sum of what is added up, weighted with how
    errors of rounding grow on the way, (n,): their sum is some units of rounding times this.
    """

    tables: tuple[Table, ...]
    sizes: Mapping[str, int]
    body: str
    operations: Operations
    magnitude: Callable[[NDArray[np.float64]], NDArray[np.float64]]


def labels(columns: Sequence[Column], unit: str | None = None) -> list[Label]:
    """Of inputs in their own units, or all in another."""
    return [Label(column.name, column.unit if unit is None else unit) for column in columns]


def slopes(inputs: Sequence[Column], output: Column) -> list[Label]:
    """Of a constant and the slopes of the output on inputs."""
    return [Label("constant", output.unit), *(Label(one.name, f"{output.unit} per {one.unit}") for one in inputs)]


@dataclass(frozen=True)
class Pieces:
    """What a way of evaluating a model puts into the templates; largest_rounding: the widest of its test's tolerances.

    more: tables beside those of the guard and the form.
    """

    form: Form
    words: Mapping[str, str]
    operations: Operations
    largest_rounding: float
    more: tuple[Table, ...] = ()
