"""The supply in procedures: DUTs that are off are not missed, and come back as from a turn-on."""

import csv
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from bench.acquire import RehearsedAcquirer
from bench.benchfile import load_bench
from bench.check import check
from bench.clock import VirtualClock
from bench.conclude import RunEnd
from bench.engine import Engine
from bench.errors import BenchFailure, InvalidFiles
from bench.journal import MemoryLog, load_journal
from bench.missing import Missing, steps_for
from bench.opening import open_commanded
from bench.overrides import parse_overrides
from bench.resume import prepare_resume
from bench.run import RunRequest, prepare, run
from bench.safe import make_safe
from bench.verify.verify import verify
from simulated_hw.world import InstrumentSpec, World, WorldSpec
from tests.bench.campaigns import ROOT, VIRTUAL, run_campaign, write

METRICS = ROOT / "benches" / "virtual_metrics.yaml"
DUTS = ("NAV-1", "HIGH-1")
SIGMA_DPH = 5.0
# Its turn-ons differ by far more than the noise of a record.
RESTLESS = tuple(f"bench.simulation.duts.{dut}.turn_on_bias_sigma={SIGMA_DPH} deg/h" for dut in DUTS)

# A turn-on test as a laboratory does it: Q = 6 cycles, each cold, warmed up and recorded.
CYCLES = """\
procedure: power_cycles
raw: samples
guards: [{name: frames, watch: sample_quality, lost: 1 %}]
steps:
  - set_temperature: {to: 25 degC, band: 1 K}
  - repeat:
      times: 6
      steps:
        - power: off
        - dwell: 30 min
        - power: on
        - dwell: 1 h
        - record: {name: turn-on, every: 10 s, steps: [dwell: 20 min]}
"""
# The same in a minute, and a point of each cycle.
SHORT = """\
procedure: short
raw: samples
quality: {slope: 5 degC/min}
steps:
  - set_temperature: {to: 25 degC, band: 1 K}
  - soak: 5 min
  - repeat:
      times: 2
      steps:
        - power: off
        - dwell: 10 min
        - power: on
        - dwell: 1 min
        - acquire: {count: 10, every: 1 s}
"""


def journal_of(folder: Path, *kinds: str) -> list[dict[str, Any]]:
    return [entry for entry in load_journal(folder / "journal.jsonl") if entry["kind"] in kinds]


def switched(folder: Path) -> list[str]:
    return [entry["to"] for entry in journal_of(folder, "power")]


def true_turn_ons(folder: Path, dut: str, at_s: list[float]) -> list[float]:
    """The hidden turn-on bias at these times."""
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        rows = [(float(row["t_s"]), float(row[f"turn_on_bias_dph:{dut}"])) for row in csv.DictReader(file)]
    return [max(row for row in rows if row[0] <= t)[1] for t in at_s]


@pytest.fixture(scope="module")
def cycles(tmp_path_factory: pytest.TempPathFactory) -> RunEnd:
    end = run_campaign(tmp_path_factory.mktemp("cycles"), "q6", CYCLES, METRICS, RESTLESS)
    assert end.outcome == "PASS", end.message
    return end


def test_every_cycle_has_the_turn_on_bias_of_the_truth_log(cycles: RunEnd) -> None:
    about = [entry["about"] for entry in journal_of(cycles.folder, "series")]
    truth = cycles.folder.parent / ".truth" / cycles.folder.name
    for dut in DUTS:
        mine = [one for one in about if one["dut"] == dut]
        assert [one["rows"] for one in mine] == [120] * 6
        names = [f"{one['label']}-{dut}.parquet" for one in mine]
        measured = [pd.read_parquet(cycles.folder / "series" / name)["rate_dps"].mean() * 3600.0 for name in names]
        true = true_turn_ons(truth, dut, [one["ended_at_s"] for one in mine])
        assert len(set(true)) == 6 and np.std(true) > 1.0
        # what is left is the drift of the coil's temperature and the noise of 20 min
        np.testing.assert_allclose(np.diff(measured), np.diff(true), atol=0.1 * SIGMA_DPH)


