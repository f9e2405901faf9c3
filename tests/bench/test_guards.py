"""Guards on the virtual bench: what trips them, and what each action leaves behind."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from bench.conclude import RunEnd
from bench.errors import InvalidFiles
from bench.guards import BUILT_IN, guards_of
from bench.journal import load_journal
from bench.procedure.conditions import Guard
from simulated_hw.wire.serial_frames import SimulatedSerialGyro
from simulated_hw.wire.watlow_f4 import SimulatedWatlowF4
from tests.bench.campaigns import run_campaign, virtual_bench, write

# 2 temperatures x 3 rates; soaks far too short for a lab.
PROCEDURE = """\
procedure: guarded
raw: none
quality: {slope: 5 degC/min}
steps:
  - set_rate: 0 deg/s
  - sweep:
      temperature: [0 degC, 10 degC]
      steps:
        - soak: 10 min
        - sweep:
            rate: [-150 deg/s, 50 deg/s, 150 deg/s]
            steps:
              - settle: {band: 0.02 deg/s, for: 1 s, timeout: 30 s}
              - acquire: {count: 20, every: 0.5 s}
  - set_rate: 0 deg/s
"""
POINTS = list(range(1, 7))
DOOR = "{name: door, watch: chamber_door, action: hold, clear_for: 5 min}"
ALIVE = "{name: alive, watch: dut_temperature, inside: {from: -60 degC, to: 90 degC}, action: drop}"
GOOD = "{name: good, watch: sample_quality, lost: 1 %, over: 1 min, action: drop}"


pytestmark = pytest.mark.usefixtures("unrehearsed")


def faulty(
    folder: Path, guards: list[str], *faults: dict[str, Any], settings: dict[str, Any] | None = None, more: str = ""
) -> RunEnd:
    """A run with guards, on a bench with slow gyros and faults.

    The door's switch raises alarm 2 unless the settings say otherwise. The first soak is from 633 to 1233 s, then
    points are measured until 1274 s; the second one is from 1680 to 2280 s, then points until 2322 s.
    """
    folder = folder / f"{len(list(folder.iterdir()))}"
    folder.mkdir()
    path = virtual_bench(folder, seed=1, faults=list(faults))
    bench = yaml.safe_load(path.read_text())
    for dut in bench["duts"].values():
        dut["settings"]["data_rate"] = "20 Hz"
    bench["chamber"]["settings"] = {"door_register": 106} if settings is None else settings
    write(folder, "bench.yaml", yaml.safe_dump(bench, sort_keys=False))
    lines = more + "".join(["guards:\n", *(f"  - {guard}\n" for guard in guards)] if guards else [])
    return run_campaign(folder, "g", PROCEDURE.replace("steps:\n", f"{lines}steps:\n", 1), path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> RunEnd:
    """A run without faults."""
    end = faulty(tmp_path_factory.mktemp("whole"), [GOOD, DOOR])
    assert end.outcome == "PASS", end.message
    return end


def door(at: str, for_: str) -> dict[str, Any]:
    return {"name": "door_open", "on": "chamber", "leak": 50, "at": at, "for": for_}


def events(end: RunEnd, *kinds: str) -> list[dict[str, Any]]:
    return [event for event in end.manifest["events"] if event["kind"] in kinds]


def points_of(end: RunEnd, dut: str = "FOG-A01") -> pd.DataFrame:
    points = pd.read_csv(end.folder / "points.csv", keep_default_na=False)
    return points[points["dut"] == dut].reset_index(drop=True)


def soaks_again(end: RunEnd) -> int:
    entries = load_journal(end.folder / "journal.jsonl")
    return sum(entry["kind"] == "step" and entry["verb"] == "soak" and bool(entry.get("again")) for entry in entries)


def next_point_s(end: RunEnd) -> float:
    """How long after the hold the next point was begun."""
    (clear,) = events(end, "clear")
    return float((points_of(end)["started_at_s"] - clear["t_s"]).loc[lambda waited: waited >= 0.0].min())


def kinds(end: RunEnd) -> list[str]:
    return [entry["kind"] for entry in load_journal(end.folder / "journal.jsonl")]


@pytest.fixture
def mute(monkeypatch: pytest.MonkeyPatch) -> Callable[[float, float], None]:
    """Makes the serial gyro silent between two instants of bench time."""

    def arrange(begin_s: float, end_s: float) -> None:
        whole = SimulatedSerialGyro.bytes_until

        def bytes_until(self: Any, now_s: float) -> bytes:
            if begin_s < now_s < end_s:
                self.skip_until(now_s)
                return b""
            return whole(self, now_s)

        monkeypatch.setattr(SimulatedSerialGyro, "bytes_until", bytes_until)

    return arrange


def test_an_abort_names_guard_reading_and_place_and_ends_safe(tmp_path: Path) -> None:
    end = faulty(tmp_path, ["{name: fast, watch: rate, max_rate: 120 deg/s}"])
    assert end.outcome == "ERROR"
    assert "guard 'fast': the table turns at -150" in end.message and "allowed are ± 120" in end.message
    assert "'acquire' (" in end.message
    assert kinds(end).count("safe") == 2 and "guard" in kinds(end)


def test_a_hold_waits_until_it_is_clear_and_loses_no_point(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1200.0, 2100.0)
    end = faulty(tmp_path, [ALIVE.replace("drop", "hold, clear_for: 2 min")])
    assert end.outcome == "PASS", end.message
    for dut in ("FOG-A01", "FOG-B01"):
        assert list(points_of(end, dut)["point"]) == POINTS and (points_of(end, dut)["frames"] == 200).all()
    guard, held, clear = events(end, "guard", "held", "clear")
    assert (guard["kind"], held["kind"], clear["kind"]) == ("guard", "held", "clear")
    assert "FOG-A01: nothing valid was received" in guard["text"]
    assert clear["t_s"] > 2100.0 + 120.0


def test_a_hold_that_never_clears_ends_the_run(tmp_path: Path) -> None:
    guard = "{name: cool, watch: dut_temperature, inside: {from: -60 degC, to: 22 degC}, action: hold, timeout: 30 min}"
    end = faulty(tmp_path, [guard])
    assert end.outcome == "ERROR" and "held for 30 min and not clear" in end.message


def test_a_dropped_dut_does_not_stop_the_others(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1800.0, 1e9)
    end = faulty(tmp_path, [ALIVE])
    assert end.outcome == "FAIL" and "points were not measured" in end.message
    assert list(points_of(end, "FOG-B01")["point"]) == POINTS
    assert list(points_of(end)["point"]) == POINTS[:3]
    (dropped,) = events(end, "dropped")
    assert "FOG-A01" in dropped["text"]


def test_the_chambers_own_alarm_ends_the_run_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.chambers.watlow_f4 import WatlowF4

    asked: list[int] = []

    def alarm(self: WatlowF4) -> str | None:
        asked.append(1)
        return "alarm 1 high" if len(asked) > 60 else None

    monkeypatch.setattr(WatlowF4, "alarm", alarm)
    end = faulty(tmp_path, [])
    assert end.outcome == "ERROR" and "guard 'chamber_alarm': the chamber reports alarm 1 high" in end.message


def test_a_guard_of_the_same_name_replaces_the_built_in() -> None:
    held = Guard.model_validate({"name": "table_fault", "watch": "table_fault", "action": "hold"})
    assert [guard.name for guard in guards_of([], [])] == [guard.name for guard in BUILT_IN]
    assert next(g for g in guards_of([], [held]) if g.name == "table_fault").action == "hold"


@pytest.mark.parametrize(
    ("guard", "words"),
    [
        ("{name: a, watch: rate}", "max_rate"),
        ("{name: a, watch: chamber_temperature}", "inside"),
        ("{name: a, watch: chamber_alarm, inside: {from: 0 degC, to: 1 degC}}", "inside"),
        (
            "{name: a, watch: rate, max_rate: 1 deg/s, action: drop}",
            "only a guard on dut_temperature or sample_quality can drop",
        ),
        ("{name: a, watch: speed}", "'speed' is not allowed"),
        ("{name: a, watch: sample_quality}", "has 'lost'"),
        ("{name: a, watch: chamber_door, lost: 1 %}", "has 'lost'"),
        ("{name: a, watch: chamber_door, over: 1 min}", "'over' belongs to a guard on sample_quality"),
        ("{name: a, watch: chamber_door, action: drop}", "only a guard on dut_temperature or sample_quality can drop"),
    ],
)
def test_guards_that_make_no_sense_are_refused(tmp_path: Path, guard: str, words: str) -> None:
    with pytest.raises(InvalidFiles) as mistakes:
        faulty(tmp_path, [guard])
    assert words in str(mistakes.value) and ".yaml:5:" in str(mistakes.value)


def test_a_failed_point_is_measured_again_before_the_temperature_is_left(
    tmp_path: Path, mute: Callable[..., None]
) -> None:
    mute(1250.0, 1259.0)  # in the acquisition of the second point
    end = faulty(tmp_path, [])
    assert end.outcome == "PASS", end.message
    assert list(points_of(end)["point"]) == list(points_of(end, "FOG-B01")["point"]) == POINTS
    (warning,) = events(end, "warning")
    assert "point 2 is measured again: FOG-A01" in warning["text"]


def test_a_dut_that_stays_bad_costs_one_repeat_not_one_per_point(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1250.0, 1e9)
    end = faulty(tmp_path, [])
    assert end.outcome == "FAIL" and len(events(end, "warning")) == 1
    bad = points_of(end).query("verdict == 'fail'")
    assert list(bad["point"]) == [2, 3] and set(bad["reasons"]) == {"no samples"}
    assert list(points_of(end, "FOG-B01")["point"]) == POINTS
    assert (points_of(end, "FOG-B01")["verdict"] == "pass").all()


def test_an_open_door_holds_the_run_and_costs_a_new_soak_and_no_point(tmp_path: Path) -> None:
    """In the middle of the acquisitions at the first temperature, for long enough to warm the DUTs by kelvins."""
    end = faulty(tmp_path, [DOOR], door("1250 s", "20 min"))
    assert end.outcome == "PASS", end.message
    guard, _, clear = events(end, "guard", "held", "clear")
    assert [event["kind"] for event in events(end, "guard", "held", "clear")] == ["guard", "held", "clear"]
    assert guard["text"] == "guard 'door': the chamber's door is open"
    assert 1250.0 <= guard["t_s"] <= 1281.0 and 2450.0 + 300.0 <= clear["t_s"] <= 2450.0 + 361.0
    assert soaks_again(end) == 1 and 600.0 < next_point_s(end) < 1500.0
    assert list(points_of(end)["point"]) == POINTS
    assert points_of(end).query("1 < point < 4")["chamber_readback_degc"].abs().max() < 0.2


def test_a_door_that_was_open_for_a_moment_costs_no_new_soak(tmp_path: Path) -> None:
    """A DUT counts as having stayed as warm within the band of the procedure's resume policy."""
    end = faulty(tmp_path, [DOOR], {**door("1245 s", "10 s"), "leak": 1}, more="resume: {band: 5 K}\n")
    assert end.outcome == "PASS", end.message
    assert soaks_again(end) == 0 and next_point_s(end) < 120.0


