"""Campaigns on benches with faults, and what the simulators' own log says of them."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from bench.conclude import RunEnd
from tests.bench.campaigns import run_campaign, virtual_bench

Record = dict[str, Any]

COUNTED = ("duplicates", "bad_checksum", "skipped_bytes", "resyncs")
DUTS = ("FOG-A01", "FOG-B01")  # one on a serial line, one on a CAN bus
# One temperature, three rates: what a fault does to a run shows in a second.
SHORT = """\
procedure: short
quality: {slope: 5 degC/min}
steps:
  - set_rate: 0 deg/s
  - set_temperature: {to: 20 degC, band: 2 K, timeout: 2 h}
  - soak: 10 min
  - sweep:
      rate: {from: 0 deg/s, to: 100 deg/s, step: 50 deg/s}
      steps:
        - settle: {band: 0.05 deg/s, for: 1 s, timeout: 30 s}
        - acquire: {count: 20, every: 0.5 s}
  - set_rate: 0 deg/s
"""
# While the table turns at the last of these rates.
AT_100: Record = {"when": {"table_above": "60 deg/s"}}


@dataclass
class Session:
    """What a gyro's reader got to hear between two discards: frames first ... end - 1, and what was done to them."""

    began_s: float
    first: int
    end: int = 0
    records: list[Record] = field(default_factory=list)

    def numbers(self, *faults: str) -> set[int]:
        """The frames that suffered these faults."""
        records = (record for record in self.records if record["fault"] in faults and "frame" in record)
        return {number for record in records for number in range(record["frame"], record["frame"] + record["frames"])}

    @property
    def lost(self) -> set[int]:
        """Frames that are missing by their counter."""
        records = (record for record in self.records if record.get("lost"))
        return {number for record in records for number in range(record["frame"], record["frame"] + record["frames"])}

    @property
    def reset(self) -> set[int]:
        """Frames that no counter tells of: it began anew behind them."""
        return self.numbers("power_reset")

    @property
    def countable(self) -> int:
        """Frames lost between two that arrived; a counter tells of no others."""
        gone = self.lost | self.reset
        first = next((number for number in range(self.first, self.end) if number not in gone), None)
        last = next((number for number in range(self.end - 1, self.first - 1, -1) if number not in gone), None)
        return 0 if first is None or last is None else sum(first < number < last for number in self.lost)

    def total(self, name: str) -> int:
        """By how much a receiver that counts rightly counts higher."""
        return sum(record.get(name, 0) for record in self.records)


def truth_folder(run: Path) -> Path:
    return run.parent / ".truth" / run.name


def truth_folders(run: Path) -> list[Path]:
    """The truth of every attempt of a run, in order."""
    first = truth_folder(run)
    later = sorted(first.glob("attempt-*"), key=lambda path: int(path.name.removeprefix("attempt-")))
    return [first, *later]


def faults_in(folder: Path) -> list[Record]:
    return [json.loads(line) for line in (folder / "faults.jsonl").read_text().splitlines()]


def faults_of(end: RunEnd) -> list[Record]:
    return faults_in(truth_folder(end.folder))


def sessions_in(records: list[Record], dut: str) -> list[Session]:
    """The sessions of one world; the log ends with a discard of nothing."""
    sessions: list[Session] = []
    for record in records:
        if record["instrument"] != dut or "frame" not in record:
            continue
        if record["fault"] == "discard":
            if sessions:
                sessions[-1].end = record["frame"]
            sessions.append(Session(record["t_s"], record["frame"] + record["frames"]))
        else:
            sessions[-1].records.append(record)
    return sessions[:-1]


def sessions_of(end: RunEnd, dut: str) -> list[Session]:
    return sessions_in(faults_of(end), dut)


def session_of(row: pd.Series, sessions: list[Session]) -> Session:
    """The one in which a point was measured."""
    return [session for session in sessions if session.began_s <= row["started_at_s"] + 1e-6][-1]


def points_of(end: RunEnd, dut: str | None = None) -> pd.DataFrame:
    points = pd.read_csv(end.folder / "points.csv", keep_default_na=False)
    return points if dut is None else points[points["dut"] == dut]


def events(end: RunEnd, *kinds: str) -> list[str]:
    """What the record says happened, of these kinds if any are named."""
    return [event["text"] for event in end.manifest["events"] if not kinds or event["kind"] in kinds]


def broken(folder: Path, *faults: Record, procedure: str = SHORT) -> RunEnd:
    return run_campaign(folder, "broken", procedure, virtual_bench(folder, seed=1, faults=list(faults)))


def begins(records: list[Record]) -> Iterator[tuple[str, float]]:
    """Fault and time of everything that began."""
    return ((record["fault"], record["t_s"]) for record in records if record.get("state") == "begins")
