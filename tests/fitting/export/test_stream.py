"""Exported C of models of history, fed row by row, says what the model in Python says of the whole record."""

import ctypes
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.cycle_model import ThermalCycleCompensation
from fitting.export.c99 import export_c
from fitting.export.coefficients import coefficients_csv
from fitting.export.forms import NotExported
from fitting.export.precision import DOUBLE, FLOAT, Precision, in_precision
from fitting.linear import LinearCompensation
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import BIAS_ERROR_DPH, Column
from tests.fitting.export.compiling import STRICT, compensation, needs_compiler, run

DRIVER = """\
#include "cycle.h"

void many(const double *rows, int n, double *values, int *flags);

void many(const double *rows, int n, double *values, int *flags)
{
    static @STATE@ state;
    int i, k;
    @NAME@_start(&state);
    for (i = 0; i < n; ++i) {
        @REAL@ x[@NAME@_INPUTS];
        for (k = 0; k < @NAME@_INPUTS; ++k)
            x[k] = (@REAL@)rows[i * @NAME@_INPUTS + k];
        values[i] = @NAME@(&state, x, flags + i);
    }
}
"""


def record(rows: int, sensors: int, period_s: float, seed: int) -> NDArray[np.float64]:
    """Temperatures of ramps and dwells, every sensor a little later."""
    time_s = period_s * np.arange(rows)
    corners = np.array([0.0, 3000.0, 9000.0, 12000.0, 20000.0, 26000.0, 40000.0])
    degc = np.random.default_rng(seed).permutation([-20.0, 60.0, 60.0, -20.0, 20.0, -10.0, 40.0])
    return np.column_stack([np.interp(time_s - 60.0 * k, corners, degc) for k in range(sensors)])


def fitted(sensors: int = 1, period_s: float = 100.0, rows: int = 400, **settings: Any) -> Compensation:
    temperatures = record(rows, sensors, period_s, 0)
    error = 0.3 * temperatures[:, 0] + 20.0 * np.gradient(temperatures[:, 0]) / period_s * 60.0
    error += np.random.default_rng(1).standard_normal(rows)
    estimator = ThermalCycleCompensation(period_s=period_s, **settings).fit(temperatures, error)
    columns = [Column("temperature", "degC")] if sensors == 1 else [Column(f"t{k}", "degC") for k in range(sensors)]
    return compensation(estimator, columns, BIAS_ERROR_DPH)


class Streamed:
    """The compiled code of a model with a state."""

    def __init__(self, folder: Path, model: Compensation, precision: Precision) -> None:
        exported = export_c(model, "gyro_cycle", precision)
        real = precision.name
        driver = DRIVER.replace("cycle.h", f"{exported.name}.h").replace("@STATE@", f"{exported.name}_state")
        files = {**exported.files, "driver.c": driver.replace("@NAME@", exported.name).replace("@REAL@", real)}
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii")
        shadowless = [flag for flag in STRICT if flag not in ("-Wdouble-promotion",)]
        run(folder, *STRICT, "-O1", "-fPIC", "-c", exported.source, "-o", "model.o")
        run(folder, *shadowless, "-O1", "-fPIC", "-shared", "model.o", "driver.c", "-o", "cycle.so", "-lm")
        self._library = ctypes.CDLL(str(folder / "cycle.so"))
        self.selftest = self._library[f"{exported.name}_selftest"]
        self.exported = exported

    def __call__(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        given, values = np.ascontiguousarray(rows), np.empty(len(rows))
        flags = np.full(len(rows), -1, dtype=np.intc)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (given, values, flags)]
        self._library.many(pointers[0], len(rows), *pointers[1:])
        assert np.isin(flags, [0, 1]).all()
        return values, flags == 1


CASES: dict[str, dict[str, Any]] = {
    "one_sensor": {},
    "three_sensors": {"sensors": 3},
    "long_slope": {"slope_over_s": 700.0},
    "steady": {"start": "steady"},
    "steady_long_slope": {"start": "steady", "slope_over_s": 300.0, "sensors": 2},
    "linear_inside": {"regressor": LinearCompensation()},
    "no_lags": {"time_constants_s": ()},
}


