"""The guardian takes over when the runner of a real bench dies or hangs: proved against live simulators on ptys."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from bench.guardian import FILE
from bench.journal import load_journal
from simulated_hw.wire import acutronic_acl
from tests.bench.campaigns import ROOT, write
from tests.bench.test_run_real import SPEC
from tests.live_bench import LiveBench

PROCEDURE = """\
procedure: guarded
steps:
  - set_temperature: {to: 25 degC, band: 2 K}
  - set_rate: 60 deg/s
  - settle: {band: 0.1 deg/s, for: 0.5 s, timeout: 10 s}
  - acquire: {for: 10 min, every: 1 s}
"""
ONE_GYRO = replace(SPEC, duts={"S1": SPEC.duts["S1"]})

pytestmark = pytest.mark.wall


@pytest.fixture
def live() -> Iterator[LiveBench]:
    with LiveBench(ONE_GYRO, "unused") as bench:
        yield bench


def start(tmp_path: Path, live: LiveBench) -> subprocess.Popen[str]:
    bench = f"""\
bench: guarded
chamber:
  {{driver: watlow_f4, port: {live.ttys["chamber"]}, limits: {{temperature: {{from: -60 degC, to: 90 degC}}}}}}
rate_table:
  {{driver: acutronic_acl, port: {live.ttys["rate_table"]}, settings: {{baud: 115200}}, limits: {{rate: 400 deg/s}}}}
duts:
  S1: {{driver: serial_frames, port: {live.ttys["S1"]}, settings: {{frame: kvh_36_c100}}, limits: {{rate: 200 deg/s}}}}
"""
    command = [sys.executable, "-m", "bench.cli", "run", str(write(tmp_path, "p.yaml", PROCEDURE))]
    command += ["--bench", str(write(tmp_path, "b.yaml", bench)), "--results", str(tmp_path / "results")]
    process = subprocess.Popen(
        [*command, "--run-id", "g"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    wait_until(lambda: live.table_rate_dps() > 59.0, process)
    return process


def wait_until(true: Callable[[], bool], process: subprocess.Popen[str], seconds: float = 40.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        if time.monotonic() > deadline:
            process.kill()
            raise AssertionError(process.communicate())
        time.sleep(0.05)


def test_kill_9_of_the_runner_brings_the_table_to_rest(tmp_path: Path, live: LiveBench) -> None:
    process = start(tmp_path, live)
    process.send_signal(signal.SIGKILL)
    process.wait()
    wait_until(lambda: abs(live.table_rate_dps()) < 0.05, process, 15.0)
    told = tmp_path / "results" / "g" / FILE
    wait_until(lambda: told.exists() and not json.loads(told.read_text())["failures"], process, 15.0)
    about = json.loads(told.read_text())
    assert about["why"] == "the run process died"
    assert any("at rest" in text for text in about["done"]) and any("setpoint" in text for text in about["done"])


def test_a_runner_that_hangs_is_killed_and_replaced(tmp_path: Path, live: LiveBench) -> None:
    os.environ["FOGBENCH_GUARDIAN_PATIENCE_S"] = "3"
    try:
        process = start(tmp_path, live)
    finally:
        del os.environ["FOGBENCH_GUARDIAN_PATIENCE_S"]
    process.send_signal(signal.SIGSTOP)
    wait_until(lambda: abs(live.table_rate_dps()) < 0.05, process, 20.0)
    assert process.wait(timeout=10) == -signal.SIGKILL


def test_an_orderly_end_dismisses_it(tmp_path: Path, live: LiveBench) -> None:
    process = start(tmp_path, live)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=40)
    assert process.returncode == 130, output + errors
    folder = tmp_path / "results" / "g"
    assert not (folder / FILE).exists()
    assert sum(entry["kind"] == "safe" for entry in load_journal(folder / "journal.jsonl")) == 2
    assert abs(live.table_rate_dps()) < 0.05


def test_another_table_on_the_port_is_not_commanded(
    tmp_path: Path, live: LiveBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody changed tables: the guardian says so, commands the chamber alone, and goes on looking for the first."""
    process = start(tmp_path, live)
    told = tmp_path / "results" / "g" / FILE
    with monkeypatch.context() as exchanged:
        exchanged.setattr(acutronic_acl, "_IDENTITY", "Acutronic USA, ACT2000, serial 7")
        process.send_signal(signal.SIGKILL)
        process.wait()
        # The chamber may need a second look, after an answer that was still on its way to the runner.
        wait_until(lambda: told.exists() and len(json.loads(told.read_text())["failures"]) == 1, process, 20.0)
        about = json.loads(told.read_text())
        assert live.table_rate_dps() > 59.0
        assert len(about["done"]) == 1 and "setpoint" in about["done"][0]
        (failure,) = about["failures"]
        assert "'Acutronic USA, ACT2000, serial 7' answers now; it was not commanded" in failure
    wait_until(lambda: abs(live.table_rate_dps()) < 0.05, process, 20.0)
    wait_until(lambda: not json.loads(told.read_text())["failures"], process, 15.0)
