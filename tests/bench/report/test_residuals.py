import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.report.data import read_run
from bench.report.residuals import FILE, held_out_residuals, read_held_out
from tests.bench.report.synthetic_run import Polynomial, load_polynomial

NAMES = ("point", "dut", "model", "split", "predicted_dps", "residual_dps")


@pytest.fixture
def copy(small_run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small_run, tmp_path / "run"))


def test_each_point_is_predicted_without_its_dwell(small_run: Path) -> None:
    dut = read_run(small_run, load_polynomial).duts[0]
    degree = load_polynomial(small_run / "models" / dut.name / f"{dut.model}.json").degree
    t, r, y, dwell, residual = (
        dut.points[name].to_numpy()
        for name in ("dut_temperature_degc", "rate_mean_dps", "rate_reference_dps", "dwell", "residual_dps")
    )
    for number in range(5):
        own = dwell == number
        predicted = Polynomial.fitted(degree, t[~own], r[~own], y[~own]).predict(t[own], r[own])
        # A synthetic run fits before it rounds points.csv to nine figures; extrapolation magnifies that.
        np.testing.assert_allclose(residual[own], predicted - y[own], rtol=1e-2, atol=1e-3)


def test_saved_model_residual_is_prediction_minus_reference(copy: Path) -> None:
    (copy / FILE).unlink()
    dut = read_run(copy, load_polynomial).duts[1]
    table = pd.read_csv(copy / "points.csv")
    table = table[table["dut"] == dut.name]
    model = load_polynomial(copy / "models" / dut.name / f"{dut.model}.json")
    predicted = model.predict(table["dut_temperature_degc"].to_numpy(), table["rate_mean_dps"].to_numpy())
    np.testing.assert_array_equal(dut.points["residual_dps"], predicted - table["rate_reference_dps"].to_numpy())


@pytest.mark.parametrize(
    "table",
    [None, pd.DataFrame(), pd.DataFrame({"point": [1]})],
    ids=["torn", "empty", "lacks columns"],
)
def test_a_damaged_file_is_noted_and_the_saved_model_used(copy: Path, table: pd.DataFrame | None) -> None:
    if table is None:
        (copy / FILE).write_bytes((copy / FILE).read_bytes()[:900])
    else:
        table.to_parquet(copy / FILE)
    data = read_run(copy, load_polynomial)
    assert [note.partition(" (")[0] for note in data.notes] == [f"{FILE} cannot be used"]
    assert not any(dut.held_out for dut in data.duts)
    assert all(dut.points["residual_dps"].notna().all() for dut in data.duts)


@pytest.mark.parametrize("value", [[1, 2], None, "x", True])
def test_columns_of_another_kind_are_no_crash(copy: Path, value: object) -> None:
    pd.DataFrame({name: [value, value] for name in NAMES}).to_parquet(copy / FILE)
    assert not any(dut.held_out for dut in read_run(copy, load_polynomial).duts)


def test_a_folder_in_the_place_of_the_file_is_no_crash(copy: Path) -> None:
    (copy / FILE).unlink()
    (copy / FILE).mkdir()
    assert not any(dut.held_out for dut in read_run(copy, load_polynomial).duts)


def test_a_file_without_the_split_is_no_fault(copy: Path) -> None:
    table = pd.read_parquet(copy / FILE)
    table[table["split"] != "leave_temperatures_out"].to_parquet(copy / FILE)
    data = read_run(copy, load_polynomial)
    assert not data.notes
    assert not any(dut.held_out for dut in data.duts)


@pytest.mark.parametrize(
    ("rows", "column", "value", "why"),
    [
        (1, "residual_dps", math.nan, "values that are no numbers"),
        (1, "point", 2, "a point occurs twice"),
        (1, "point", 704, "points that points.csv lacks"),
        (1, "predicted_dps", 5.0, "reference rates differ"),
        (30, "dut", "gyro-z", "standard deviation differs"),
    ],
)
def test_errors_of_another_run_are_not_shown(copy: Path, rows: int, column: str, value: float | str, why: str) -> None:
    table = pd.read_parquet(copy / FILE)
    model = read_run(copy, load_polynomial).duts[0].model
    best = (table["dut"] == "gyro-a") & (table["model"] == model) & (table["split"] == "leave_temperatures_out")
    table.loc[table.index[best][:rows], column] = value
    table.to_parquet(copy / FILE, index=False)
    data = read_run(copy, load_polynomial)
    assert [why in note and note.startswith(f"gyro-a: {FILE} does not belong to this run") for note in data.notes] == [
        True
    ]
    assert [dut.held_out for dut in data.duts] == [False, True]


def test_a_point_that_was_not_judged_has_no_residual() -> None:
    points = pd.DataFrame({"point": [1.0, 2.0, 3.0], "rate_reference_dps": [-10.0, 0.0, 10.0]})
    names = {"dut": "a", "model": "m", "split": "leave_temperatures_out"}
    rows = pd.DataFrame({"point": [3.0, 1.0], "predicted_dps": [10.5, -10.25], "residual_dps": [0.5, -0.25], **names})
    notes: list[str] = []
    found = held_out_residuals(rows, points, "a", "m", None, notes)
    assert found is not None
    np.testing.assert_array_equal(found.residual_dps, [-0.25, math.nan, 0.5])
    assert held_out_residuals(rows, points, "a", "other", None, notes) is None
    assert held_out_residuals(None, points, "a", "m", None, notes) is None
    assert not notes


def test_a_missing_file_is_no_fault(tmp_path: Path) -> None:
    notes: list[str] = []
    assert read_held_out(tmp_path, notes) is None
    assert not notes
