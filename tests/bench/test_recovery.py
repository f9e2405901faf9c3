"""Trouble while a run that is taken up again is brought back to where it was: seen to as in a step, never the end."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench.conclude import RunEnd
from bench.journal import load_journal
from bench.overrides import parse_overrides
from bench.resume import prepare_resume
from bench.run import RunRequest, prepare, run
from drivers.errors import NoReply
from drivers.rate_tables.acutronic_acl import AcutronicAcl
from tests.bench.campaigns import virtual_bench, write
from tests.bench.test_guards import DOOR, POINTS, PROCEDURE

SLOW = tuple(
    parse_overrides(
        [
            "bench.duts.FOG-A01.settings.data_rate=20 Hz",
            "bench.duts.FOG-B01.settings.data_rate=20 Hz",
            "bench.chamber.settings={door_register: 106}",
        ]
    )
)


def stopped(folder: Path, procedure: str, *faults: dict[str, Any]) -> Path:
    """The folder of a run that was aborted after its second point, at 1261 s; its bench begins anew at 23 degC."""
    stops: list[Any] = []

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.point == 2:
            stops[0].ask()

    bench = virtual_bench(folder, seed=1, faults=list(faults))
    request = RunRequest(write(folder, "r.yaml", procedure), bench, folder / "results", "r", 1, SLOW)
    end = run(prepare(request), listen, stops.append)
    assert end.outcome == "ABORTED", end.message
    return end.folder


def entries_of(end: RunEnd) -> list[dict[str, Any]]:
    """What the journal holds of the second attempt."""
    entries = load_journal(end.folder / "journal.jsonl")
    return entries[next(number for number, entry in enumerate(entries) if entry["kind"] == "resumed") :]


def measured(end: RunEnd) -> dict[str, list[int]]:
    points = pd.read_csv(end.folder / "points.csv")
    return {str(dut): rows["point"].tolist() for dut, rows in points.groupby("dut")}


def test_a_link_that_breaks_on_the_way_back_is_waited_for(tmp_path: Path) -> None:
    lost = {"name": "no_reply", "on": "chamber", "at": "1400 s", "for": "1 min"}
    end = run(prepare_resume(stopped(tmp_path, PROCEDURE, lost)))
    assert end.outcome == "PASS", end.message
    assert measured(end) == {"FOG-A01": POINTS, "FOG-B01": POINTS}
    entries = entries_of(end)
    states = [(entry["state"], entry["t_s"]) for entry in entries if entry["kind"] == "link"]
    assert [state for state, _ in states] == ["lost", "restored"]
    again = [entry["verb"] for entry in entries if entry.get("again")]
    # The bench had cooled down: after the second move, a whole soak.
    assert again == ["set_temperature", "set_temperature", "soak", "set_rate"]
    assert not any(entry["text"].startswith("NOT SAFE") for entry in entries if entry["kind"] == "safe")


def test_a_guard_that_trips_on_the_way_back_holds(tmp_path: Path) -> None:
    procedure = PROCEDURE.replace("steps:\n", f"guards:\n  - {DOOR}\nsteps:\n", 1)
    opened = {"name": "door_open", "on": "chamber", "leak": 50, "at": "1400 s", "for": "10 min"}
    end = run(prepare_resume(stopped(tmp_path, procedure, opened)))
    assert end.outcome == "PASS", end.message
    assert measured(end) == {"FOG-A01": POINTS, "FOG-B01": POINTS}
    entries = entries_of(end)
    guard, held, clear = [entry for entry in entries if entry["kind"] in ("guard", "held", "clear")]
    assert (guard["kind"], held["kind"], clear["kind"]) == ("guard", "held", "clear")
    assert 1400.0 <= guard["t_s"] < 1440.0 and clear["t_s"] >= 2000.0 + 300.0


def test_a_table_that_does_not_answer_when_it_is_energised_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = stopped(tmp_path, PROCEDURE)
    energise, asked = AcutronicAcl.energise, []

    def deaf_once(self: AcutronicAcl) -> None:
        asked.append(True)
        if len(asked) == 2:  # the first is the rehearsal's
            raise NoReply("rate table", ":Interlock:Close", 1.0, 3)
        energise(self)

    monkeypatch.setattr(AcutronicAcl, "energise", deaf_once)
    end = run(prepare_resume(folder))
    assert end.outcome == "PASS" and len(asked) == 3, end.message
    assert any(":Interlock:Close" in entry["text"] for entry in entries_of(end) if entry["kind"] == "warning")


def test_a_guard_that_the_step_itself_trips_is_given_up(tmp_path: Path) -> None:
    """At rest all is clear, and brought back to its rate the table trips it again."""
    fast = "{name: fast, watch: rate, max_rate: 120 deg/s, action: hold}"
    procedure = PROCEDURE.replace("steps:\n", f"guards:\n  - {fast}\nsteps:\n", 1)
    bench = virtual_bench(tmp_path, seed=1)
    end = run(prepare(RunRequest(write(tmp_path, "r.yaml", procedure), bench, tmp_path / "results", "r", 1, SLOW)))
    assert end.outcome == "ERROR" and "guard 'fast'" in end.message and "held 10 times" in end.message
