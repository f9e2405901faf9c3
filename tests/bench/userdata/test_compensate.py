"""Files with their rates compensated: the model's numbers, in pieces, whole or not at all."""

import csv
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import InvalidFiles, UserMistake
from bench.userdata.compensate import compensate_file
from bench.userdata.fit import fit_recording
from fitting.cycle_model import ThermalCycleCompensation
from fitting.linear import LinearCompensation
from fitting.modelfile import Compensation, load_model, save_model
from fitting.modelfiles.columns import BIAS_ERROR_DPH, Column
from tests.bench.userdata.recordings import grid_file

MAP = "temperature=T_coil,rate=omega,truth=table"


@pytest.fixture
def model(tmp_path: Path) -> Compensation:
    fit_recording(grid_file(tmp_path / "train.csv"), (MAP,), ("linear",), tmp_path / "m.json")
    return load_model(tmp_path / "m.json")


@pytest.mark.parametrize("chunk_rows", [1, 7, 1000])
def test_two_columns_more_the_others_as_they_were(tmp_path: Path, model: Compensation, chunk_rows: int) -> None:
    path = grid_file(tmp_path / "d.csv", seed=3)
    applied = compensate_file(model, path, (), tmp_path / "out.csv", chunk_rows=chunk_rows)
    before, after = path.read_text().splitlines(), (tmp_path / "out.csv").read_text().splitlines()
    assert after[0] == before[0] + ",compensated_dps,guarded"
    assert all(new.startswith(old + ",") for old, new in zip(before, after, strict=True))
    table = pd.read_csv(tmp_path / "out.csv")
    expected, outside = model.compensate(temperature=table["T_coil"], rate_output=table["omega"])
    assert np.array_equal(table["compensated_dps"], expected) and np.array_equal(table["guarded"] == 1, outside)
    assert (applied.counts.rows, applied.counts.outside) == (90, int(outside.sum()))
    assert applied.columns == {"temperature": "T_coil", "rate_output": "omega"}


def test_rows_outside_and_rows_without_a_value_are_counted(tmp_path: Path, model: Compensation) -> None:
    path = tmp_path / "d.csv"
    path.write_text("#x\ntemperature_degc;rate_dps\n20;1\n200;1\n;1\n20;nan\n20;-500\n")
    applied = compensate_file(model, path, (), tmp_path / "out.csv")
    assert (applied.counts.rows, applied.counts.outside, applied.counts.missing) == (5, 2, 2)
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert lines[0] == "#x" and lines[1] == "temperature_degc;rate_dps;compensated_dps;guarded"
    assert [line.rsplit(";", 1)[1] for line in lines[2:]] == ["0", "1", "1", "1", "1"]
    assert [line.split(";")[2] == "nan" for line in lines[2:]] == [False, False, True, True, False]


def test_columns_may_be_mapped_against_the_usual_names(tmp_path: Path, model: Compensation) -> None:
    path = tmp_path / "d.csv"
    path.write_text("temperature,other,rate\n99,20,5\n")
    compensate_file(model, path, ("temperature=other,rate=rate",), tmp_path / "out.csv")
    assert pd.read_csv(tmp_path / "out.csv")["compensated_dps"][0] == pytest.approx(float(model.predict(20.0, 5.0)))


def test_an_error_in_degrees_per_hour_is_taken_off_the_rate(tmp_path: Path) -> None:
    estimator = LinearCompensation().fit([[0.0], [10.0], [20.0]], [0.0, 36.0, 72.0])
    save_model(tmp_path / "m.json", estimator, {}, inputs=[Column("temperature", "degC")], output=BIAS_ERROR_DPH)
    path = tmp_path / "d.csv"
    path.write_text("temperature,rate_dps\n10,1.5\n")
    compensate_file(load_model(tmp_path / "m.json"), path, (), tmp_path / "out.csv")
    assert pd.read_csv(tmp_path / "out.csv")["compensated_dps"][0] == pytest.approx(1.49, rel=1e-12)


def test_several_temperatures_go_by_their_order(tmp_path: Path) -> None:
    estimator = LinearCompensation().fit([[0.0, 1.0], [10.0, 5.0], [20.0, 30.0]], [0.0, 1.0, 2.0])
    columns = [Column("temperature_1", "degC"), Column("temperature_2", "degC")]
    save_model(tmp_path / "m.json", estimator, {}, inputs=columns, output=BIAS_ERROR_DPH)
    model, path = load_model(tmp_path / "m.json"), tmp_path / "d.csv"
    path.write_text("b,a,rate\n5,10,0\n")
    applied = compensate_file(model, path, ("temperature=a+b",), tmp_path / "out.csv")
    assert applied.columns == {"temperature_1": "a", "temperature_2": "b", "rate_output": "rate"}
    with pytest.raises(UserMistake, match=r"these are 1 columns and the model has 2 temperatures"):
        compensate_file(model, path, ("temperature=a",), tmp_path / "out.csv")


