"""Going on after an interruption: what is kept, what is done again, what is refused."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench.errors import BenchFailure, Interrupted, UserMistake
from bench.journal import load_journal
from bench.resume import prepare_resume
from bench.resumption import Interruption, interruption_of
from bench.run import run
from bench.status import status_of
from tests.bench.campaigns import ENDLESS, ENDLESS_POINTS, GRID, ROOT, VIRTUAL, run_campaign, virtual_bench, write

STEPS_TO_POINT_9 = 9


def interrupted_run(tmp_path: Path, at_point: int, procedure: str = GRID) -> Path:
    """A run that was asked to stop when a point was finished."""
    from bench.run import RunRequest, prepare

    request = RunRequest(write(tmp_path, "p.yaml", procedure), VIRTUAL, tmp_path / "results", "r")
    stops: list[Any] = []

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.point == at_point:
            stops[0].ask()

    end = run(prepare(request), listen, stops.append)
    assert end.outcome == "ABORTED"
    return end.folder


def test_an_aborted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    folder = interrupted_run(tmp_path, at_point=STEPS_TO_POINT_9)
    before = pd.read_csv(folder / "points.csv")
    assert before["point"].max() == STEPS_TO_POINT_9
    end = run(prepare_resume(folder))
    points = pd.read_csv(folder / "points.csv")
    assert end.outcome == "PASS", end.message
    # what was finished stays, to the last digit; the rest follows, each once, in order
    pd.testing.assert_frame_equal(points.iloc[: len(before)], before)
    assert list(points["point"]) == [n for n in range(1, 29) for _ in range(2)]
    assert points["started_at_s"].is_monotonic_increasing
    assert end.manifest["attempts"] == 2
    kinds = [entry["kind"] for entry in load_journal(folder / "journal.jsonl")]
    assert kinds.count("resumed") == 1 and kinds.count("end") == 2


def test_the_setpoints_and_the_soak_are_done_again_after_a_power_cut(tmp_path: Path) -> None:
    """A virtual bench that starts again is at room temperature: the dwell at 10 degC has to be soaked anew."""
    folder = interrupted_run(tmp_path, at_point=STEPS_TO_POINT_9)
    run(prepare_resume(folder))
    entries = load_journal(folder / "journal.jsonl")
    resumed = next(i for i, entry in enumerate(entries) if entry["kind"] == "resumed")
    again = [entry["verb"] for entry in entries[resumed:] if entry.get("again")]
    assert again == ["set_temperature", "soak", "set_rate"] or again == [
        "set_temperature",
        "soak",
        "set_rate",
        "settle",
    ]


def test_resume_after_resume(tmp_path: Path) -> None:
    folder = interrupted_run(tmp_path, at_point=3)
    for point in (8, 15):
        stops: list[Any] = []

        def listen(progress: Any, point: int = point, stops: list[Any] = stops) -> None:
            if progress.finished and progress.step.point == point:
                stops[0].ask()

        assert run(prepare_resume(folder), listen, stops.append).outcome == "ABORTED"
    end = run(prepare_resume(folder))
    assert end.outcome == "PASS" and end.manifest["attempts"] == 4
    assert len(pd.read_csv(folder / "points.csv")) == 56


def test_a_run_that_finished_says_so(tmp_path: Path) -> None:
    end = run_campaign(tmp_path, "whole")
    with pytest.raises(UserMistake, match="finished; there is nothing to resume"):
        prepare_resume(end.folder)


def test_a_changed_procedure_is_shown_and_refused_unless_accepted_by_name(tmp_path: Path) -> None:
    folder = interrupted_run(tmp_path, at_point=STEPS_TO_POINT_9)
    later = GRID.replace("to: 30 degC", "to: 20 degC")
    write(tmp_path, "p.yaml", later)
    with pytest.raises(UserMistake) as refusal:
        prepare_resume(folder)
    text = str(refusal.value)
    assert "-      temperature: {from: 0 degC, to: 30 degC, step: 10 K}" in text
    assert "+      temperature: {from: 0 degC, to: 20 degC, step: 10 K}" in text and "--accept procedure" in text
    prepared = prepare_resume(folder, ["procedure"])
    assert prepared.checked.points == 21
    end = run(prepared)
    assert end.outcome == "PASS", end.message
    assert end.manifest["points_planned"] == end.manifest["points_measured"] == 21
    assert (folder / "procedure.yaml").read_text() == later


def test_a_change_of_what_was_measured_is_refused_even_if_accepted(tmp_path: Path) -> None:
    folder = interrupted_run(tmp_path, at_point=STEPS_TO_POINT_9)
    write(tmp_path, "p.yaml", GRID.replace("count: 20", "count: 25"))
    with pytest.raises(UserMistake, match="has been run and would be another"):
        prepare_resume(folder, ["procedure"])


def test_a_procedure_with_includes_is_resumed_from_its_copies(tmp_path: Path) -> None:
    part = "      steps:\n        - soak: 10 min\n"
    assert part in GRID
    write(tmp_path, "soaking.yaml", "steps:\n  - soak: 10 min\n")
    including = GRID.replace("- soak: 10 min", "- include: soaking.yaml")
    folder = interrupted_run(tmp_path, at_point=2, procedure=including)
    (tmp_path / "soaking.yaml").unlink()
    (tmp_path / "p.yaml").unlink()
    assert run(prepare_resume(folder)).outcome == "PASS"


def test_a_torn_tail_is_cut_and_the_run_goes_on(tmp_path: Path) -> None:
    folder = interrupted_run(tmp_path, at_point=5)
    path = folder / "journal.jsonl"
    path.write_bytes(path.read_bytes() + b'deadbeef {"n":99999,"t_s":1.0,"ki')
    assert run(prepare_resume(folder)).outcome == "PASS"
    load_journal(path)


@pytest.mark.parametrize(
    ("records", "expected"),
    [
        ([("step", 10, 1)], Interruption(0, 10.0)),
        ([("step", 10, 1), ("done", 20, 1)], Interruption(1, 20.0)),
        (
            [("step", 10, 1), ("done", 20, 1), ("step", 20, 2), ("readback", 50, None)],
            Interruption(1, 50.0, 30.0, {"A": 5.0}),
        ),
        ([("step", 0, 1), ("point", 5, None), ("point", 5, None)], Interruption(0, 5.0, 0.0, {}, 2)),
    ],
)
def test_where_a_journal_stopped(records: list[tuple[str, float, int | None]], expected: Interruption) -> None:
    entries: list[dict[str, Any]] = [{"n": 0, "t_s": 0.0, "kind": "journal"}]
    for kind, t_s, step in records:
        more: dict[str, Any] = {"step": step} if step else {}
        if kind == "step":
            more["verb"] = "soak" if step == 2 else "acquire"
        if kind == "readback":
            more["dut_degc"] = {"A": 5.0}
        if kind == "point":
            more["row"] = {"point": 1, "dut": "A"}
        entries.append({"n": len(entries), "t_s": float(t_s), "kind": kind, **more})
    assert interruption_of(entries) == expected


class Live:
    """A campaign in a process of its own."""

    def __init__(self, tmp_path: Path) -> None:
        self.folder = tmp_path / "results" / "live"
        self.results = tmp_path / "results"
        endless = write(tmp_path, "endless.yaml", ENDLESS)
        command = [sys.executable, "-m", "bench.cli", "run", str(endless), "--bench", str(VIRTUAL)]
        command += ["--results", str(self.results), "--run-id", "live"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)

    def say(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "bench.cli", *arguments, "live", "--results", str(self.results)]
        return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)

    def status(self) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self.say("status", "--json").stdout)
        return answer


def wait_until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.mark.wall
def test_pause_continue_abort_and_status_from_another_process(tmp_path: Path) -> None:
    live = Live(tmp_path)
    try:
        journal = live.folder / "journal.jsonl"
        wait_until(lambda: journal.exists() and b'"kind":"point"' in journal.read_bytes())
        assert live.say("pause").returncode == 0
        wait_until(lambda: b'"kind":"paused"' in journal.read_bytes())
        status = live.status()
        assert (
            status["state"] == "paused" and status["points_planned"] == ENDLESS_POINTS and status["remaining_s"] > 3600
        )
        size = journal.stat().st_size
        time.sleep(0.5)
        assert journal.stat().st_size == size  # virtual time stands still
        again = live.say("run", str(ROOT / "procedures" / "smoke.yaml"), "--bench", str(VIRTUAL), "--run-id")
        assert again.returncode == 2 and "already exists" in again.stderr
        busy = live.say("resume")
        assert busy.returncode == 2 and f"process {live.process.pid}" in busy.stderr
        assert live.say("continue").returncode == 0
        wait_until(lambda: b'"kind":"continued"' in journal.read_bytes())
        wait_until(lambda: status_of(live.folder)["points_measured"] > status["points_measured"])
        assert live.status()["state"] == "running"
        assert live.say("abort").returncode == 0
        output, errors = live.process.communicate(timeout=60)
        assert live.process.returncode == 130, errors
        assert "ABORTED" in output and status_of(live.folder)["state"] == "ended"
        assert live.say("pause").returncode == 2
    finally:
        live.process.kill()


@pytest.mark.wall
def test_a_killed_run_is_called_stopped_and_its_lock_is_free(tmp_path: Path) -> None:
    live = Live(tmp_path)
    try:
        wait_until(lambda: (live.folder / "points.csv").exists() or (live.folder / "journal.jsonl").exists())
        live.process.send_signal(signal.SIGKILL)
        live.process.wait()
        assert live.status()["state"] == "stopped"
        assert "fogbench resume live" in live.say("status").stdout
        prepare_resume(live.folder)
    finally:
        live.process.kill()


def test_the_folder_of_a_run_that_could_not_begin_is_not_left_behind(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    left = tmp_path / "results" / ".one.new"
    left.mkdir()
    (left / "procedure.yaml").write_text("half")
    end = run_campaign(tmp_path, "one")
    assert end.outcome == "PASS" and not left.exists()
    shutil.rmtree(end.folder)


def test_interrupted_is_what_a_stop_raises() -> None:
    from bench.clock import WallClock

    clock = WallClock()
    clock.stop.ask()
    with pytest.raises(Interrupted):
        clock.idle()


def test_a_virtual_bench_can_be_told_how_long_it_stood(tmp_path: Path) -> None:
    """Its time stands still between attempts: an alarm of an hour would be there at every resume."""
    fault = {"name": "alarm", "on": "chamber", "at": "20 min", "for": "1 h"}
    bench = virtual_bench(tmp_path, seed=1, duts={}, faults=[fault])
    end = run_campaign(tmp_path, "r", GRID, bench)
    assert end.outcome == "ERROR"
    with pytest.raises(BenchFailure, match="the chamber reports"):
        run(prepare_resume(end.folder))
    end = run(prepare_resume(end.folder, after_s=3600.0))
    assert end.outcome == "PASS", end.message
    gaps = [entry["gap_s"] for entry in load_journal(end.folder / "journal.jsonl") if entry["kind"] == "resumed"]
    assert gaps == [3600.0]
