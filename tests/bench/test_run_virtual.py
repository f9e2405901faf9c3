"""Whole small campaigns on the virtual bench: the record, its determinism, and how runs end."""

import errno
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from bench import rawstore
from bench.conclude import RunEnd
from bench.errors import BenchFailure, ExitCode, UserMistake
from bench.journal import read_journal
from bench.reduction import point_statistics, to_samples
from bench.report.render import write_report
from tests.bench.campaigns import ENDLESS, ENDLESS_POINTS, GRID, ROOT, VIRTUAL, run_campaign, virtual_bench, write

RATES = [-150.0, -100.0, -50.0, 0.0, 50.0, 100.0, 150.0]
TEMPERATURES = [0.0, 10.0, 20.0, 30.0]


@pytest.fixture(scope="module")
def end(tmp_path_factory: pytest.TempPathFactory) -> RunEnd:
    return run_campaign(tmp_path_factory.mktemp("campaign"), "one")


@pytest.fixture(scope="module")
def points(end: RunEnd) -> pd.DataFrame:
    return pd.read_csv(end.folder / "points.csv")


def test_the_points_are_those_of_the_procedure_in_order(end: RunEnd, points: pd.DataFrame) -> None:
    assert end.outcome == "PASS", end.message
    expected = [(t, r) for t in TEMPERATURES for r in RATES for _ in range(2)]
    assert list(zip(points["chamber_setpoint_degc"], points["rate_setpoint_dps"], strict=True)) == expected
    assert list(points["dut"]) == ["FOG-A01", "FOG-B01"] * 28
    assert list(points["point"]) == [n for n in range(1, 29) for _ in range(2)]
    assert (points["samples"] + points["outliers"] == 20).all()
    assert (points["frames"] == 1000).all()
    assert (points[["frames_lost", "duplicates", "bad_checksum", "resyncs"]] == 0).all().all()
    assert ((points["ended_at_s"] - points["started_at_s"]).between(10.0, 10.2)).all()
    assert (np.abs(points["rate_readback_dps"] - points["rate_setpoint_dps"]) < 0.02).all()
    assert (np.abs(points["chamber_readback_degc"] - points["chamber_setpoint_degc"]) < 1.5).all()


def test_the_gyro_errors_are_those_of_the_bench_file(points: pd.DataFrame) -> None:
    """Surface A of fitting_notes section 1, written again here, at the DUT's own temperature."""
    mine = points[points["dut"] == "FOG-A01"]
    t_degc, rate = mine["dut_temperature_degc"].to_numpy(), mine["rate_setpoint_dps"].to_numpy()
    k = 0.049530876 + 0.020260709 * np.tanh((t_degc - 24.87441) / 14.0)
    output = (1 + k) * np.sin(0.0013 * rate) / 0.0013 + 0.40871934 + 0.42963359 * (t_degc - 15) / 45
    # dwell errors: 100 ppm of 150 deg/s, 2 deg/h, and 0.1 to 0.3 K of the sensor at up to 0.22 (deg/s)/K
    assert np.abs(mine["rate_mean_dps"] - output).max() < 0.15
    assert np.abs(mine["rate_mean_dps"] - rate).max() > 5.0


def test_other_gyro_parameters_give_other_points(tmp_path: Path) -> None:
    flat = {
        "model": "curves",
        "curves": {"bias_polynomial": [3600.0]},
        "noise": {"arw": "0 deg/sqrt(h)", "bias_instability": "0 deg/h", "rrw": "0 deg/h/sqrt(h)"},
        "repeatability": {"scale": "0 ppm", "bias": "0 deg/h", "sensor": "0 K"},
        "thermal": {"shupe_c1": 0.0, "shupe_c2": 0.0, "shupe_c3": 0.0},
        "turn_on_bias_sigma": "0 deg/h",
    }
    bench = virtual_bench(tmp_path, seed=1, duts={"FOG-A01": flat})
    end = run_campaign(tmp_path, "flat", bench=bench, settings=("bench.simulation.rate_table.rate_gain_sigma=0 ppm",))
    points = pd.read_csv(end.folder / "points.csv").query("dut == 'FOG-A01'")
    # a perfect gyro with a bias of 3600 deg/h reads one deg/s too much, everywhere
    assert np.abs(points["rate_mean_dps"] - points["rate_setpoint_dps"] - 1.0).max() < 2e-3


