"""Ctrl-C once, twice, three times, and what an interruption one minute before the end of a soak costs."""

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.control import Control
from bench.guardian import FILE
from bench.journal import load_journal
from bench.resume import prepare_resume
from bench.run import RunRequest, prepare, run
from bench.safe import NOT_SAFE
from tests.bench.campaigns import ROOT, VIRTUAL, write
from tests.bench.test_guardian import ONE_GYRO, PROCEDURE
from tests.live_bench import LiveBench

# At room temperature, where a virtual bench stands when it is started again.
SOAK = """\
procedure: soaking
steps:
  - set_temperature: {to: 25 degC, band: 2 K}
  - set_rate: 0 deg/s
  - soak: 2 h
  - acquire: {count: 10, every: 0.5 s}
"""
NEARLY_S = 7140.0
# Some seconds of the wall.
LONG = """\
procedure: long
quality: {slope: 5 degC/min}
steps:
  - set_rate: 10 deg/s
  - repeat: {times: 2000, steps: [acquire: {count: 20, every: 0.5 s}]}
"""


def wait_until(true: Callable[[], bool], process: subprocess.Popen[str], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        if time.monotonic() > deadline or process.poll() is not None:
            process.kill()
            raise AssertionError(process.communicate())
        time.sleep(0.02)


def start(tmp_path: Path, procedure: Path, bench: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "bench.cli", "run", str(procedure), "--bench", str(bench), "--run-id", "r"]
    command += ["--results", str(tmp_path / "results"), "--set", "procedure.raw=samples"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def safe_texts(folder: Path) -> list[str]:
    return [entry["text"] for entry in load_journal(folder / "journal.jsonl") if entry["kind"] == "safe"]


@pytest.mark.wall
def test_a_second_and_a_third_ctrl_c_on_a_virtual_bench(tmp_path: Path) -> None:
    process = start(tmp_path, write(tmp_path, "p.yaml", LONG), VIRTUAL)
    folder = tmp_path / "results" / "r"
    journal = folder / "journal.jsonl"
    wait_until(lambda: journal.exists() and b'"kind":"point"' in journal.read_bytes(), process)
    for _ in range(3):
        process.send_signal(signal.SIGINT)
        time.sleep(0.01)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    texts = safe_texts(folder)
    assert len(texts) == 2 and not any(text.startswith(NOT_SAFE) for text in texts)
    prepare_resume(folder)


@pytest.mark.wall
def test_a_second_ctrl_c_waits_for_nothing_and_the_guardian_sees_the_table_to_rest(tmp_path: Path) -> None:
    with LiveBench(ONE_GYRO, "unused") as live:
        # six seconds from 60 deg/s to rest
        bench = f"""\
bench: guarded
chamber:
  {{driver: watlow_f4, port: {live.ttys["chamber"]}, limits: {{temperature: {{from: -60 degC, to: 90 degC}}}}}}
rate_table:
  driver: acutronic_acl
  port: {live.ttys["rate_table"]}
  settings: {{baud: 115200, acceleration: 10 deg/s^2}}
  limits: {{rate: 400 deg/s}}
duts:
  S1: {{driver: serial_frames, port: {live.ttys["S1"]}, settings: {{frame: kvh_36_c100}}, limits: {{rate: 200 deg/s}}}}
"""
        process = start(tmp_path, write(tmp_path, "p.yaml", PROCEDURE), write(tmp_path, "b.yaml", bench))
        wait_until(lambda: live.table_rate_dps() > 59.0, process)
        process.send_signal(signal.SIGINT)
        wait_until(lambda: live.table_rate_dps() < 57.0, process)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
        still_dps = live.table_rate_dps()
        assert process.returncode == 130 and "stopped at once" in errors and "fogbench resume" in errors
        assert still_dps > 1.0, "it was waited for"
        folder = tmp_path / "results" / "r"
        chamber, table = sorted(safe_texts(folder), key=lambda text: text.startswith(NOT_SAFE))
        assert chamber.startswith("setpoint 25") and "still turning" in table and "not waited for" in table
        deadline = time.monotonic() + 40.0
        while not ((told := folder / FILE).exists() and not json.loads(told.read_text())["failures"]):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert any("drive released" in text for text in json.loads(told.read_text())["done"])
        assert abs(live.table_rate_dps()) < 0.05
    prepare_resume(folder)


def soaking(tmp_path: Path, at_nearly: Callable[[Any], None], stops: list[Any]) -> Path:
    """A run in which something is done one minute before the end of its soak."""
    procedure, began_s, done = write(tmp_path, "p.yaml", SOAK), [0.0], []

    def listen(progress: Any) -> None:
        if progress.step.verb != "soak":
            began_s[0] = progress.t_s
        elif not done and not progress.finished and progress.t_s - began_s[0] >= NEARLY_S:
            done.append(True)
            at_nearly(progress)

    end = run(prepare(RunRequest(procedure, VIRTUAL, tmp_path / "results", "r")), listen, stops.append)
    assert done
    return end.folder


def soaked_s(folder: Path) -> list[float]:
    """How long each soak of a journal lasted, until it was done or broken off."""
    lasted, began_s = [], None
    for entry in load_journal(folder / "journal.jsonl"):
        if entry["kind"] == "step" and entry["verb"] == "soak":
            began_s = entry["t_s"]
        elif began_s is not None and entry["kind"] in ("interrupted", "done"):
            lasted.append(entry["t_s"] - began_s)
            began_s = None
    return lasted


def test_an_abort_at_1_h_59_of_a_soak_costs_a_minute_and_not_two_hours(tmp_path: Path) -> None:
    stops: list[Any] = []
    folder = soaking(tmp_path, lambda progress: stops[0].ask(), stops)
    assert run(prepare_resume(folder)).outcome == "PASS"
    first, rest = soaked_s(folder)
    assert NEARLY_S <= first < 7200.0 and first + rest == pytest.approx(7200.0, abs=1.0)


def test_a_pause_at_1_h_59_of_a_soak_finishes_it_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    controls: list[Control] = []

    class Kept(Control):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            controls.append(self)

    def pause(progress: Any) -> None:
        controls[0].paused = True
        threading.Timer(0.3, lambda: setattr(controls[0], "paused", False)).start()

    monkeypatch.setattr("bench.run.Control", Kept)
    folder = soaking(tmp_path, pause, [])
    kinds = [entry["kind"] for entry in load_journal(folder / "journal.jsonl")]
    assert kinds.count("paused") == kinds.count("continued") == 1
    assert soaked_s(folder) == [pytest.approx(7200.0, abs=1.0)]