def test_parquet_in_csv_out(tmp_path: Path, model: Compensation) -> None:
    path = grid_file(tmp_path / "d.csv", seed=3)
    pd.read_csv(path).to_parquet(tmp_path / "d.parquet")
    for name in ("d.csv", "d.parquet"):
        compensate_file(model, tmp_path / name, (), tmp_path / f"{name}.out.csv", chunk_rows=11)
    first, second = (pd.read_csv(tmp_path / f"{name}.out.csv") for name in ("d.csv", "d.parquet"))
    pd.testing.assert_frame_equal(first, second)


def test_the_input_is_never_overwritten_not_even_by_another_name(tmp_path: Path, model: Compensation) -> None:
    path = grid_file(tmp_path / "d.csv")
    (tmp_path / "link.csv").symlink_to(path)
    before = path.read_bytes()
    for out in (path, tmp_path / "link.csv", tmp_path / "." / "d.csv"):
        with pytest.raises(UserMistake, match="never overwritten"):
            compensate_file(model, path, (), out)
    assert path.read_bytes() == before


def test_a_bad_cell_far_down_leaves_what_was_there(tmp_path: Path, model: Compensation) -> None:
    path = grid_file(tmp_path / "d.csv")
    path.write_text(path.read_text() + "20,oops,1,d1\n")
    out = tmp_path / "out.csv"
    out.write_text("kept")
    with pytest.raises(InvalidFiles, match=r"d.csv:92:2: column 'omega' has 'oops'"):
        compensate_file(model, path, (), out, chunk_rows=10)
    assert out.read_text() == "kept" and sorted(p.name for p in tmp_path.iterdir()) == [
        "d.csv", "m.json", "out.csv", "train.csv",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("header", "told"),
    [
        ("time,omega", "which column is the model's input 'temperature'.*temperature_degc.*--map temperature=COL"),
        ("T_coil,w", "which column is the model's input 'rate_output'.*there are T_coil, w.*--map rate=COL"),
        ("T_coil,omega,guarded", "there is a column 'guarded' already"),
    ],
)
def test_a_column_that_is_not_there_is_asked_for(tmp_path: Path, model: Compensation, header: str, told: str) -> None:
    path = tmp_path / "d.csv"
    path.write_text(f"{header}\n")
    with pytest.raises(UserMistake, match=told):
        compensate_file(model, path, (), tmp_path / "out.csv")


def test_other_outputs_are_refused(tmp_path: Path, model: Compensation) -> None:
    path = grid_file(tmp_path / "d.csv")
    with pytest.raises(UserMistake, match=r"ends in .csv"):
        compensate_file(model, path, (), tmp_path / "out.parquet")
    with pytest.raises(UserMistake, match="there is no folder"):
        compensate_file(model, path, (), tmp_path / "nowhere" / "out.csv")


def test_cells_with_delimiters_and_quotes_stay_cells(tmp_path: Path, model: Compensation) -> None:
    path = tmp_path / "d.csv"
    path.write_text('note,T_coil,omega\n"a, ""b""",20,1\n')
    compensate_file(model, path, (), tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(newline="") as file:
        assert list(csv.reader(file))[1][0] == 'a, "b"'


@pytest.mark.parametrize("chunk_rows", [1, 7, 1000])
@pytest.mark.parametrize("start", ["ramp", "steady"])
def test_a_model_of_history_is_applied_to_the_whole_record_whatever_the_pieces(
    tmp_path: Path, chunk_rows: int, start: str
) -> None:
    temperature = 20.0 + 30.0 * np.sin(np.arange(300) / 30.0)
    error = np.concatenate([[0.0], 4.0 * np.diff(temperature)]) + 0.1 * temperature
    estimator = ThermalCycleCompensation(start=start, slope_over_s=300.0)  # type: ignore[arg-type]
    estimator.fit(temperature[:, np.newaxis], error)
    save_model(tmp_path / "m.json", estimator, {}, inputs=[Column("temperature", "degC")], output=BIAS_ERROR_DPH)
    given = np.clip(temperature[40:120], -8.0, 48.0)
    cells = [f"{value!r}" for value in given.tolist()]
    cells[30:32] = ["", "nan"]
    lines = ["temperature,rate", ",1.5", *(f"{cell},1.5" for cell in cells)]
    (tmp_path / "d.csv").write_text("\n".join(lines) + "\n")
    model = load_model(tmp_path / "m.json")
    applied = compensate_file(model, tmp_path / "d.csv", (), tmp_path / "out.csv", chunk_rows=chunk_rows)
    given[30:32] = given[29]
    expected, _ = model.compensate(given, rate_dps=np.full(80, 1.5))
    expected[30:32] = np.nan
    found = pd.read_csv(tmp_path / "out.csv")["compensated_dps"]
    assert np.allclose(found[1:], expected, rtol=0.0, atol=1e-12, equal_nan=True) and np.isnan(found[0])
    assert (applied.counts.rows, applied.counts.missing) == (81, 3)


def test_a_period_is_for_models_of_history(tmp_path: Path, model: Compensation) -> None:
    with pytest.raises(UserMistake, match=r"--period is for models that look at the history"):
        compensate_file(model, grid_file(tmp_path / "d.csv"), (), tmp_path / "out.csv", 1.0)