def test_what_was_off_is_not_missed(cycles: RunEnd) -> None:
    assert switched(cycles.folder) == ["off", "on"] * 6
    assert not journal_of(cycles.folder, "link", "warning", "guard", "dropped", "error")
    losses = journal_of(cycles.folder, "end")[0]["losses"]
    assert all(count == 0 for dut in DUTS for name, count in losses[dut].items() if name != "frames")
    assert not verify(cycles.folder).wrong
    # while they are off nothing is read of them, and at once when they are on again
    times = [entry["t_s"] for entry in journal_of(cycles.folder, "power")]
    for entry in journal_of(cycles.folder, "readback"):
        off = any(low < entry["t_s"] < high for low, high in list(pairwise(times))[::2])
        assert bool(entry["dut_degc"]) != off or entry["t_s"] in times, entry


@pytest.mark.parametrize("own", ["", "powers: [NAV-1]"])
def test_a_turn_on_is_recorded_from_its_first_frame(tmp_path: Path, own: str) -> None:
    text = METRICS.read_text(encoding="utf-8").replace(
        "  limits: {voltage: 32 V", f"  {own}\n  limits: {{voltage: 32 V"
    )
    steps = "[{dwell: 1 min}, {power: on}, {dwell: 5 min}]"
    procedure = f"""\
procedure: transient
steps:
  - power: off
  - dwell: 10 min
  - record: {{name: before, every: 1 s, steps: {steps}}}
  - power: {{to: off, duts: all}}
  - dwell: 10 min
  - power: {{to: on}}
  - record: {{name: after, every: 1 s, steps: [dwell: 5 min]}}
"""
    end = run_campaign(tmp_path, "r", procedure, write(tmp_path, "bench.yaml", text))
    assert end.outcome == "PASS", end.message
    about = {(one["label"], one["dut"]): one for one in (e["about"] for e in journal_of(end.folder, "series"))}
    on_s = [entry["t_s"] for entry in journal_of(end.folder, "power") if entry["to"] == "on"]
    for label, commanded_s in zip(("before", "after"), on_s, strict=True):
        one = about[label, "NAV-1"]
        assert one["started_at_s"] == pytest.approx(commanded_s, abs=0.5)
        assert one["rows"] == one["rows_planned"] and one["rows"] in (300, 301) and one["losses"]["lost"] == 0
    # one that has power of its own is recorded all the time
    assert about["before", "HIGH-1"]["rows"] in ((300, 301) if not own else (360, 361))
    assert not verify(end.folder).wrong


def stopped_at(tmp_path: Path, verb: str, count: int, bench: Path = METRICS, settings: tuple[str, ...] = ()) -> RunEnd:
    """SHORT, asked to stop after the count-th step of a verb."""
    done: list[Any] = []
    stops: list[Any] = []

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.verb == verb:
            done.append(progress)
            if len(done) == count:
                stops[0].ask()

    request = RunRequest(
        write(tmp_path, "p.yaml", SHORT), bench, tmp_path / "results", "r", None, parse_overrides(settings)
    )
    end = run(prepare(request), listen, stops.append)
    assert end.outcome == "ABORTED"
    return end


def test_resumed_in_the_off_phase_they_are_off_for_as_long_as_planned(tmp_path: Path) -> None:
    # A virtual bench begins with everything on: the power that was to be off is switched off again, the phase repeated.
    end = stopped_at(tmp_path, "power", 3, settings=RESTLESS)
    assert switched(end.folder) == ["off", "on", "off"]
    end = run(prepare_resume(end.folder))
    assert end.outcome == "PASS", end.message
    # established before: on, from the cycle before; then the phase from its beginning
    assert switched(end.folder) == ["off", "on", "off", "on", "off", "on"]
    times = [entry["t_s"] for entry in journal_of(end.folder, "power")]
    assert times[-1] - times[-2] == pytest.approx(600.0, abs=2.0)
    points = pd.read_csv(end.folder / "points.csv")
    assert list(points["point"]) == [1, 1, 2, 2] and set(points["verdict"]) == {"pass"}
    truth = end.folder.parent / ".truth" / "r"
    (first,) = true_turn_ons(truth, "NAV-1", [points["ended_at_s"].iloc[0]])
    (second,) = true_turn_ons(truth / "attempt-2", "NAV-1", [points["ended_at_s"].iloc[-1]])
    assert first != second
    assert not verify(end.folder).wrong


