"""fogbench simulate as typed: processes come and go at its ports, and a run against them measures in bench time."""

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench.cli.main import main
from bench.errors import ExitCode
from bench.journal import load_journal
from bench.run import RunRequest, prepare, run
from drivers.ports import open_serial
from drivers.rate_tables.acutronic_acl import AcutronicAcl
from tests.bench.campaigns import ROOT, VIRTUAL, write

PROCEDURE = """\
procedure: live
quality: {slope: 5 degC/min}
steps:
  - sweep:
      rate: [20 deg/s]
      steps:
        - settle: {band: 0.05 deg/s, for: 0.5 s, timeout: 20 s}
        - acquire: {count: 20, every: 0.1 s}
"""
ONE_GYRO = """\
bench: one_gyro
rate_table: {driver: acutronic_acl, port: sim://table, settings: {baud: 115200}, limits: {rate: 400 deg/s}}
duts:
  S1: {driver: serial_frames, port: sim://s1, settings: {frame: kvh_36_c100}, limits: {rate: 200 deg/s}}
"""
# A program of somebody's own: turns the table, listens to the gyro, and is killed while it does.
CLIENT = """\
import sys, serial
from drivers.ports import open_serial
from drivers.rate_tables.acutronic_acl import AcutronicAcl
table = AcutronicAcl(open_serial(sys.argv[1], 9600, 1.0), AcutronicAcl.Settings())
gyro = serial.serial_for_url(sys.argv[2], 921600)
table.energise()
table.set_rate_dps(50.0)
while abs(table.rate_dps() - 50.0) > 0.05:
    pass
while True:
    gyro.read(3600)
    print("turning", flush=True)
"""


@dataclass
class Simulator:
    """A running `fogbench simulate`."""

    process: subprocess.Popen[str]
    told: dict[str, Any]

    def end(self, number: signal.Signals = signal.SIGTERM) -> str:
        self.process.send_signal(number)
        _, errors = self.process.communicate(timeout=20)
        assert self.process.returncode == 0, errors
        return errors


Start = Callable[..., Simulator]


