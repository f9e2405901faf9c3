"""Making safe: order, deadlines, read-back, and that nothing that fails keeps the rest from being made safe."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import pytest
import simpy
import yaml

from bench.benchfile import load_bench
from bench.clock import Clock, VirtualClock, WallClock
from bench.composition import open_rehearsal
from bench.engine import Engine
from bench.journal import MemoryLog
from bench.overrides import editor, parse_overrides
from bench.safe import NOT_SAFE, make_safe
from bench.station import Station
from drivers.errors import NoReply
from tests.bench.campaigns import VIRTUAL, run_campaign, write

BENCH = """\
bench: b
chamber:
  driver: watlow_f4
  port: sim://chamber
  limits: {{temperature: {{from: -60 degC, to: 90 degC}}}}
  safe: {{{chamber}}}
rate_table: {{driver: acutronic_acl, port: sim://table, limits: {{rate: 400 deg/s}}, safe: {{{table}}}}}
duts:
  A1: {{driver: serial_frames, port: sim://a1, limits: {{rate: 200 deg/s}}}}
"""


@dataclass
class Fake:
    """A table and a chamber in one: notes what is said to it, and breaks off where it is told to."""

    clock: Clock
    stops_in_s: float = 1.0
    reads_degc: float = 31.23
    setpoint: float = 40.0
    keeps: Callable[[float], float] = lambda value: value
    fails: Callable[[str], bool] = lambda what: False
    said: list[tuple[float, str]] = field(default_factory=list)
    stopped_s: float | None = None

    def _say(self, what: str) -> None:
        self.said.append((self.clock.now(), what))
        if self.fails(what):
            raise NoReply("fake", what, 1.0, 3)

    def stop(self) -> None:
        self._say("stop")
        self.stopped_s = self.clock.now()

    def rate_dps(self) -> float:
        turning = self.stopped_s is None or self.clock.now() < self.stopped_s + self.stops_in_s
        return 100.0 if turning else 0.01

    def release(self) -> None:
        self._say("release")

    def set_ramp_degc_min(self, rate: float | None) -> None:
        self._say(f"ramp {rate}")

    def set_setpoint_degc(self, value: float) -> None:
        self._say(f"setpoint {value:g}")
        self.setpoint = self.keeps(value)

    def setpoint_degc(self) -> float:
        return self.setpoint

    def temperature_degc(self) -> float:
        return self.reads_degc

    def off(self) -> None:
        self._say("off")

    def is_off(self) -> bool:
        return any(what == "off" for _, what in self.said)


@dataclass
class Made:
    """What was said to both, what is in the log, what did not work."""

    said: list[str]
    log: dict[str, str]
    failures: list[str]
    took_s: float


def made_safe(folder: Path, chamber: str = "", table: str = "", clock: Clock | None = None, **fake: Any) -> Made:
    path = folder / "b.yaml"
    path.write_text(BENCH.format(chamber=chamber, table=table))
    bench, problems = load_bench(path)
    assert bench is not None, problems
    clock = clock or VirtualClock(simpy.Environment())
    both, log = Fake(clock, **fake), MemoryLog()
    station = Station(chamber=cast(Any, both), table=cast(Any, both))
    engine = Engine({}, bench, station, clock, log, cast(Any, None))
    began_s = clock.now()
    failures = make_safe(engine)
    entries = {entry["instrument"]: entry["text"] for entry in log.entries if entry["kind"] == "safe"}
    return Made([what for _, what in both.said], entries, failures, clock.now() - began_s)


def test_all_is_commanded_at_once_the_table_first_and_released_only_at_rest(tmp_path: Path) -> None:
    made = made_safe(tmp_path, "action: go_to, temperature: 25 degC, rate: 2 degC/min", stops_in_s=5.0)
    assert made.said == ["stop", "ramp 2.0", "setpoint 25", "release"]
    assert made.failures == [] and 5.0 <= made.took_s < 6.0
    assert made.log == {
        "chamber": "setpoint 25 degC (go_to), reads 31.23 degC",
        "rate table": "at rest, reads +0.0100 deg/s, drive released",
    }


@pytest.mark.parametrize(
    ("chamber", "table", "said"),
    [
        ("order: 2", "order: 1", ["stop", "release", "ramp None", "setpoint 31.2"]),
        ("order: 1", "order: 2", ["ramp None", "setpoint 31.2", "stop", "release"]),
    ],
)
def test_a_declared_order_is_kept(tmp_path: Path, chamber: str, table: str, said: list[str]) -> None:
    assert made_safe(tmp_path, chamber, table).said == said


def test_a_table_that_never_stops_is_told_after_its_deadline_and_not_released(tmp_path: Path) -> None:
    made = made_safe(tmp_path, "order: 2", "order: 1, timeout: 20 s", stops_in_s=1e9)
    assert 20.0 < made.took_s < 21.0
    assert "release" not in made.said and "setpoint 31.2" in made.said
    assert made.failures == [made.log["rate table"]] and made.failures[0].startswith(NOT_SAFE)
    assert "still turning at 100 deg/s" in made.failures[0] and "E-stop" in made.failures[0]


def test_a_command_that_fails_is_tried_again_until_the_deadline(tmp_path: Path) -> None:
    tries: list[str] = []

    def twice(what: str) -> bool:
        tries.append(what)
        return what == "stop" and tries.count("stop") <= 2

    assert made_safe(tmp_path, fails=twice).failures == []
    dead = made_safe(tmp_path, table="timeout: 10 s", fails=lambda what: what == "stop")
    assert len(dead.failures) == 1 and "no reply" in dead.failures[0].lower()
    assert dead.log["chamber"].startswith("setpoint 31.2 degC (hold)") and 10.0 < dead.took_s < 11.0


def test_a_setpoint_that_is_read_back_otherwise_is_asked_for_again_and_told(tmp_path: Path) -> None:
    deaf = made_safe(tmp_path, "timeout: 3 s", keeps=lambda value: 40.0)
    assert deaf.said.count("setpoint 31.2") > 5
    assert "its setpoint reads 40 degC, 31.2 degC was asked for" in deaf.failures[0]
    # a controller set to whole degrees
    assert made_safe(tmp_path, keeps=round).failures == []


def test_what_cannot_be_a_temperature_is_not_held(tmp_path: Path) -> None:
    broken = made_safe(tmp_path, "timeout: 3 s", reads_degc=800.0)
    assert "reads 800 degC, outside its limits" in broken.failures[0]
    assert not any(what.startswith("setpoint") for what in broken.said)
    assert "setpoint 90" in made_safe(tmp_path, reads_degc=91.0).said


def test_off_is_read_back(tmp_path: Path) -> None:
    made = made_safe(tmp_path, "action: off")
    assert made.said == ["stop", "off", "release"] and made.log["chamber"] == "off, reads 31.23 degC"


def test_a_journal_that_takes_nothing_stops_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: MemoryLog) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(MemoryLog, "commit", full)
    made = made_safe(tmp_path)
    assert made.said[-1] == "release" and made.failures == ["journal: [Errno 28] No space left on device"]


def test_requests_while_making_safe_change_nothing_on_a_virtual_bench(tmp_path: Path) -> None:
    clock = VirtualClock(simpy.Environment())
    clock.stop.forget()
    for _ in range(3):
        clock.stop.ask()
        clock.stop.hurry()
    assert made_safe(tmp_path, clock=clock, stops_in_s=9.0).failures == []


def test_in_a_hurry_a_real_bench_is_commanded_and_not_waited_for(tmp_path: Path) -> None:
    clock = WallClock()
    clock.stop.forget()
    clock.stop.hurry()
    made = made_safe(tmp_path, clock=clock, stops_in_s=1e9)
    assert made.said == ["stop", "ramp None", "setpoint 31.2"]
    assert made.failures == [made.log["rate table"]] and "not waited for" in made.failures[0]
    assert made.log["chamber"].startswith("setpoint 31.2")


def test_a_run_leaves_a_chamber_off_and_the_next_one_switches_it_on(tmp_path: Path) -> None:
    bench = yaml.safe_load(VIRTUAL.read_text(encoding="utf-8"))
    bench["chamber"] |= {"safe": {"action": "off"}, "settings": {"conditioning_event": 2}}
    path = write(tmp_path, "bench.yaml", yaml.safe_dump(bench, sort_keys=False))
    end = run_campaign(tmp_path, "off", bench=path)
    assert end.outcome == "PASS", end.message
    safe = [event["text"] for event in end.manifest["events"] if event["kind"] == "safe"]
    assert any(text.startswith("chamber: off, reads ") for text in safe)


def test_the_table_comes_to_rest_by_its_own_deceleration(tmp_path: Path) -> None:
    """True rates of the simulated table after the stop: down at what the driver was told to demand, not by coasting."""
    demanded = parse_overrides(["bench.rate_table.settings.acceleration=20 deg/s^2"])
    bench, problems = load_bench(VIRTUAL, editor(demanded, "bench"))
    assert bench is not None, problems
    with open_rehearsal(bench, seed=1) as (station, clock):
        table = station.table
        assert table is not None
        table.energise()
        table.set_rate_dps(200.0)
        clock.wait(30.0)
        engine = Engine({}, bench, station, clock, MemoryLog(), cast(Any, None))
        began_s, rates = clock.now(), []
        table.stop()
        while clock.now() < began_s + 8.0:
            clock.wait(1.0)
            rates.append(table.rate_dps())
        steps = [before - after for before, after in pairwise(rates[1:])]
        assert steps == [pytest.approx(20.0, abs=1.0)] * len(steps)
        assert make_safe(engine) == [] and clock.now() - began_s == pytest.approx(10.0, abs=1.5)
