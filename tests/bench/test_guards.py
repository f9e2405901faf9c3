"""Guards on the virtual bench: what trips them, and what each action leaves behind."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench.conclude import RunEnd
from bench.errors import InvalidFiles
from bench.guards import BUILT_IN, guards_of
from bench.journal import load_journal
from bench.procedure.language import Guard
from simulated_hw.wire.serial_frames import SimulatedSerialGyro
from tests.bench.campaigns import GRID, run_campaign


def guarded(tmp_path: Path, guard: str, procedure: str = GRID) -> RunEnd:
    return run_campaign(tmp_path, "g", procedure.replace("steps:\n", f"guards:\n  - {guard}\nsteps:\n", 1))


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
    end = guarded(tmp_path, "{name: fast, watch: rate, max_rate: 120 deg/s}")
    assert end.outcome == "ERROR"
    assert "guard 'fast': the table turns at -150" in end.message and "allowed are ± 120" in end.message
    assert "'acquire' (" in end.message
    assert kinds(end).count("safe") == 2 and "guard" in kinds(end)


def test_a_hold_waits_until_it_is_clear_and_loses_no_point(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1200.0, 2100.0)
    guard = (
        "{name: alive, watch: dut_temperature, inside: {from: -60 degC, to: 90 degC}, action: hold, clear_for: 2 min}"
    )
    end = guarded(tmp_path, guard)
    points = pd.read_csv(end.folder / "points.csv")
    assert end.outcome == "PASS", end.message
    assert list(points["point"]) == [n for n in range(1, 29) for _ in range(2)]
    assert (points["frames"] == 1000).all()
    events = [event for event in end.manifest["events"] if event["kind"] in ("guard", "held", "clear")]
    assert [event["kind"] for event in events] == ["guard", "held", "clear"]
    assert "FOG-A01: nothing valid was received" in events[0]["text"]
    assert events[2]["t_s"] > 2100.0 + 120.0


def test_a_hold_that_never_clears_ends_the_run(tmp_path: Path) -> None:
    guard = "{name: cool, watch: dut_temperature, inside: {from: -60 degC, to: 22 degC}, action: hold, timeout: 30 min}"
    end = guarded(tmp_path, guard)
    assert end.outcome == "ERROR" and "held for 30 min and not clear" in end.message


def test_a_dropped_dut_does_not_stop_the_others(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(3000.0, 1e9)
    end = guarded(
        tmp_path, "{name: alive, watch: dut_temperature, inside: {from: -60 degC, to: 90 degC}, action: drop}"
    )
    points = pd.read_csv(end.folder / "points.csv")
    assert end.outcome == "FAIL" and "points were not measured" in end.message
    assert (points["dut"] == "FOG-B01").sum() == 28
    lost = points[points["dut"] == "FOG-A01"]
    assert 0 < len(lost) < 28
    dropped = next(event for event in end.manifest["events"] if event["kind"] == "dropped")
    assert "FOG-A01" in dropped["text"]


def test_the_chambers_own_alarm_ends_the_run_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.chambers.watlow_f4 import WatlowF4

    asked: list[int] = []

    def alarm(self: WatlowF4) -> str | None:
        asked.append(1)
        return "alarm 1 high" if len(asked) > 60 else None

    monkeypatch.setattr(WatlowF4, "alarm", alarm)
    end = run_campaign(tmp_path, "alarm")
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
        ("{name: a, watch: rate, max_rate: 1 deg/s, action: drop}", "only a guard on dut_temperature can drop"),
        ("{name: a, watch: speed}", "'speed' is not allowed"),
    ],
)
def test_guards_that_make_no_sense_are_refused(tmp_path: Path, guard: str, words: str) -> None:
    with pytest.raises(InvalidFiles) as mistakes:
        guarded(tmp_path, guard)
    assert words in str(mistakes.value) and ".yaml:5:" in str(mistakes.value)


def test_a_failed_point_is_measured_again_before_the_temperature_is_left(
    tmp_path: Path, mute: Callable[..., None]
) -> None:
    mute(1260.0, 1275.0)  # in the middle of the acquisitions at the first temperature
    end = run_campaign(tmp_path, "again")
    points = pd.read_csv(end.folder / "points.csv")
    assert end.outcome == "PASS", end.message
    assert list(points["point"]) == [n for n in range(1, 29) for _ in range(2)]
    warnings = [event["text"] for event in end.manifest["events"] if event["kind"] == "warning"]
    assert warnings and "is measured again: FOG-A01" in warnings[0]


def test_a_dut_that_stays_bad_costs_one_repeat_not_one_per_point(tmp_path: Path, mute: Callable[..., None]) -> None:
    mute(1260.0, 1e9)
    end = run_campaign(tmp_path, "dead")
    assert end.outcome == "FAIL"
    warnings = [event["text"] for event in end.manifest["events"] if event["kind"] == "warning"]
    assert len(warnings) == 1
    points = pd.read_csv(end.folder / "points.csv")
    assert set(points.query("dut == 'FOG-A01' and verdict == 'fail'")["reasons"]) <= {"no samples", *points["reasons"]}
    assert (points.query("dut == 'FOG-B01'")["verdict"] == "pass").all()