@pytest.mark.parametrize(("band", "shorter"), [("5 K", True), ("0.01 K", False)])
def test_a_soak_that_was_held_goes_on_if_the_duts_stayed_as_warm(tmp_path: Path, band: str, shorter: bool) -> None:
    """The door opens after eight of the ten minutes of a soak."""
    short = {**door("2150 s", "32 s"), "leak": 1}
    end = faulty(tmp_path, [DOOR.replace("5 min", "1 min")], short, more=f"resume: {{band: {band}}}\n")
    assert end.outcome == "PASS", end.message
    steps = [e for e in load_journal(end.folder / "journal.jsonl") if e["kind"] == "step"]
    (clear,) = events(end, "clear")
    soak, after = next(pair for pair in pairwise(steps) if pair[0]["t_s"] > clear["t_s"] and pair[0]["verb"] == "soak")
    assert after["t_s"] - soak["t_s"] == pytest.approx(130.0 if shorter else 600.0, abs=40.0)


def test_a_door_whose_register_does_not_answer_has_tripped_before_the_first_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A register that the simulated controller has not, because nothing was wired to it."""
    monkeypatch.setattr(SimulatedWatlowF4, "_wire_door", lambda *_: None)
    end = faulty(tmp_path, ["{name: door, watch: chamber_door}"], settings={"door_register": 4711})
    assert end.outcome == "ERROR" and "no signal" in end.message and "g.yaml:7:" in end.message
    assert [e["verb"] for e in load_journal(end.folder / "journal.jsonl") if e["kind"] == "step"] == ["set_rate"]


def test_a_frozen_gyro_is_dropped_while_waiting_and_the_others_wait_no_longer_for_it(
    tmp_path: Path, whole: RunEnd
) -> None:
    end = faulty(tmp_path, [GOOD, DOOR], {"name": "frozen", "on": "FOG-A01", "at": "1750 s"})
    (dropped,) = events(end, "dropped")
    assert "FOG-A01: the output has not changed for" in dropped["text"] and dropped["t_s"] < 1750.0 + 60.0 + 31.0
    assert events(end, "held") == [] and soaks_again(end) == 0
    # the soak under way goes on, no point is measured twice
    times_s = [points_of(one, "FOG-B01")["started_at_s"] for one in (end, whole)]
    assert len(times_s[0]) == len(POINTS) and (times_s[0] - times_s[1]).abs().max() < 1.0
    assert list(points_of(end)["point"]) == POINTS[:3] and (points_of(end)["verdict"] == "pass").all()
    assert not events(end, "warning")


def test_a_gyro_on_a_bad_line_is_dropped_and_the_losses_are_told(tmp_path: Path) -> None:
    end = faulty(tmp_path, [GOOD], {"name": "loss", "on": "FOG-B01", "probability": 0.05, "at": "20 min"})
    (dropped,) = events(end, "dropped")
    assert (
        "FOG-B01" in dropped["text"] and "ppm of its frames were lost or invalid, allowed are 10000" in dropped["text"]
    )
    assert end.outcome == "FAIL" and list(points_of(end)["point"]) == POINTS


def test_a_hold_waits_until_the_line_is_good_again(tmp_path: Path) -> None:
    noisy = {"name": "bit_error", "on": "FOG-A01", "probability": 1e-3, "at": "30 min", "for": "10 min"}
    end = faulty(tmp_path, [GOOD.replace("drop", "hold")], noisy)
    assert end.outcome == "PASS", end.message
    assert events(end, "clear")[0]["t_s"] >= 2400.0 + 60.0
    assert list(points_of(end)["point"]) == POINTS


@pytest.mark.parametrize("first_s", [1790.0, 1810.0])
def test_a_door_and_a_dead_gyro_at_once(tmp_path: Path, mute: Callable[..., None], first_s: float) -> None:
    """The one is dropped, then the other is waited for; whichever trips first."""
    mute(first_s, 1e9)
    end = faulty(tmp_path, [DOOR, ALIVE], door("30 min", "20 min"))
    assert len(events(end, "dropped")) == len(events(end, "clear")) == 1
    assert end.outcome == "FAIL" and "points were not measured" in end.message
    assert list(points_of(end, "FOG-B01")["point"]) == POINTS
    assert (points_of(end, "FOG-B01")["verdict"] == "pass").all()
    assert list(points_of(end)["point"]) == POINTS[:3]


def test_two_guards_on_one_gyro_drop_it_once(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1800.0, 1e9)
    end = faulty(tmp_path, [ALIVE, GOOD])
    (dropped,) = events(end, "dropped")
    assert "guard 'alive'" in dropped["text"] and "guard 'good'" in dropped["text"]


def test_all_guards_at_once_abort(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1790.0, 1e9)
    alarm = {"name": "alarm", "on": "chamber", "at": "30 min"}
    end = faulty(tmp_path, [DOOR, ALIVE], alarm, door("30 min", "20 min"))
    assert end.outcome == "ERROR" and "guard 'chamber_alarm': the chamber reports alarm 1 high" in end.message
    assert kinds(end).count("safe") == 2


def test_an_alarm_while_held_aborts_at_once(tmp_path: Path) -> None:
    alarm = {"name": "alarm", "on": "chamber", "at": "40 min"}
    end = faulty(tmp_path, [DOOR], alarm, door("30 min", "20 min"))
    assert end.outcome == "ERROR" and "held by guard 'door': guard 'chamber_alarm'" in end.message
    assert 2400.0 <= load_journal(end.folder / "journal.jsonl")[-1]["t_s"] < 2500.0


def test_two_holds_end_when_both_are_clear_for_the_longer_time(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(2100.0, 3600.0)
    patient = ALIVE.replace("drop", "hold, clear_for: 15 min")
    end = faulty(tmp_path, [DOOR, patient], door("30 min", "20 min"))
    assert end.outcome == "PASS", end.message
    (clear,) = events(end, "clear")
    assert clear["t_s"] >= 3600.0 + 900.0


def test_every_guard_has_its_own_patience(tmp_path: Path) -> None:
    """The door is open for longer than its guard waits; the other guard of the hold would have waited for longer."""
    end = faulty(tmp_path, [DOOR.replace("hold", "hold, timeout: 10 min")], door("30 min", "2 h"))
    assert end.outcome == "ERROR" and "held for 10 min and not clear: guard 'door'" in end.message


def test_guards_are_checked_while_the_table_does_not_settle(tmp_path: Path, whole: RunEnd) -> None:
    """A settle of a stuck table takes its 30 s; the door opens meanwhile."""
    guards = [GOOD, "{name: door, watch: chamber_door}"]
    began_s = points_of(whole)["ended_at_s"].iloc[0]
    stuck = {"name": "stuck", "on": "rate_table", "at": f"{began_s + 0.05} s", "for": "2 min"}
    end = faulty(tmp_path, guards, stuck)
    assert end.outcome == "ERROR" and "did not stay within" in end.message
    end = faulty(tmp_path, guards, stuck, door(f"{began_s + 8.0} s", "2 min"))
    assert end.outcome == "ERROR" and "'settle'" in end.message and "the chamber's door is open" in end.message
    (tripped,) = events(end, "guard")
    assert tripped["t_s"] < began_s + 8.0 + 6.0


def test_every_guard_is_installed_with_a_signal(tmp_path: Path) -> None:
    """The first readback comes before the first step is carried out, though nothing waits yet."""
    band = "{name: warm, watch: chamber_temperature, inside: {from: 40 degC, to: 50 degC}}"
    end = faulty(tmp_path, [band])
    assert end.outcome == "ERROR" and "the chamber reads 2" in end.message
    assert load_journal(end.folder / "journal.jsonl")[-1]["t_s"] < 30.0


def test_a_guard_that_lost_its_signal_holds_until_the_link_is_back(tmp_path: Path) -> None:
    lost = {"name": "no_reply", "on": "chamber", "at": "1250 s", "for": "4 min"}
    guard = (
        "{name: cold, watch: chamber_temperature, inside: {from: -20 degC, to: 40 degC}, lost_after: 1 min, action: %s}"
    )
    end = faulty(tmp_path, [guard % "hold"], lost)
    assert end.outcome == "PASS", end.message
    assert list(points_of(end)["point"]) == POINTS
    end = faulty(tmp_path, [guard % "abort"], lost)
    assert end.outcome == "ERROR" and "guard 'cold': no signal for" in end.message


def test_an_abort_while_the_chamber_is_looked_for_ends_safe_if_it_answers_in_time(tmp_path: Path) -> None:
    """The guard gives up after a minute or two without a signal; the link is back within the chamber's 30 s."""
    guard = "{name: cold, watch: chamber_temperature, inside: {from: -20 degC, to: 40 degC}, lost_after: 1 min}"
    end = faulty(tmp_path, [guard], {"name": "no_reply", "on": "chamber", "at": "1250 s"})
    tripped = events(end, "guard")[0]["t_s"]
    assert any("NOT SAFE: chamber" in event["text"] for event in events(end, "safe"))
    back = {"name": "no_reply", "on": "chamber", "at": "1250 s", "for": f"{tripped + 10.0 - 1250.0} s"}
    end = faulty(tmp_path, [guard], back)
    assert end.outcome == "ERROR" and "guard 'cold': no signal for" in end.message
    assert events(end, "guard")[0]["t_s"] == tripped
    safe = [event["text"] for event in events(end, "safe")]
    assert len(safe) == 2 and any(text.startswith("chamber: setpoint 25 degC (go_to)") for text in safe), safe
