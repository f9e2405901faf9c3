"""Live simulators for the crash trial: they outlive every run, and their truth log is the judge of how each ended."""

import csv
import json
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType

from bench.guardian import FILE as GUARDIAN_FILE
from bench.guardian import LOG as GUARDIAN_LOG
from bench.safe import AT_REST_DPS

ROOT = Path(__file__).resolve().parents[1]
SPEED = 20.0
SAFE_DEGC = 25.0
# By when the bench file says that table and chamber are to be safe; bench time.
DECLARED_S = 120.0
BENCH = f"""\
bench: crash_live
chamber:
  driver: watlow_f4
  port: sim://chamber
  limits: {{temperature: {{from: -60 degC, to: 90 degC}}}}
  safe: {{action: go_to, temperature: {SAFE_DEGC:g} degC, rate: 1 degC/min, timeout: {DECLARED_S:g} s}}
rate_table:
  driver: acutronic_acl
  port: sim://table
  settings: {{baud: 115200}}
  limits: {{rate: 400 deg/s}}
  safe: {{timeout: {DECLARED_S:g} s}}
duts:
  FOG-A01:
    driver: serial_frames
    port: sim://fog-a01
    settings: {{frame: kvh_36_c100, baud: 921600, data_rate: 100 Hz}}
    limits: {{rate: 200 deg/s}}
"""
# Away from the safe state in both: the chamber at 28 degC, the table turning nearly all the time.
PROCEDURE = """\
procedure: crash
raw: samples
quality: {slope: 50 degC/min, lost: 20 %, repeats: 0}
steps:
  - set_temperature: {to: 28 degC, band: 2 K}
  - sweep:
      rate: [-100 deg/s, 60 deg/s, 100 deg/s]
      steps:
        - soak: 10 s
        - settle: {band: 1 deg/s, for: 0.5 s}
        - acquire: {count: 20, every: 0.5 s}
  - dwell: 10 s
"""
POINTS, DUTS = 3, 1
# How long a guardian may take to write what it did, on the wall.
_PATIENCE_S = 30.0


class LiveSimulators:
    """`fogbench simulate` in a process of its own; `bench` is the file to connect with."""

    def __init__(self, folder: Path) -> None:
        self.bench = folder / "live.yaml"
        self._truth = folder / "truth"
        written = folder / "crash_live.yaml"
        written.write_text(BENCH, encoding="utf-8")
        command = [sys.executable, "-m", "bench.cli", "simulate", str(written), "--speed", f"{SPEED:g}", "--json"]
        command += ["--links", str(folder / "dev"), "-o", str(self.bench)]
        command += ["--truth", str(self._truth), "--truth-every", "0.5 s"]
        self._process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def __enter__(self) -> "LiveSimulators":
        assert self._process.stdout
        if not self._process.stdout.readline():
            raise RuntimeError("the live simulators did not start")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        self._process.communicate(timeout=20)

    def now_s(self) -> float:
        """Bench time of the newest row of the truth."""
        return self._rows()[-1][0]

    def _rows(self) -> list[tuple[float, float, float]]:
        """(time, true rate of the table, setpoint commanded); the last line may be under way."""
        with (self._truth / "truth.csv").open(encoding="utf-8") as file:
            whole = [line for line in file if line.endswith("\n")]
        rows = [(row["t_s"], row["table_rate_dps"], row["commanded_degc"]) for row in csv.DictReader(whole)]
        return [(float(t_s), float(rate), float(degc)) for t_s, rate, degc in rows] or [(0.0, 0.0, SAFE_DEGC)]

    def safe_after_s(self, since_s: float) -> float | None:
        """How long after `since_s` table and chamber were safe for good; None if they are not now."""
        safe_since: float | None = None
        for t_s, rate_dps, commanded_degc in self._rows():
            if t_s > since_s:
                safe = abs(rate_dps) <= AT_REST_DPS and abs(commanded_degc - SAFE_DEGC) < 0.1
                safe_since = (t_s if safe_since is None else safe_since) if safe else None
        return None if safe_since is None else safe_since - since_s

    def ended_unsafe(self, run_folder: Path, killed: bool) -> bool:
        """Whether table and chamber were not safe within the declared time from now, by the simulator's own truth."""
        ended_s = self.now_s()
        while self.now_s() <= ended_s + DECLARED_S and self.safe_after_s(ended_s) is None:
            time.sleep(0.05)
        after_s = self.safe_after_s(ended_s)
        if killed and (run_folder / GUARDIAN_LOG).exists():
            self._wait_for_guardian(run_folder / GUARDIAN_FILE)
        # It is to stay so.
        return after_s is None or after_s > DECLARED_S or self.safe_after_s(ended_s) is None

    def _wait_for_guardian(self, told: Path) -> None:
        """Until the guardian has given the ports back; one that was never needed says nothing."""
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            if told.exists() and not json.loads(told.read_text(encoding="utf-8"))["failures"]:
                return
            time.sleep(0.05)
