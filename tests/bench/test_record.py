"""The record verb in campaigns: every row there, in place, and true; broken off, it begins again."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bench.errors import InvalidFiles
from bench.journal import load_journal
from bench.procedure.conditions import ResumePolicy
from bench.resume import prepare_resume
from bench.resumption import pauser
from bench.run import RunRequest, prepare, run
from bench.verify.verify import verify
from tests.bench.campaigns import VIRTUAL, run_campaign, virtual_bench, write
from tests.crash import _attempt, at_record

CYCLE = """\
procedure: cycle
raw: frames
steps:
  - set_temperature: {to: 25 degC, band: 1 K}
  - record:
      name: cycle
      every: 1 s
      steps:
        - dwell: 20 min
        - ramp_temperature: {to: 15 degC, rate: 1 degC/min}
        - dwell: 10 min
  - set_rate: 10 deg/s
  - settle: {band: 0.05 deg/s}
  - repeat:
      times: 2
      steps:
        - record: {name: turning, every: 0.5 s, steps: [{dwell: 2 min}]}
"""


def series_of(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_parquet(folder / "series" / f"{name}.parquet")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    end = run_campaign(tmp_path_factory.mktemp("whole"), "whole", CYCLE)
    assert (end.outcome, end.message) == ("PASS", "every record made; no limit was set")
    return end.folder


def test_every_row_of_every_record_is_there(whole: Path) -> None:
    cycle = series_of(whole, "cycle-FOG-A01")
    # the chamber reads 15 degC a little after its setpoint does; the rest is stated
    assert 2400 <= len(cycle) < 2600
    np.testing.assert_allclose(np.diff(cycle["t_s"]), 1.0)
    assert (cycle["frames"] == 100).all() and cycle.notna().all().all()
    assert cycle["temperature_degc"].iloc[:600].std() < 2.0 < np.ptp(cycle["temperature_degc"])
    for name in ("turning-FOG-A01", "turning-2-FOG-B01"):
        turning = series_of(whole, name)
        assert len(turning) == 240 and (turning["frames"] == 50).all()
        assert abs(turning["rate_dps"].mean() - 10.0) < 2.0


def test_the_manifest_says_what_was_recorded(whole: Path) -> None:
    import json

    series = json.loads((whole / "manifest.json").read_text())["series"]
    assert [(one["label"], one["dut"]) for one in series] == [
        (label, dut) for label in ("cycle", "turning", "turning-2") for dut in ("FOG-A01", "FOG-B01")
    ]
    assert {one["verdict"] for one in series} == {"pass"} and series[2]["rate_setpoint_dps"] == 10.0


def test_verify_makes_the_rows_again_from_the_frames(whole: Path) -> None:
    verification = verify(whole)
    assert not verification.wrong, verification.wrong
    summary = {check.name: check.summary for check in verification.checks}
    assert summary["record parts"].startswith("6 series")


@pytest.mark.parametrize("victim", ["raw/*.frames.parquet", "raw/*.samples.parquet", "series/*.parquet"])
def test_verify_finds_a_file_of_another_record(whole: Path, tmp_path: Path, victim: str) -> None:
    import shutil

    copy = shutil.copytree(whole, tmp_path / "copy")
    first, *_, last = sorted(copy.glob(victim))
    shutil.copyfile(last, first)
    assert verify(copy).wrong


def test_a_broken_off_record_begins_again(tmp_path: Path) -> None:
    request = RunRequest(write(tmp_path, "p.yaml", CYCLE), VIRTUAL, tmp_path / "results", "r")
    stops: list[Any] = []

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.verb == "ramp_temperature":
            stops[0].ask()

    end = run(prepare(request), listen, stops.append)
    assert end.outcome == "ABORTED" and not list((end.folder / "series").glob("*"))
    end = run(prepare_resume(end.folder))
    assert end.outcome == "PASS", end.message
    assert len(series_of(end.folder, "cycle-FOG-A01")) >= 2400
    begun = [e for e in load_journal(end.folder / "journal.jsonl") if e["kind"] == "step" and e["verb"] == "record"]
    assert len(begun) == 4 and not verify(end.folder).wrong


@pytest.mark.parametrize("kind", ["series", "end"])
def test_a_record_survives_a_kill(tmp_path: Path, kind: str) -> None:
    """Killed where the journal names a record, or after: what it names is on disk, and nothing is made twice."""
    request = RunRequest(write(tmp_path, "p.yaml", CYCLE), VIRTUAL, tmp_path / "results", "r")
    folder = tmp_path / "results" / "r"
    whole = run_campaign(tmp_path, "whole", CYCLE)
    kinds = [entry["kind"] for entry in load_journal(whole.folder / "journal.jsonl")]
    assert _attempt(lambda: prepare(request), at_record(kinds.index(kind) + 1, torn=kind == "end"))
    assert not _attempt(lambda: prepare_resume(folder), None)
    assert not verify(folder).wrong
    rows = [len(pd.read_parquet(path)) for path in sorted((folder / "series").glob("turning*"))]
    assert rows == [240] * 4


def test_a_pause_waits_for_the_end_of_the_record(tmp_path: Path) -> None:
    plan = prepare(RunRequest(write(tmp_path, "p.yaml", CYCLE), VIRTUAL, tmp_path / "results", "x")).checked.plan
    hold = pauser(SimpleNamespace(paused=True), plan, ResumePolicy())  # type: ignore[arg-type]
    untouched: Any = None
    for step in plan:
        if step.record_step in (None, step.number):
            with pytest.raises(AttributeError):
                hold(untouched, step)
        else:
            hold(untouched, step)
    assert [step.verb for step in plan if step.record == "turning-2"] == ["record", "dwell", "end_record"]


def test_lost_frames_fail_a_record(tmp_path: Path) -> None:
    faults = [{"name": "loss", "on": "FOG-A01", "probability": 0.02}]
    bench = virtual_bench(tmp_path, seed=1, faults=faults)
    end = run_campaign(tmp_path, "r", CYCLE, bench)
    assert end.outcome == "FAIL" and "record 'cycle' of FOG-A01" in end.message and "lost" in end.message
    series = {(one["label"], one["dut"]): one["verdict"] for one in end.manifest["series"]}
    assert series["cycle", "FOG-A01"] == "fail" and series["cycle", "FOG-B01"] == "pass"
    cycle = series_of(end.folder, "cycle-FOG-A01")
    assert 0.97 < cycle["frames"].sum() / (100 * len(cycle)) < 0.99


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ("[{acquire: {count: 10, every: 1 s}}]", "a point cannot be measured inside a record"),
        ("[{record: {name: b, every: 1 s, steps: [{dwell: 1 min}]}}]", "a record inside a record"),
    ],
)
def test_what_a_record_cannot_hold(tmp_path: Path, steps: str, message: str) -> None:
    text = f"procedure: p\nsteps:\n  - record: {{name: a, every: 1 s, steps: {steps}}}\n"
    with pytest.raises(InvalidFiles, match=message):
        prepare(RunRequest(write(tmp_path, "p.yaml", text), VIRTUAL, tmp_path / "results", "r"))


def test_a_row_cannot_be_shorter_than_a_frame(tmp_path: Path) -> None:
    text = "procedure: p\nsteps:\n  - record: {name: a, every: 5 ms, steps: [{dwell: 1 min}]}\n"
    with pytest.raises(InvalidFiles, match=r"p.yaml:3:5.*faster than the 100 Hz of DUT"):
        prepare(RunRequest(write(tmp_path, "p.yaml", text), VIRTUAL, tmp_path / "results", "r"))
