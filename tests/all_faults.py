"""A campaign on a bench where everything goes wrong that can: its faults, and the person who sees it through."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from bench.conclude import RunEnd
from bench.resume import prepare_resume
from bench.run import Prepared, RunRequest, prepare, run
from tests.bench.campaigns import virtual_bench, write
from tests.bench.faulty import DUTS, Record

# 7 temperatures x 13 rates, 300 samples each: a lab's campaign but for the number of points.
PROCEDURE = """\
procedure: everything_goes_wrong
raw: none
guards:
  - {name: chamber_alarm, watch: chamber_alarm, action: hold, clear_for: 1 min}
  - {name: door, watch: chamber_door, action: hold, clear_for: 1 min}
steps:
  - set_rate: 0 deg/s
  - sweep:
      temperature: [60 degC, 45 degC, 30 degC, 15 degC, 0 degC, -15 degC, -30 degC]
      ramp: 1 degC/min
      timeout: 2 h
      steps:
        - soak: {for: 2 h, until: {slope: 0.02 degC/min, over: 10 min}, timeout: 6 h}
        - sweep:
            rate: {from: -180 deg/s, to: 180 deg/s, step: 30 deg/s}
            steps:
              - settle: {band: 0.02 deg/s, for: 2 s, timeout: 60 s}
              - acquire: {count: 300, every: 0.3 s}
        - set_rate: 0 deg/s
analysis:
  models: [linear, ts_joint]
  splits:
    random: {share: 0.69, seed: 1}
    leave_temperatures_out: {folds: 7}
