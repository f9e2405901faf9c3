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


def test_residuals_are_the_held_out_errors(small: ReportData) -> None:
    for dut in small.duts:
        assert dut.held_out
        std = dut.figure(dut.model or "", "leave_temperatures_out", "std_dps")
        assert float(np.std(dut.points["residual_dps"])) == pytest.approx(std, rel=1e-9)


def test_without_held_out_errors_the_saved_model_is_used(copy: Path) -> None:
    (copy / "residuals.parquet").unlink()
    data = read_run(copy, load_polynomial)
    for dut in data.duts:
        assert not dut.held_out
        std = dut.figure(dut.model or "", "leave_temperatures_out", "std_dps")
        assert std is not None
        assert float(np.std(dut.points["residual_dps"])) < std
    assert not data.notes


def test_a_temperature_visited_twice_is_seen(copy: Path, small: ReportData) -> None:
    assert not small.duts[0].revisited
    table = pd.read_csv(copy / "points.csv")
    table["chamber_setpoint_degc"] = table["chamber_setpoint_degc"].replace(30.0, -30.0)
    table.to_csv(copy / "points.csv", index=False)
    assert read_run(copy, load_polynomial).duts[0].revisited


def test_notes_of_the_manifest_come_first_and_once(copy: Path) -> None:
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["notes"] = ["gyro-a: 1 dwell for 6 folds", "gyro-a: 1 dwell for 6 folds", "gyro-b: no fit: too few"]
    (copy / "manifest.json").write_text(json.dumps(manifest))
    (copy / "timeline.parquet").unlink()
    notes = read_run(copy, load_polynomial).notes
    assert notes[:2] == ("gyro-a: 1 dwell for 6 folds", "gyro-b: no fit: too few")
    assert len(notes) == 3


def test_a_run_without_analysis_has_one_note(tmp_path: Path) -> None:
    left_out = ("models", "metrics", "residuals")
    run = write_synthetic_run(tmp_path / "r", temperatures_degc=(20,), rates_dps=(-10, 0, 10), without=left_out)
    data = read_run(run, load_polynomial)
    assert data.notes == (
        "No model was fitted in this run, so nothing is compensated: the points are shown as measured.",
    )


def test_a_dut_without_a_model_is_named(copy: Path) -> None:
    metrics = json.loads((copy / "metrics.json").read_text())
    (copy / "metrics.json").write_text(json.dumps({"gyro-a": metrics["gyro-a"]}))
    shutil.rmtree(copy / "models/gyro-b")
    assert read_run(copy, load_polynomial).notes == ("gyro-b: no model was fitted, so nothing is compensated.",)


def test_notes_do_not_tell_where_the_run_folder_is(copy: Path) -> None:
    for name in ("points.csv", "timeline.parquet", "residuals.parquet"):
        (copy / name).write_bytes(b"PAR1 torn")
    notes = " ".join(read_run(copy, load_polynomial).notes)
    assert "residuals.parquet cannot be used" in notes
    assert str(copy) not in notes


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
    (copy / "residuals.parquet").unlink()
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