@needs_compiler
@pytest.mark.parametrize("precision", [DOUBLE, FLOAT])
@pytest.mark.parametrize("case", CASES)
def test_row_by_row_equals_the_whole_record(tmp_path: Path, case: str, precision: Precision) -> None:
    how = CASES[case]
    model = in_precision(fitted(**how), precision)
    streamed = Streamed(tmp_path, model, precision)
    rows = record(400, how.get("sensors", 1), 100.0, 5).astype(precision.dtype).astype(np.float64)
    expected, outside = model.guarded(*rows.T)
    values, flags = streamed(rows)
    waiting = round(how.get("slope_over_s", 100.0) / 100.0) if how.get("start") != "steady" else 0
    assert np.isnan(values[:waiting]).all() and flags[:waiting].all()
    assert np.array_equal(flags[waiting:], outside[waiting:])
    near = np.abs(values - expected)[waiting:] <= (1e-9 if precision is DOUBLE else 2e-2)
    # where the inner guard is undecided to within rounding, either answer is right
    assert near.mean() > 0.99 and (precision is FLOAT or near.all())
    assert streamed.selftest() == 0


@needs_compiler
def test_a_lost_row_is_a_row_without_change(tmp_path: Path) -> None:
    model = fitted(start="steady")
    streamed = Streamed(tmp_path, model, DOUBLE)
    rows = record(50, 1, 100.0, 5)
    held = rows.copy()
    rows[[0, 20, 21]] = np.nan
    held[20:22] = held[19]
    values, flags = streamed(rows)
    expected, _ = model.guarded(held[1:, 0])
    assert np.flatnonzero(np.isnan(values)).tolist() == [0, 20, 21] and flags[[0, 20, 21]].all()
    kept = np.setdiff1d(np.arange(1, 50), [20, 21])
    assert values[kept] == pytest.approx(expected[kept - 1], abs=1e-9)


@needs_compiler
def test_the_selftest_sees_a_changed_lag_and_changed_code(tmp_path: Path) -> None:
    exported = export_c(fitted(), "gyro_cycle")
    source = exported.files["gyro_cycle.c"]
    table = re.search(r"lag_filter\[\] = \{\s*([^,]+)", source)
    assert table is not None
    longer = source.replace(table[1], f"{table[1]}1", 1)
    slower = source.replace("state->past[(slot + 1) % (WINDOW + 1)]", "state->past[slot]")
    for number, text in enumerate((source, longer, slower)):
        assert number == 0 or text != source
        files = {**exported.files, "gyro_cycle.c": text, "main.c": MAIN}
        for name, content in files.items():
            (tmp_path / name).write_text(content)
        run(tmp_path, "-std=c99", "main.c", "gyro_cycle.c", "-shared", "-fPIC", "-o", f"{number}.so", "-lm")
        failed = ctypes.CDLL(str(tmp_path / f"{number}.so")).failed()
        assert (failed != 0) == (number > 0)


MAIN = '#include "gyro_cycle.h"\nint failed(void) { return gyro_cycle_selftest(); }\n'


def test_the_header_says_how_often_to_call() -> None:
    exported = export_c(fitted(slope_over_s=300.0), "gyro_cycle")
    header = exported.files["gyro_cycle.h"]
    assert "every 100 s" in header and "first 3 rows" in header and "double past[4];" in header
    assert not [text for text in exported.files.values() if "@" in text]


def test_a_column_of_record_numbers_is_refused() -> None:
    rows = np.column_stack([record(100, 1, 100.0, 0), np.arange(100) // 50])
    estimator = ThermalCycleCompensation(record_column=1).fit(rows, rows[:, 0])
    model = compensation(estimator, [Column("temperature", "degC"), Column("record", "")], BIAS_ERROR_DPH)
    with pytest.raises(NotExported, match="record numbers"):
        export_c(model, "gyro_cycle")


def test_an_inner_model_without_c_is_refused_and_the_table_has_the_filter() -> None:
    model = fitted()
    with pytest.raises(NotExported, match="not exported"):
        export_c(replace(model, model=replace(model.model, inner=object())), "gyro_cycle")  # type: ignore[type-var]
    lines = coefficients_csv(model).splitlines()
    assert [line.split(",")[:3] for line in lines if line.startswith("lag_filter,0")] == [
        ["lag_filter", "0", "taken"], ["lag_filter", "0", "gain"], ["lag_filter", "0", "time_constant_rows"],
    ]  # fmt: skip
