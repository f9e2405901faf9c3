import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import UserMistake
from bench.report.data import ReportData, read_run
from tests.bench.report.synthetic_run import load_polynomial, surface_a, write_synthetic_run


@pytest.fixture
def copy(small_run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small_run, tmp_path / "run"))


def test_error_is_surface_a_before_compensation(small: ReportData) -> None:
    points = small.duts[0].points
    rate = points["rate_reference_dps"].to_numpy()
    expected = surface_a(points["chamber_setpoint_degc"].to_numpy(), rate) - rate
    np.testing.assert_allclose(points["error_dps"], expected, atol=0.12)  # dwell errors and temperature scatter


def test_residual_is_prediction_minus_reference(small_run: Path, small: ReportData) -> None:
    dut = small.duts[1]
    table = pd.read_csv(small_run / "points.csv")
    table = table[table["dut"] == dut.name]
    model = load_polynomial(small_run / "models" / dut.name / f"{dut.model}.json")
    predicted = model.predict(table["dut_temperature_degc"].to_numpy(), table["rate_mean_dps"].to_numpy())
    np.testing.assert_array_equal(dut.points["residual_dps"], predicted - table["rate_reference_dps"].to_numpy())


def test_best_model_has_the_lowest_leave_temperatures_out_std(small_run: Path, small: ReportData) -> None:
    metrics = json.loads((small_run / "metrics.json").read_text())
    for dut in small.duts:
        scores = {model: splits["leave_temperatures_out"]["std_dps"] for model, splits in metrics[dut.name].items()}
        del scores["none"]
        assert dut.model == min(scores, key=lambda model: scores[model])


def test_without_the_headline_split_the_random_split_chooses(copy: Path) -> None:
    metrics = json.loads((copy / "metrics.json").read_text())
    for splits in metrics["gyro-a"].values():
        del splits["leave_temperatures_out"]
    metrics["gyro-a"]["linear"]["random"]["std_dps"] = 1e-9
    (copy / "metrics.json").write_text(json.dumps(metrics))
    dut = read_run(copy, load_polynomial).duts[0]
    assert (dut.model, dut.chosen_by) == ("linear", "lowest random-split std")


def test_noise_floor_without_metrics_is_the_rms_uncertainty(copy: Path) -> None:
    (copy / "metrics.json").unlink()
    dut = read_run(copy, load_polynomial).duts[0]
    u = dut.usable["rate_mean_u_dps"].to_numpy()
    assert dut.floor_dps == pytest.approx(float(np.sqrt(np.mean(u**2))))


def test_failed_points_are_not_usable(copy: Path) -> None:
    table = pd.read_csv(copy / "points.csv")
    table.loc[table["dut"] == "gyro-a", "verdict"] = ["fail"] * 3 + ["pass"] * (len(table) // 2 - 3)
    table.to_csv(copy / "points.csv", index=False)
    dut = read_run(copy, load_polynomial).duts[0]
    assert len(dut.usable) == len(dut.points) - 3


def test_dwells_count_from_zero_with_or_without_the_column(copy: Path) -> None:
    given = [dut.points["dwell"].to_list() for dut in read_run(copy, load_polynomial).duts]
    pd.read_csv(copy / "points.csv").drop(columns="dwell").to_csv(copy / "points.csv", index=False)
    counted = [dut.points["dwell"].to_list() for dut in read_run(copy, load_polynomial).duts]
    assert given == counted
    assert counted[0] == [dwell for dwell in range(5) for _ in range(7)]


@pytest.mark.parametrize("name", ["manifest.json", "points.csv", "metrics.json", "timeline.parquet"])
@pytest.mark.parametrize("content", [None, b"", b"[1]", b"\xff\xfe\x00broken"])
def test_a_missing_or_damaged_file_is_noted(copy: Path, name: str, content: bytes | None) -> None:
    if content is None:
        (copy / name).unlink()
    else:
        (copy / name).write_bytes(content)
    notes = read_run(copy, load_polynomial).notes
    assert any(name in note or "no point was measured" in note for note in notes), notes


@pytest.mark.parametrize(
    "metrics", [{"gyro-a": 1}, {"gyro-a": {"linear": [2]}}, {"gyro-a": {"linear": {"random": "x"}}}]
)
def test_metrics_of_another_shape_choose_no_model(copy: Path, metrics: object) -> None:
    (copy / "metrics.json").write_text(json.dumps(metrics))
    dut = read_run(copy, load_polynomial).duts[0]
    assert dut.chosen_by.startswith("the first saved model")
    assert dut.figure("linear", "random", "std_dps") is None


def test_a_damaged_model_is_noted_and_leaves_no_residual(copy: Path) -> None:
    (copy / "models/gyro-a/ts_joint.json").write_text("{")
    for model in ("linear", "ts_published"):
        (copy / f"models/gyro-a/{model}.json").write_text("{")
    data = read_run(copy, load_polynomial)
    assert data.duts[0].points["residual_dps"].isna().all()
    assert any("models/gyro-a/" in note for note in data.notes)


def test_serial_numbers_are_text(tmp_path: Path) -> None:
    run = write_synthetic_run(tmp_path / "r", duts=("007", "NA"), temperatures_degc=(0, 5), rates_dps=(-10, 10))
    assert [dut.name for dut in read_run(run, load_polynomial).duts] == ["007", "NA"]
    assert all(len(dut.points) == 4 for dut in read_run(run, load_polynomial).duts)


def test_an_early_end_is_said(tmp_path: Path) -> None:
    run = write_synthetic_run(tmp_path / "r", stop_after=40, outcome="ABORTED")
    assert read_run(run, load_polynomial).notes[0] == "The run ended early: 40 of 703 planned points were measured."


def test_another_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserMistake, match="not a run folder"):
        read_run(tmp_path)