"""
RATES, TEMPERATURES, FRAMES, POINT_S = 13, 7, 9000, 90.0
MOST_ATTEMPTS = 30

# A bad line, all the time: (instruments, fault, its keys).
LINE: list[tuple[tuple[str, ...], str, Record]] = [
    (DUTS, "loss", {"probability": 1e-4}),
    (DUTS, "burst_loss", {"enter": 1e-5, "mean_frames": 10}),
    (DUTS[:1], "bit_error", {"probability": 2e-7}),
    (DUTS, "duplicate", {"probability": 1e-4}),
    (DUTS[:1], "sync_slip", {"probability": 5e-5}),
    (DUTS, "spike", {"probability": 1e-4, "size": "100 deg/s"}),
    (("chamber", "rate_table"), "no_reply", {"probability": 2e-3}),
    (("chamber", "rate_table"), "late_reply", {"probability": 2e-3, "delay": "1.5 s"}),
    (("chamber", "rate_table"), "garbled_reply", {"probability": 2e-3}),
]
# Once, at a place: temperature, rate (without its sign: where the table first gets there), instrument, fault, its keys.
PLACES: list[tuple[float, float, str, str, Record]] = [
    (45.0, 150.0, "chamber", "alarm", {"for": "5 min"}),
    (45.0, 90.0, "chamber", "sensor_break", {"for": "4 min"}),
    (45.0, 30.0, "chamber", "door_open", {"for": "10 min", "leak": 30}),
    (30.0, 150.0, "rate_table", "e_stop", {"for": "1 min"}),
    (30.0, 90.0, "rate_table", "fault", {"for": "1 min"}),
    (30.0, 30.0, "rate_table", "over_speed", {"for": "1 min"}),
    (15.0, 150.0, "rate_table", "encoder_error", {"for": "3 min", "rate_offset": "0.5 deg/s"}),
    (15.0, 90.0, "rate_table", "stuck", {"for": "3 min"}),
    (15.0, 30.0, "rate_table", "encoder_error", {"for": "100 s", "rate_offset": "0.015 deg/s"}),
    (0.0, 150.0, "chamber", "no_reply", {"for": "1 min"}),
    (0.0, 120.0, "rate_table", "no_reply", {"for": "1 min"}),
    (0.0, 90.0, "chamber", "late_reply", {"for": "1 min", "delay": "10 s"}),
    (0.0, 60.0, "rate_table", "late_reply", {"for": "1 min", "delay": "10 s"}),
    (0.0, 30.0, "chamber", "garbled_reply", {"for": "1 min"}),
    (0.0, 0.0, "rate_table", "garbled_reply", {"for": "20 s"}),
    (-15.0, 150.0, "FOG-A01", "silence", {"for": "10 min"}),
    (-15.0, 60.0, "FOG-B01", "silence", {"for": "40 s"}),
]
# Once, at a time: so long after the beginning of this point of the first temperature, with how often points before it
# were measured again.
TIMES: list[tuple[int, int, float, str, str, Record]] = [
    (2, 0, 40.0, "FOG-A01", "power_reset", {"for": "3 s"}),
    (3, 1, 40.0, "FOG-B01", "power_reset", {"for": "3 s"}),
    (4, 2, 40.0, "FOG-A01", "silence", {"for": "20 s"}),
    (5, 3, 40.0, "FOG-B01", "silence", {"for": "20 s"}),
    (6, 4, 30.0, "FOG-A01", "frozen", {"for": "20 s"}),
    (7, 5, 30.0, "FOG-B01", "frozen", {"for": "20 s"}),
    (8, 6, 60.0, "FOG-A01", "late", {"for": "1.5 s"}),
    (9, 6, 60.0, "FOG-B01", "late", {"for": "1.5 s"}),
    # two points in a row, and again: what stays bad
    (11, 6, -10.0, "FOG-A01", "frozen", {"for": "200 s"}),
]
WEAK = {
    "name": "weak_cooling",
    "on": "chamber",
    "when": {"setpoint_below": "-20 degC"},
    "for": "3 h",
    "remaining": 0.15,
}


@dataclass(frozen=True)
class Story:
    """The campaign as it went: how every attempt ended, and the faults that were scripted."""

    ends: list[RunEnd]
    faults: list[Record]

    @property
    def end(self) -> RunEnd:
        """How it ended at last."""
        return self.ends[-1]

    @property
    def run(self) -> Path:
        """The run folder."""
        return self.end.folder


def place(degc: float, rate_dps: float) -> Record:
    """The condition that chamber and table are there."""
    slow = {"table_below": "1 deg/s"}
    # Narrow: the table passes other rates on its way, and the simulators look once a second.
    fast = {"table_above": f"{rate_dps - 1} deg/s", "table_below": f"{rate_dps + 1} deg/s"}
    return {"chamber_above": f"{degc - 2} degC", "chamber_below": f"{degc + 2} degC"} | (fast if rate_dps else slow)


def scripted(begin_s: dict[int, float]) -> list[Record]:
    """Every fault there is; begin_s: when the points of the first temperature begin on a healthy bench."""
    faults = [{"name": name, "on": on, **about} for ons, name, about in LINE for on in ons]
    faults += [{"name": name, "on": on, "when": place(degc, rate), **about} for degc, rate, on, name, about in PLACES]
    for point, repeats, into_s, on, name, about in TIMES:
        faults.append({"name": name, "on": on, "at": f"{begin_s[point] + repeats * POINT_S + into_s} s", **about})
    return [*faults, WEAK]


def bench_with(folder: Path, faults: list[Record]) -> Path:
    """The default virtual bench, its chamber's door with a switch."""
    duts = {"FOG-A01": {"class": "ts_a"}, "FOG-B01": {"class": "ts_b"}}
    path = virtual_bench(folder, seed=5, duts=duts, faults=faults)
    bench: dict[str, Any] = yaml.safe_load(path.read_text())
    bench["chamber"]["settings"] = {"door_register": 106}
    path.write_text(yaml.safe_dump(bench, sort_keys=False))
    return path


def prepared(folder: Path, run_id: str, faults: list[Record]) -> Prepared:
    procedure = write(folder, f"{run_id}.yaml", PROCEDURE)
    return prepare(RunRequest(procedure, bench_with(folder, faults), folder / "results", run_id))


def begins_by_forecast(folder: Path) -> dict[int, float]:
    """When the points of the first temperature begin, as the rehearsal has it."""
    rehearsed = prepared(folder, "rehearsed", [])
    ends_s = rehearsed.forecast.ends_s
    points = {step.point: step.number for step in rehearsed.checked.plan if step.point is not None}
    return {point: ends_s[number - 2] for point, number in points.items() if point <= RATES}


def seen_through(folder: Path) -> Story:
    """Run the campaign as a person would: take it up again after every error, then measure what is missing."""
    faults = scripted(begins_by_forecast(folder))
    ends = [run(prepared(folder, "all", faults))]
    carried_out = False
    while len(ends) < MOST_ATTEMPTS:
        carried_out |= ends[-1].outcome != "ERROR"
        if ends[-1].outcome != "ERROR" and not ends[-1].manifest["missing"]:
            break
        ends.append(run(prepare_resume(ends[-1].folder, missing=carried_out)))
    return Story(ends, faults)