def test_the_same_seed_gives_the_same_bytes(end: RunEnd, tmp_path: Path) -> None:
    again = run_campaign(tmp_path, "two")
    other = run_campaign(tmp_path, "three", seed=77)
    first = (end.folder / "points.csv").read_bytes()
    assert (again.folder / "points.csv").read_bytes() == first
    assert (other.folder / "points.csv").read_bytes() != first


def test_points_can_be_made_again_from_the_raw_frames(end: RunEnd, points: pd.DataFrame) -> None:
    for _, row in points.iloc[[0, 11, 30, 55]].iterrows():
        table = pq.read_table(end.folder / "raw" / f"p{row['point']:05d}-{row['dut']}.parquet")
        about = json.loads(table.schema.metadata[b"fogbench"])
        columns = {name: table[name].to_numpy() for name in table.column_names}
        law, heat = about["quantities"]["rate"], about["quantities"]["temperature"]
        rate = columns["rate"].astype(float) * law["scale"] + law["offset"]
        temperature = columns["temperature"].astype(float) * heat["scale"] + heat["offset"]
        offset = columns["index"] - columns["index"][0]
        good = np.ones(len(rate), bool)
        per_sample = about["every_s"] * about["data_rate_hz"]
        samples = to_samples(offset, rate, temperature, good, per_sample, 20)
        statistics = point_statistics(samples, about["every_s"])
        assert statistics is not None
        assert statistics.rate_mean_dps == pytest.approx(row["rate_mean_dps"], abs=1e-9)
        assert columns["rate"].dtype == np.float32
        assert np.array_equal(np.diff(columns["counter"].astype(int)) % 128, np.ones(len(rate) - 1))


def test_the_truth_stays_out_of_the_run_folder(end: RunEnd) -> None:
    truth = end.folder.parent / ".truth" / end.folder.name
    assert (truth / "truth.json").is_file() and (truth / "truth.csv").is_file()
    assert not list(end.folder.rglob("truth*"))


def test_the_run_folder_is_complete_and_the_manifest_true(end: RunEnd) -> None:
    names = {path.relative_to(end.folder).as_posix() for path in end.folder.rglob("*") if path.is_file()}
    assert {"journal.jsonl", "procedure.yaml", "bench.yaml", "points.csv", "points.parquet", "metrics.json"} <= names
    assert {"timeline.parquet", "manifest.json", "models/FOG-A01/linear.json", "raw/p00028-FOG-B01.parquet"} <= names
    manifest = json.loads((end.folder / "manifest.json").read_text())
    assert manifest["points_measured"] == manifest["points_planned"] == 28
    assert manifest["data_quality"]["FOG-A01"]["frames"] >= 28 * 1000
    from hashlib import sha256

    for name, digest in manifest["files"].items():
        assert sha256((end.folder / name).read_bytes()).hexdigest() == digest
    assert pq.read_table(end.folder / "points.parquet").num_rows == 56
    safe = [event["text"] for event in manifest["events"] if event["kind"] == "safe"]
    assert len(safe) == 2 and any("at rest" in text for text in safe)
    assert any("setpoint 25 degC" in text for text in safe)


def test_a_report_can_be_made(end: RunEnd) -> None:
    text = write_report(end.folder).read_text(encoding="utf-8")
    assert "FOG-A01" in text and "FOG-B01" in text and "<svg" in text


def test_a_failed_limit_is_a_fail_not_an_error(tmp_path: Path) -> None:
    end = run_campaign(tmp_path, "strict", GRID.replace("max_abs: 100 deg/s", "std: 0.0001 deg/s"))
    assert (end.outcome, end.exit_code) == ("FAIL", ExitCode.FAILED)
    assert "linear, random: standard deviation" in end.message and "over its limit 0.36 deg/h" in end.message


