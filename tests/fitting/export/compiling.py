"""Exported C, compiled and called: the code that a gyro's processor would run, on this one."""

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.export.c99 import Exported
from fitting.export.compiled import compiler
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import CAMPAIGN_INPUTS, RATE, RATE_INPUT, Column

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wdouble-promotion", "-Wconversion", "-Wshadow")
needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


# Calls the exported function for many rows, as a processor would for one after another.
DRIVER = """\
#include "@NAME@.h"

void many(const @REAL@ *rows, int n, @REAL@ *values, int *flags);

void many(const @REAL@ *rows, int n, @REAL@ *values, int *flags)
{
    int i;
    for (i = 0; i < n; ++i)
        values[i] = @NAME@(rows + i * @NAME@_INPUTS, flags + i);
}
"""


class Compiled:
    """Functions of a compiled export, over arrays."""

    def __init__(self, folder: Path, exported: Exported) -> None:
        single = exported.name.endswith("_f")
        driver = DRIVER.replace("@NAME@", exported.name).replace("@REAL@", "float" if single else "double")
        for name, text in {**exported.files, "driver.c": driver}.items():
            (folder / name).write_text(text, encoding="ascii")
        library = folder / f"{exported.name}.so"
        run(folder, *STRICT, "-O1", "-fPIC", "-shared", exported.source, "driver.c", "-o", library.name, "-lm")
        self._library, self._name = ctypes.CDLL(str(library)), exported.name
        self._real: Any = ctypes.c_float if single else ctypes.c_double
        self._dtype = np.float32 if single else np.float64

    def __call__(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Outputs and flags of rows (n, k)."""
        given = np.ascontiguousarray(rows, dtype=self._dtype)
        values, flags = np.full(len(rows), -1.0, dtype=self._dtype), np.full(len(rows), -1, dtype=np.intc)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (given, values, flags)]
        self._library.many(pointers[0], len(rows), *pointers[1:])
        assert np.isin(flags, [0, 1]).all()
        return values.astype(np.float64), flags == 1

    def without_flag(self, row: NDArray[np.float64]) -> float:
        """The output for a row, with a null pointer for the flag."""
        function = self._library[self._name]
        function.restype = self._real
        return float(function((self._real * len(row))(*row), None))

    def compensate(self, row: NDArray[np.float64], rate_dps: float) -> float:
        """The compensated rate of a model of an error."""
        function = self._library[f"{self._name}_compensate"]
        function.restype = self._real
        return float(function((self._real * len(row))(*row), self._real(rate_dps), None))

    def selftest(self) -> int:
        """What its own test says."""
        return int(self._library[f"{self._name}_selftest"]())


def run(folder: Path, *arguments: str) -> None:
    """Call the compiler; it must succeed without a word."""
    tool = compiler()
    assert tool is not None
    done = subprocess.run([tool, *arguments], cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr


def compensation(
    estimator: Any, inputs: Sequence[Column] = CAMPAIGN_INPUTS, output: Column = RATE, **meta: str
) -> Compensation:
    """A fitted estimator as its file would give it back."""
    training = estimator.training_
    slope = float(training.slopes[list(inputs).index(RATE_INPUT)]) if RATE_INPUT in inputs else 1.0
    document = {
        "kind": type(estimator).__name__,
        "meta": {"dut": "FOG-A01", "model": "m", **meta},
        "versions": {"fogbench": "1.2.3"},
        "training": {"sha256": training.sha256, "rows": training.rows},
    }
    return Compensation(estimator.model_, tuple(inputs), output, training.reach, slope, document)