@pytest.fixture
def found_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every world begins with the supply's output off."""
    opened = World.open

    def dark(self: World) -> None:
        if self.spec.supply is not None and not self.spec.supply.address.startswith("sim://rehearsal"):
            self.supply.switch(float(self.env.now), False)
        opened(self)

    monkeypatch.setattr(World, "open", dark)


def test_resumed_in_the_off_phase_with_the_output_still_off(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    end = stopped_at(tmp_path, "power", 3)
    request.getfixturevalue("found_off")
    end = run(prepare_resume(end.folder))
    assert end.outcome == "PASS", end.message
    # nobody was cycled to be heard: still off, then on as planned
    assert switched(end.folder) == ["off", "on", "off", "off", "on"]
    identities = journal_of(end.folder, "identities")
    assert identities[0]["found"] == identities[1]["found"]


@pytest.mark.usefixtures("found_off")
def test_a_run_begins_with_the_duts_on(tmp_path: Path) -> None:
    end = run_campaign(tmp_path, "r", SHORT, METRICS)
    assert end.outcome == "PASS", end.message
    assert switched(end.folder) == ["on", "off", "on", "off", "on"]
    assert "was off" in journal_of(end.folder, "power")[0]["text"]


@pytest.mark.usefixtures("found_off")
def test_an_output_that_does_not_give_enough_is_told(tmp_path: Path) -> None:
    with pytest.raises(BenchFailure, match=r"NAV-1: .*after 2.5 s of listening"):
        run_campaign(tmp_path, "r", SHORT, METRICS, ("bench.simulation.supply.dut_current=1.5 A",))


def test_what_a_run_lacks_is_measured_with_the_power_it_was_planned_with(tmp_path: Path) -> None:
    faults = [{"name": "loss", "on": "NAV-1", "at": "27 min", "for": "1 min", "probability": 0.5}]
    end = run_campaign(tmp_path, "r", SHORT, METRICS, (f"bench.simulation.faults={faults}",))
    failed = pd.read_csv(end.folder / "points.csv").query("verdict == 'fail'")
    assert end.outcome == "FAIL" and len(failed) == 1
    end = run(prepare_resume(end.folder, missing=True))
    points = pd.read_csv(end.folder / "points.csv")
    assert set(points["verdict"]) == {"pass"} and switched(end.folder)[4:6] == ["off", "on"]


@pytest.mark.parametrize(("action", "expected"), [("keep", []), ("off", ["output off"])])
def test_how_the_supply_is_left(
    tmp_path: Path, action: str, expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    worlds: list[World] = []
    opened = World.open

    def noted(self: World) -> None:
        worlds.append(self)
        opened(self)

    monkeypatch.setattr(World, "open", noted)
    end = run_campaign(tmp_path, "r", SHORT, METRICS, (f"bench.supply.safe.action={action}",))
    assert end.outcome == "PASS"
    safe = [entry["text"] for entry in journal_of(end.folder, "safe") if entry["instrument"] == "power supply"]
    assert safe == expected
    assert worlds[-1].supply.on == (action == "keep")


def test_a_dut_that_does_not_come_back_is_left_out_like_any_silent_one(tmp_path: Path) -> None:
    faults = [{"name": "silence", "on": "NAV-1", "at": "8 min"}]
    end = run_campaign(tmp_path, "r", SHORT, METRICS, (f"bench.simulation.faults={faults}",))
    warnings = [entry["text"] for entry in journal_of(end.folder, "warning")]
    assert warnings and "nothing valid was received from NAV-1 in the" in warnings[0]
    assert ("NAV-1", "lost") in {(entry["instrument"], entry["state"]) for entry in journal_of(end.folder, "link")}
    points = pd.read_csv(end.folder / "points.csv")
    assert list(points.loc[points["dut"] == "HIGH-1", "verdict"]) == ["pass", "pass"]


def test_a_supply_that_does_not_answer_is_waited_for(tmp_path: Path) -> None:
    faults = [{"name": "no_reply", "on": "supply", "at": "5 min", "for": "7 min", "probability": 1}]
    settings = (f"bench.simulation.faults={faults}", "bench.links={patience: 20 min}")
    end = run_campaign(tmp_path, "r", SHORT, METRICS, settings)
    assert end.outcome == "PASS", end.message
    links = [(entry["instrument"], entry["state"]) for entry in journal_of(end.folder, "link")]
    assert links == [("power supply", "lost"), ("power supply", "restored")]
    assert set(pd.read_csv(end.folder / "points.csv")["verdict"]) == {"pass"}


def mistakes(tmp_path: Path, steps: str, bench: Path = METRICS, head: str = "") -> str:
    path = write(tmp_path, "p.yaml", f"procedure: p\n{head}steps:\n{steps}")
    with pytest.raises(InvalidFiles) as caught:
        check(path, bench)
    return "\n".join(str(problem) for problem in caught.value.problems)


@pytest.mark.parametrize(
    ("steps", "place", "message"),
    [
        ("  - power: off\n  - acquire: {count: 10, every: 1 s}\n", "4:5", "NAV-1, HIGH-1 would be off here"),
        ("  - power: {to: off, duts: [NAV-2]}\n", "3:5", "there is no DUT 'NAV-2'. Allowed: HIGH-1, NAV-1"),
        ("  - power: {to: off, duts: [NAV-1]}\n", "3:5", "one output: NAV-1, HIGH-1 are switched together. Add HIGH-1"),
        ("  - power: true\n", "3:12", "'to': true is not allowed. Allowed: off, on."),
        ("  - power: {duts: all}\n", "3:5", "the key 'to' is missing"),
        ("  - record: {name: a, every: 1 s, steps: [{dwell: 1 s}, {power: off}]}\n", "3:", "each turn-on is one"),
        (
            "  - power: off\n  - record: {name: a, every: 1 s, steps: [{dwell: 1 s}]}\n", "4:5",
            "off from its beginning to its end",
        ),
        (
            "  - power: off\n  - soak: {for: 1 h, until: {slope: 1 degC/h}, timeout: 2 h}\n", "4:5",
            "no DUT tells its temperature",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_before_hour_0(tmp_path: Path, steps: str, place: str, message: str) -> None:
    found = mistakes(tmp_path, steps)
    assert f"p.yaml:{place}" in found and message in found


def test_each_mistake_of_a_loop_is_said_once(tmp_path: Path) -> None:
    loop = "  - repeat: {times: 5, steps: [{power: off}, {acquire: {count: 10, every: 1 s}}, {power: on}]}\n"
    assert mistakes(tmp_path, loop).count("\n") == 0


def test_power_without_a_supply(tmp_path: Path) -> None:
    found = mistakes(tmp_path, "  - power: off\n  - acquire: {count: 10, every: 1 s}\n", VIRTUAL)
    assert "'power': this bench has no power supply. Add one to the bench file ('supply:')" in found
    assert found.count("\n") == 0


def test_a_dut_with_power_of_its_own_is_not_switched(tmp_path: Path) -> None:
    bench = yaml.safe_load(METRICS.read_text(encoding="utf-8"))
    bench["supply"]["powers"] = ["NAV-1"]
    path = write(tmp_path, "b.yaml", yaml.safe_dump(bench, sort_keys=False))
    found = mistakes(tmp_path, "  - power: {to: off, duts: [NAV-1, HIGH-1]}\n", path)
    assert "the supply does not feed HIGH-1; it feeds NAV-1 (the bench file's 'powers')" in found
    slope = "  - power: off\n  - soak: {for: 1 h, until: {slope: 1 degC/h}, timeout: 2 h}\n"
    assert check(write(tmp_path, "p.yaml", f"procedure: p\nsteps:\n{slope}"), path).plan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"powers": ["NAV-3"]}, "there is no DUT 'NAV-3'"),
        ({"powers": []}, "'powers': must not be empty"),
        ({"safe": {"action": "cut"}}, "'action': 'cut' is not allowed"),
        ({"driver": "scpi"}, "unknown driver 'scpi' for a power supply. Allowed: scpi_supply."),
        ({"settings": {"voltage": "0 V"}}, "voltage: 0 V; it must be above 0, like 28 V"),
    ],
)
def test_mistakes_in_the_bench_file(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    bench = yaml.safe_load(METRICS.read_text(encoding="utf-8"))
    bench["supply"] |= change
    loaded, problems = load_bench(write(tmp_path, "b.yaml", yaml.safe_dump(bench, sort_keys=False)))
    assert loaded is None and [message in str(problem) for problem in problems] == [True], problems


def test_the_settings_keep_to_the_limits(tmp_path: Path) -> None:
    text = METRICS.read_text(encoding="utf-8").replace("voltage: 28 V", "voltage: 40 V")
    found = mistakes(tmp_path, "  - dwell: 1 s\n", write(tmp_path, "b.yaml", text))
    assert "'voltage': 40 V is above the limit of the supply, 32 V." in found and "b.yaml:" in found


def test_a_supply_beyond_the_simulated_ones_is_rehearsed(tmp_path: Path) -> None:
    text = METRICS.read_text(encoding="utf-8").replace("settings: {voltage: 28 V, current_limit: 2 A}", "settings: {}")
    for settings in ("{voltage: 5 V, current_limit: 100 mA}", "{voltage: 270 V, current_limit: 20 A}"):
        entry = text.replace("settings: {}", f"settings: {settings}").replace(
            "limits: {voltage: 32 V, current: 3 A}", ""
        )
        assert run_campaign(tmp_path, settings[10], SHORT, write(tmp_path, "b.yaml", entry)).outcome == "PASS"


def test_of_a_plan_with_gaps_each_temperature_has_the_power_it_had(tmp_path: Path) -> None:
    text = """\
procedure: p
steps:
  - power: off
  - sweep:
      temperature: [10 degC, 20 degC, 30 degC]
      steps:
        - power: on
        - acquire: {count: 10, every: 1 s}
        - power: off
"""
    plan = check(write(tmp_path, "p.yaml", text), METRICS).plan
    kept = [(step.verb, step.temperature_degc, step.off) for step in steps_for(plan, Missing({3: ["NAV-1"]}))]
    before = [("power", 20.0, True), ("set_temperature", 30.0, True)]
    assert kept == [*before, ("power", 30.0, False), ("acquire", 30.0, False)]


@pytest.mark.parametrize(("action", "commanded"), [("keep", False), ("off", True)])
def test_who_makes_the_bench_safe_later_opens_a_supply_only_to_switch_it_off(
    tmp_path: Path, action: str, commanded: bool
) -> None:
    text = METRICS.read_text(encoding="utf-8").replace("current: 3 A}", f"current: 3 A}}\n  safe: {{action: {action}}}")
    bench, _ = load_bench(write(tmp_path, "b.yaml", text))
    assert bench is not None and bench.supply is not None
    spec = InstrumentSpec(bench.supply.driver, bench.supply.address, bench.supply.settings_mapping)
    with World(WorldSpec(1, supply=spec)) as world:
        clock = VirtualClock(world.env)
        station, failures = open_commanded(bench, clock, {"power supply": "fogbench,simulated power supply,0,1.0"})
        assert len(failures) == 2  # neither table nor chamber is there
        assert (station.supply is not None) == commanded
        engine = Engine({}, bench, station, clock, MemoryLog(), RehearsedAcquirer())
        assert make_safe(engine) == [] and world.supply.on != commanded
        station.close()