def test_a_lying_gyro_fails_its_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A frozen output has a valid checksum, a running counter and good status: only its constancy gives it away."""
    from simulated_hw.physics.gyro import GyroUnit

    honest = GyroUnit.block

    def frozen(self: Any, first: int, end: int) -> Any:
        block = honest(self, first, end)
        return replace(block, rate_dps=np.full_like(block.rate_dps, 1.25))

    monkeypatch.setattr(GyroUnit, "block", frozen)
    end = run_campaign(tmp_path, "frozen")
    assert end.outcome == "FAIL"
    assert set(pd.read_csv(end.folder / "points.csv")["reasons"]) == {"output frozen"}


def test_a_disk_that_fills_up_ends_the_run_safe_with_its_points_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []
    honest = rawstore.write_parquet

    def until_full(path: Path, columns: Any, metadata: Any) -> None:
        if len(written) >= 10:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(path)
        honest(path, columns, metadata)

    monkeypatch.setattr(rawstore, "write_parquet", until_full)
    end = run_campaign(tmp_path, "full")
    assert (end.outcome, end.exit_code) == ("ERROR", ExitCode.BENCH_FAILED)
    assert "No space left" in end.message
    kinds = [entry["kind"] for entry in read_journal(end.folder / "journal.jsonl")]
    assert kinds.count("safe") == 2
    assert 5 <= len(pd.read_csv(end.folder / "points.csv")) < 56


def test_a_chamber_that_cannot_get_there_is_an_error_with_the_place(tmp_path: Path) -> None:
    bench = virtual_bench(tmp_path, chamber={"cooling_power": "50 W"})
    end = run_campaign(tmp_path, "weak", bench=bench)
    assert end.outcome == "ERROR"
    assert "weak.yaml:6:5" in end.message and "the chamber reads" in end.message and "6 h" in end.message


def test_two_rehearsals_are_alike_and_the_run_takes_as_long(end: RunEnd) -> None:
    entries = list(read_journal(end.folder / "journal.jsonl"))
    forecast = next(entry for entry in entries if entry["kind"] == "forecast")
    finished = [entry["t_s"] for entry in entries if entry["kind"] == "done"][-1]
    assert forecast["failure"] is None
    assert forecast["duration_s"] == pytest.approx(finished, rel=0.01)


@pytest.mark.parametrize("run_id", ["../x", "a/b", ".hidden", "", "x" * 200])
def test_run_ids_that_leave_the_folder_are_refused(tmp_path: Path, run_id: str) -> None:
    with pytest.raises(UserMistake, match="cannot name a run"):
        prepare_only(tmp_path, run_id)
    assert not (tmp_path / "results").exists()


def prepare_only(tmp_path: Path, run_id: str) -> None:
    from bench.run import RunRequest, prepare

    prepare(RunRequest(write(tmp_path, "p.yaml", GRID), VIRTUAL, tmp_path / "results", run_id))


def test_an_existing_run_is_never_overwritten(end: RunEnd) -> None:
    before = (end.folder / "journal.jsonl").read_bytes()
    with pytest.raises(UserMistake, match="already exists"):
        run_campaign(end.folder.parents[1], "one")
    assert (end.folder / "journal.jsonl").read_bytes() == before


def test_a_port_that_does_not_open_leaves_no_run(tmp_path: Path) -> None:
    text = (ROOT / "benches" / "lab_example.yaml").read_text(encoding="utf-8")
    with pytest.raises(BenchFailure, match="usb-chamber") as failure:
        run_campaign(tmp_path, "dead", bench=write(tmp_path, "lab.yaml", text))
    assert (
        "does not open" in str(failure.value) or "cannot" in str(failure.value) or "No such file" in str(failure.value)
    )
    assert not (tmp_path / "results" / "dead").exists()


@pytest.fixture
def process(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    endless = write(tmp_path, "endless.yaml", ENDLESS)
    command = [sys.executable, "-m", "bench.cli", "run", str(endless), "--bench", str(VIRTUAL)]
    command += ["--results", str(tmp_path / "results"), "--run-id", "stop"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as running:
        yield running
        running.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_ends_safe_with_the_points_kept(
    tmp_path: Path, process: subprocess.Popen[str], number: signal.Signals
) -> None:
    journal = tmp_path / "results" / "stop" / "journal.jsonl"
    deadline = time.monotonic() + 60
    while not (journal.exists() and b'"kind":"point"' in journal.read_bytes()) and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == ExitCode.INTERRUPTED, errors
    assert "ABORTED" in output
    manifest = json.loads((journal.parent / "manifest.json").read_text())
    assert manifest["outcome"] == "ABORTED" and 0 < manifest["points_measured"] < ENDLESS_POINTS
    assert [event["kind"] for event in manifest["events"]][-2:] == ["safe", "safe"]
    assert (journal.parent / "report.html").is_file()
