"""fogbench verify on whole runs, on forged ones whose checksums were made to fit, and on runs that did not end."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from bench.cli.main import cli
from bench.journal import Journal, load_journal
from bench.rawstore import read_parquet, write_parquet
from bench.refit import refit
from bench.verify.findings import Finding, Verification
from bench.verify.verify import verify
from drivers.codecs.batch import FrameBatch
from drivers.gyros.serial_frames import SerialGyro
from tests.bench import campaigns
from tests.bench.verified import SMALL, copy_of, follow, rewrite_json, small_run

RAW = "raw/p00002-FOG-A01.parquet"


@pytest.fixture(scope="module")
def untouched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run(tmp_path_factory.mktemp("verify"))


@pytest.fixture
def run(untouched: Path, tmp_path: Path) -> Path:
    return copy_of(untouched, tmp_path)


def wrong(run: Path) -> list[Finding]:
    return verify(run).wrong


def only(run: Path) -> Finding:
    (finding,) = wrong(run)
    return finding


def notes(found: Verification) -> list[str]:
    return [str(item) for check in found.checks for item in check.findings if item.severity == "note"]


def test_a_run_matches_what_is_made_again_of_it_and_is_not_changed(untouched: Path) -> None:
    before = {path: path.read_bytes() for path in untouched.rglob("*") if path.is_file()}
    told: list[str] = []
    found = verify(untouched, told.append)
    assert [(check.name, check.verdict) for check in found.checks] == [
        (name, "ok")
        for name in (
            *("journal", "copies", "raw files", "points from raw", "points and timeline"),
            *("metrics", "models", "manifest"),
        )
    ]
    assert found.exit_code == 0
    assert "12 files" in found.checks[2].summary
    assert told
    assert {path: path.read_bytes() for path in untouched.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("raw", ["samples", "none"])
def test_runs_that_keep_less(tmp_path: Path, raw: str) -> None:
    run = small_run(tmp_path, settings=(f"procedure.raw={raw}",))
    assert len(list((run / "raw").iterdir())) == (12 if raw == "samples" else 0)
    assert wrong(run) == []


def test_lost_and_invalid_frames_and_newest_samples_are_reduced_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = SerialGyro.take

    def lossy(gyro: SerialGyro) -> FrameBatch:
        batch = honest(gyro)
        kept = batch.index % 37 != 0
        columns = {name: values[kept] for name, values in batch.columns.items()}
        index = batch.index[kept]
        if len(index):
            columns["status"] = np.where(index % 11 == 0, 0, columns["status"]).astype(np.uint8)
        return gyro.meaning.batch(columns, index)

    monkeypatch.setattr(SerialGyro, "take", lossy)
    text = SMALL.replace("every: 0.2 s", "every: 0.25 s, take: newest")
    for run_id, procedure in (("mean", SMALL), ("newest", text)):
        folder = campaigns.run_campaign(tmp_path, run_id, procedure).folder
        points = pd.read_csv(folder / "points.csv")
        assert (points.loc[points["dut"] == "FOG-A01", "frames_lost"] > 0).all()
        assert wrong(folder) == []


def forge_raw(run: Path, **columns: Any) -> None:
    """A raw file written anew with other columns or metadata: whole, and not what was measured."""
    raw = read_parquet(run / RAW)
    metadata = {**raw.metadata, **columns.pop("metadata", {})}
    write_parquet(run / RAW, {**raw.columns, **columns}, metadata)


def test_other_frames_in_a_whole_file_are_told_by_the_point(run: Path) -> None:
    rate = read_parquet(run / RAW).columns["rate"].copy()
    rate[17] += np.float32(1e-6)
    forge_raw(run, rate=rate)
    found = wrong(run)
    assert {(item.file, item.point, item.dut) for item in found} == {(RAW, 2, "FOG-A01")}
    mean = next(item for item in found if item.figure == "rate_mean_dps")
    points = pd.read_csv(run / "points.csv").set_index(["point", "dut"])
    # 1e-6 of the raw unit, rad, is 1e-6 * 180/pi * 100 deg/s in one of 200 frames
    shift = float(mean.expected or 0.0) - float(mean.found or 0.0)
    assert mean.found == points.loc[(2, "FOG-A01"), "rate_mean_dps"]
    assert shift == pytest.approx(np.rad2deg(1e-6) * 100 / 200, rel=0.05)


def test_the_status_law_is_used(run: Path) -> None:
    status = read_parquet(run / RAW).columns["status"].copy()
    status[:20] = 0
    forge_raw(run, status=status)
    assert "samples" in {item.figure for item in wrong(run)}


@pytest.mark.parametrize(
    ("about", "figure"),
    [
        ({"point": 3}, "point"),
        ({"dut": "FOG-B01"}, "dut"),
        ({"started_at_s": 1.0}, "started_at_s"),
        ({"every_s": -1.0}, "every_s"),
        ({"data_rate_hz": "fast"}, "data_rate_hz"),
        ({"samples": 20}, "frames_lost"),
        ({"quantities": {}}, None),
        ({"status": None}, None),
    ],
)
def test_metadata_that_is_not_of_the_point(run: Path, about: dict[str, Any], figure: str | None) -> None:
    forge_raw(run, metadata=about)
    found = wrong(run)
    assert all(item.file == RAW for item in found)
    assert figure in {item.figure for item in found}


def test_raw_files_missing_exchanged_and_too_many(run: Path) -> None:
    (run / RAW).unlink()
    one, other = run / "raw/p00003-FOG-A01.parquet", run / "raw/p00004-FOG-A01.parquet"
    one.rename(run / "x")
    other.rename(one)
    (run / "x").rename(other)
    (run / "raw/p00009-FOG-A01.parquet").write_bytes(other.read_bytes())
    (run / "raw/readme.txt").write_text("hello")
    (run / "raw/p00001-FOG-A01.parquet.tmp").write_bytes(b"PAR1")
    found = verify(run)
    texts = [str(item) for item in found.wrong]
    assert f"{RAW}: is missing: its point is in the journal" in texts
    assert "raw/p00009-FOG-A01.parquet: belongs to no point of the journal" in texts
    assert "raw/readme.txt: belongs to no point of the journal" in texts
    assert any("p00003-FOG-A01.parquet: its point is another: expected 3, found 4" in text for text in texts)
    assert notes(found) == ["raw/p00001-FOG-A01.parquet.tmp: left by a write that was broken off; it may be deleted"]


def test_a_pipe_in_place_of_a_file_does_not_hang(run: Path) -> None:
    for name in (RAW, "points.csv", "points.parquet", "metrics.json", "manifest.json", "models/FOG-A01/linear.json"):
        (run / name).unlink()
        os.mkfifo(run / name)
    named = {item.file for item in wrong(run)}
    assert {RAW, "points.csv", "points.parquet", "metrics.json", "manifest.json"} <= named
    (run / "journal.jsonl").unlink()
    os.mkfifo(run / "journal.jsonl")
    assert verify(run).exit_code == 1


def test_another_figure_in_points(run: Path) -> None:
    path = run / "points.csv"
    table = pd.read_csv(path)
    before = table.loc[3, "rate_mean_dps"]
    table.loc[3, "rate_mean_dps"] += 1e-9
    table.to_csv(path, index=False, lineterminator="\n")
    follow(path)
    finding = only(run)
    assert (finding.file, finding.point, finding.dut) == ("points.csv", 2, "FOG-B01")
    assert (finding.figure, finding.expected) == ("rate_mean_dps", before)


@pytest.mark.parametrize("name", ["points.parquet", "timeline.parquet"])
def test_another_figure_in_a_table(run: Path, name: str) -> None:
    table = pd.read_parquet(run / name)
    column = "rate_readback_dps"
    row = int(np.flatnonzero(np.isfinite(table[column]))[0])
    table.loc[row, column] += 1e-9
    table.to_parquet(run / name, index=False)
    follow(run / name)
    assert (only(run).file, only(run).figure) == (name, column)
    table.drop(columns=column).to_parquet(run / name, index=False)
    follow(run / name)
    assert f"its columns are others: {column}" in only(run).text
    pd.concat([table, table]).to_parquet(run / name, index=False)
    follow(run / name)
    assert "rows" in only(run).text


def test_better_metrics_than_the_points_give(run: Path) -> None:
    def better(metrics: Any) -> None:
        metrics["FOG-B01"]["linear"]["leave_temperatures_out"]["std_dps"] *= 0.99
        metrics["FOG-B01"]["linear"]["random"]["fit_s"] = 77.0

    rewrite_json(run / "metrics.json", better)
    found = wrong(run)
    assert "FOG-B01 / linear / leave_temperatures_out / std_dps is not what the points give" in found[0].text
    # the errors kept beside it and the model file say so too
    assert {item.file for item in found} == {"metrics.json", "residuals.parquet", "models/FOG-B01/linear.json"}


def test_other_residuals(run: Path) -> None:
    table = pd.read_parquet(run / "residuals.parquet")
    table.loc[0, "residual_dps"] += 1.0
    table.to_parquet(run / "residuals.parquet", index=False)
    follow(run / "residuals.parquet")
    assert {item.file for item in wrong(run)} == {"residuals.parquet"}


def test_a_model_that_does_something_else_than_it_states(run: Path) -> None:
    path = run / "models/FOG-A01/linear.json"
    rewrite_json(path, lambda model: model["parameters"]["coefficients"].__setitem__(2, 0.97))
    assert {item.figure for item in wrong(run)} == {"training_max_abs_dps", "training_std_dps"}
    rewrite_json(path, lambda model: model["training"].__setitem__("sha256", "0" * 64))
    assert "training.sha256" in {item.figure for item in wrong(run)}
    path.write_text("{")
    follow(path)
    assert "not JSON" in only(run).text
    path.unlink()
    assert {item.file for item in wrong(run)} == {"models/FOG-A01/linear.json"}


@pytest.mark.parametrize(
    ("key", "value"),
    [("outcome", "FAIL"), ("seed", 5), ("points_measured", 7), ("limits", []), ("notes", ["x"]), ("extra", 1)],
)
def test_a_manifest_that_says_something_else(run: Path, key: str, value: Any) -> None:
    rewrite_json(run / "manifest.json", lambda manifest: manifest.__setitem__(key, value))
    finding = only(run)
    assert finding.file == "manifest.json"
    assert f"'{key}'" in finding.text or key in finding.text


def test_a_manifest_without_hashes(run: Path) -> None:
    rewrite_json(run / "manifest.json", lambda manifest: manifest["files"].pop("metrics.json"))
    assert "metrics.json" in str(only(run))
    rewrite_json(run / "manifest.json", lambda manifest: manifest["files"].__setitem__("../x", "0" * 64))
    assert any("../x" in str(item) for item in wrong(run))


@pytest.mark.parametrize("name", ["procedure.yaml", "bench.yaml"])
def test_a_copy_that_is_not_what_was_run(run: Path, name: str) -> None:
    (run / name).write_text((run / name).read_text() + "# edited\n")
    follow(run / name)
    assert (only(run).file, only(run).figure) == (name, "sha256")
    (run / name).unlink()
    assert name in {item.file for item in wrong(run)}


def test_other_models_fitted_later_change_nothing(run: Path) -> None:
    refit(run, ["ts_published"])
    assert wrong(run) == []
    refit(run, ["linear"])
    assert wrong(run) == []
    rewrite_json(run / "metrics.json", lambda metrics: metrics["FOG-A01"].__setitem__("lab_model", {"random": {}}))
    found = verify(run)
    assert any("'lab_model' is not installed here" in text for text in notes(found))


DERIVED = ("points.csv", "points.parquet", "timeline.parquet", "residuals.parquet", "metrics.json", "manifest.json")


def without_end(run: Path, keep: int) -> None:
    """The run as a crash leaves it: `keep` records of the journal, and nothing that the end writes."""
    lines = (run / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (run / "journal.jsonl").write_bytes(b"".join(lines[:keep]))
    for path in (*(run / name for name in DERIVED), *run.glob("models/*/*.json")):
        path.unlink()


def places(run: Path, kind: str) -> Iterator[int]:
    return (n for n, entry in enumerate(load_journal(run / "journal.jsonl"), start=1) if entry["kind"] == kind)


def test_a_run_that_died_is_verified_as_far_as_it_goes(run: Path) -> None:
    point = list(places(run, "point"))[4]
    without_end(run, point)
    with (run / "journal.jsonl").open("ab") as file:
        file.write(b'0badc0de {"n":')
    found = verify(run)
    assert found.exit_code == 0
    assert any("14 bytes after the last whole record: a record torn by a crash" in text for text in notes(found))
    assert any("broken off" in text for text in notes(found))
    (run / "raw/p00001-FOG-A01.parquet").unlink()
    assert only(run).file == "raw/p00001-FOG-A01.parquet"


def test_a_run_that_was_resumed_has_the_results_of_before(run: Path) -> None:
    journal = Journal.reopen(run / "journal.jsonl")
    journal.append("resumed", 1e4, text="attempt 2", gap_s=0.0)
    journal.close()
    found = verify(run)
    assert found.wrong == []
    assert any("those from before" in text for text in notes(found))


def test_an_end_without_a_manifest_and_bytes_after_an_end(run: Path) -> None:
    for name in DERIVED:
        (run / name).unlink()
    assert "fogbench report" in only(run).text
    with (run / "journal.jsonl").open("ab") as file:
        file.write(b"x")
    assert len(wrong(run)) == 2


def test_a_damaged_journal_is_told_with_its_line_and_the_rest_is_still_looked_at(run: Path) -> None:
    lines = (run / "journal.jsonl").read_bytes().splitlines(keepends=True)
    lines[5] = lines[5].replace(b"1", b"2", 1)
    (run / "journal.jsonl").write_bytes(b"".join(lines))
    raw = bytearray((run / RAW).read_bytes())
    raw[100] ^= 4
    (run / RAW).write_bytes(raw)
    found = verify(run)
    assert any(item.file == "journal.jsonl:6" for item in found.wrong)
    (run / "journal.jsonl").write_bytes(b"")
    assert "no whole record" in wrong(run)[0].text


def command(*arguments: str) -> Any:
    return CliRunner().invoke(cli, ["verify", *arguments])


def test_the_command(run: Path) -> None:
    result = command(str(run))
    assert result.exit_code == 0
    assert "everything matches" in result.output
    (run / "points.csv").write_text("point,dut\n")
    result = command(str(run))
    assert result.exit_code == 1
    assert "wrong  points and timeline" in result.output
    assert "2 things do not match" in result.output
    result = command(str(run), "--json")
    assert result.exit_code == 1
    answer = json.loads(result.output)
    assert (answer["matches"], answer["exit_code"], answer["run"]) == (False, 1, str(run))
    findings = [item for check in answer["checks"] for item in check["findings"]]
    assert {item["file"] for item in findings} == {"points.csv"}


def test_not_a_run(tmp_path: Path) -> None:
    result = command(str(tmp_path / "nothing"))
    assert result.exit_code != 0
    assert result.exception.exit_code == 2  # type: ignore[union-attr]