@pytest.fixture
def simulate() -> Iterator[Start]:
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: Any) -> Simulator:
        command = [sys.executable, "-m", "bench.cli", "simulate", *map(str, arguments), "--json"]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout and process.stderr
        line = process.stdout.readline()
        assert line, process.communicate()[1]
        return Simulator(process, json.loads(line))

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def points_of(tmp_path: Path, bench: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    end = run(prepare(RunRequest(write(tmp_path, "p.yaml", PROCEDURE), bench, tmp_path / "results", "live")))
    points = pd.read_csv(end.folder / "points.csv")
    assert end.outcome == "PASS", (end.message, list(points["reasons"]))
    return points, end.manifest


@pytest.mark.wall
@pytest.mark.parametrize("speed", [1, 5])
def test_a_run_against_the_printed_bench_measures_in_bench_time(simulate: Start, tmp_path: Path, speed: int) -> None:
    # the serial CAN adapter of python-can takes 2 s of the wall to open, so it is tried at one speed
    bench = write(tmp_path, "one.yaml", ONE_GYRO) if speed == 1 else VIRTUAL
    # by links, so that nobody who still looks for a pty of another test finds this one under its number
    wired = ["--links", tmp_path / "dev", "-o", tmp_path / "live.yaml"]
    live = simulate(bench, "--speed", speed, *wired, "--truth", tmp_path / "truth")
    assert live.told["bench_file"] == (tmp_path / "live.yaml").read_text(encoding="utf-8")
    began = time.monotonic()
    points, manifest = points_of(tmp_path, tmp_path / "live.yaml")
    took_s = time.monotonic() - began
    live.end()
    duts = ["S1"] if speed == 1 else ["FOG-A01", "FOG-B01"]
    assert not manifest["bench"]["virtual"] and list(points["dut"]) == duts
    assert (points["frames"] == 200).all() and (points["samples"] == 20).all() and (points["frames_lost"] == 0).all()
    assert points["rate_mean_dps"].between(18.0, 22.0).all()
    assert abs(points["rate_readback_dps"] - 20.0).max() < 0.05
    # two bench seconds, and what a loaded machine adds on the wall
    assert (points["ended_at_s"] - points["started_at_s"]).between(1.9, 2.5 + 0.5 * speed).all()
    assert manifest["duration_s"] < took_s * speed
    assert manifest["duration_s"] > manifest["wall_s"] * (0.9 * speed)
    assert {"truth.json", "truth.csv"} == {path.name for path in (tmp_path / "truth").iterdir()}


@pytest.mark.wall
def test_a_supply_is_switched_over_its_pty(simulate: Start, tmp_path: Path) -> None:
    supply = "supply: {driver: scpi_supply, port: sim://supply, settings: {baud: 57600}, safe: {action: off}}\n"
    bench = write(tmp_path, "one.yaml", ONE_GYRO.replace("duts:", f"{supply}duts:"))
    live = simulate(bench, "--speed", 5, "--links", tmp_path / "dev", "-o", tmp_path / "live.yaml")
    assert live.told["ports"]["supply"] == str(tmp_path / "dev" / "supply")
    steps = "[{power: off}, {dwell: 2 s}, {record: {name: on, every: 100 ms, steps: [{power: on}, {dwell: 5 s}]}}]"
    for attempt in ("first", "second"):
        text = f"procedure: live\nguards: [{{name: q, watch: sample_quality, lost: 1 %, over: 2 s}}]\nsteps: {steps}\n"
        request = RunRequest(write(tmp_path, "p.yaml", text), tmp_path / "live.yaml", tmp_path / "results", attempt)
        end = run(prepare(request))
        assert end.outcome == "PASS", end.message
        (series,) = end.manifest["series"]
        assert series["losses"]["lost"] == 0 and series["rows"] >= 49
        entries = load_journal(end.folder / "journal.jsonl")
        # the first run left it off, as its bench file says; the second switches it on to hear the gyro
        switched = [entry["to"] for entry in entries if entry["kind"] == "power"]
        assert switched == ["on"] * (attempt == "second") + ["off", "on"]
        assert "output off" in [entry["text"] for entry in entries if entry["kind"] == "safe"]
    live.end()


@pytest.mark.wall
def test_a_killed_client_leaves_the_table_turning_and_the_next_one_stops_it(simulate: Start, tmp_path: Path) -> None:
    live = simulate(VIRTUAL, "--speed", 5, "--tcp", "--truth", tmp_path / "truth", "--truth-every", "1 s")
    assert live.told["bench"] is None
    ports = live.told["ports"]
    command = [sys.executable, "-c", CLIENT, ports["rate_table"], ports["duts.FOG-A01"]]
    client = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert client.stdout and client.stdout.readline() == "turning\n"
    client.kill()
    client.communicate()
    turning = true_rates(tmp_path)
    time.sleep(1.0)
    later = true_rates(tmp_path)[len(turning) :]
    assert len(later) >= 3 and all(abs(rate - 50.0) < 0.1 for rate in later)
    port = open_serial(ports["rate_table"], 9600, 1.0)
    table = AcutronicAcl(port, AcutronicAcl.Settings())
    table.stop()
    deadline = time.monotonic() + 10.0
    while abs(table.rate_dps()) > 0.05:
        assert time.monotonic() < deadline
    table.release()
    port.close()
    time.sleep(0.5)
    live.end(signal.SIGINT)
    assert abs(true_rates(tmp_path)[-1]) < 1.0


def true_rates(folder: Path) -> list[float]:
    """What the simulator says of its table, a row a bench second; the last row may be under way."""
    with (folder / "truth" / "truth.csv").open(encoding="utf-8") as file:
        whole = [line for line in file if line.endswith("\n")]
    return [float(row["table_rate_dps"]) for row in csv.DictReader(whole)]


@pytest.mark.wall
def test_without_json_the_bench_file_is_all_of_stdout(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "bench.cli", "simulate", str(write(tmp_path, "one.yaml", ONE_GYRO))]
    process = subprocess.Popen(
        [*command, "--links", str(tmp_path / "dev")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr
    hint = process.stderr.readline()
    assert "one_gyro is live with 2 instruments" in hint and "fogbench run" in hint
    assert (tmp_path / "dev" / "S1").readlink().is_relative_to("/dev")
    process.send_signal(signal.SIGINT)
    text, errors = process.communicate(timeout=20)
    assert process.returncode == 0, errors
    assert f"port: {tmp_path}/dev/rate_table\n" in text and "clock:" not in text and "simulation:" not in text
    assert list((tmp_path / "dev").iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--speed", "0"], ["--speed"]),
        (["--can", "vcan0"], ["--can vcan0", "socketcan:vcan0"]),
        (["--tcp", "--links", "dev"], ["--tcp", "--links"]),
        (["--truth-every", "10 K"], ["--truth-every 10 K", "'2 h'"]),
        (["--truth-every", "0 s"], ["--truth-every 0 s", "above 0"]),
    ],
)
def test_a_mistake_is_told_before_anything_is_opened(
    arguments: list[str],
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert typed(monkeypatch, VIRTUAL, *arguments) == ExitCode.USER_MISTAKE
    errors = capsys.readouterr().err
    assert all(word in errors for word in words), errors
    assert list(tmp_path.iterdir()) == []


def test_two_gyros_of_one_identifier_cannot_share_a_bus(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    second = """
  FOG-B02:
    driver: can_dbc
    port: {interface: fogsim, channel: fog-b02}
    limits: {rate: 200 deg/s}

"""
    bench = VIRTUAL.read_text(encoding="utf-8").replace(
        "\n# What the drivers cannot", f"{second}# What the drivers cannot"
    )
    path = write(tmp_path, "b.yaml", bench)
    assert typed(monkeypatch, path, "--can", "virtual:x") == ExitCode.USER_MISTAKE
    assert "FOG-B01 and FOG-B02 send the same identifier 1A0" in capsys.readouterr().err


def test_a_bus_that_does_not_exist_is_a_failure_of_the_bench(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert typed(monkeypatch, VIRTUAL, "--can", "no_such:x") == ExitCode.BENCH_FAILED
    assert "no_such" in capsys.readouterr().err


def typed(monkeypatch: pytest.MonkeyPatch, *arguments: Any) -> int:
    monkeypatch.setattr(sys, "argv", ["fogbench", "simulate", *map(str, arguments)])
    with pytest.raises(SystemExit) as left:
        main()
    return int(left.value.code or 0)
