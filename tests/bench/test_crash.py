"""Kill -9 anywhere, resume, lose nothing: a few trials here, the many of `python3 do.py crash` with the campaigns."""

import random
from pathlib import Path

import pytest

from tests import crash_live
from tests.crash import Setting, Tally, kills_of, live_trials, setting_of, trial
from tests.crash_kills import after, at_kind, at_record, kinds
from tests.crash_live import LiveSimulators


def test_a_few_kills_at_records_and_at_random_instants(tmp_path: Path) -> None:
    tally = Tally()
    trial(tmp_path, [at_record(14, torn=True), after(0.05), at_record(3, torn=False), at_record(25, torn=True)], tally)
    assert tally.kills >= 3 and tally.clean, str(tally)


def test_the_kinds_of_records_are_those_that_the_sources_write() -> None:
    known = {"journal", "identities", "forecast", "step", "done", "readback", "point", "safe", "end", "resumed"}
    assert known | {"paused", "continued", "interrupted", "error", "guard", "held", "clear", "dropped"} <= set(kinds())


@pytest.mark.campaign
@pytest.mark.parametrize("kind", kinds())
def test_a_kill_at_every_kind_of_record(tmp_path: Path, kind: str) -> None:
    tally = Tally()
    trial(tmp_path, kills_of(kind, random.Random(kind)), tally, setting_of(kind))
    assert tally.by_kind[kind] == 1 and tally.clean, str(tally)


@pytest.mark.campaign
def test_a_kill_at_every_record_of_a_campaign(tmp_path: Path) -> None:
    tally, number = Tally(), 1
    while True:
        folder = tmp_path / str(number)
        folder.mkdir()
        before = tally.kills
        trial(folder, [at_record(number, torn=False)], tally)
        assert tally.clean, f"killed at record {number}: {tally}"
        if tally.kills == before:
            break  # it ended before it got that far
        number += 1
    assert {"step", "done", "point", "readback", "safe", "note", "identities", "forecast"} <= set(tally.by_kind)


@pytest.mark.wall
def test_a_kill_against_live_simulators_ends_safe(tmp_path: Path) -> None:
    tally = Tally()
    with LiveSimulators(tmp_path) as live:
        setting = Setting(live.bench, crash_live.PROCEDURE, crash_live.POINTS, live.ended_unsafe)
        trial(tmp_path, [at_kind("point", torn=False)], tally, setting)
    assert tally.live_kills == 1 and tally.clean, str(tally)


@pytest.mark.wall
def test_an_end_that_is_not_safe_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same without a guardian: the truth log says that the table goes on turning."""

    class Absent:
        def __init__(self, folder: Path) -> None: ...
        def beat(self) -> None: ...
        def dismiss(self) -> None: ...
        def leave(self) -> None: ...

    monkeypatch.setattr("bench.run.Guardian", Absent)
    tally = Tally()
    with LiveSimulators(tmp_path) as live:
        setting = Setting(live.bench, crash_live.PROCEDURE, crash_live.POINTS, live.ended_unsafe)
        trial(tmp_path, [at_kind("point", torn=False)], tally, setting)
    assert tally.unsafe == 1 and not tally.clean, str(tally)
    assert tally.points_lost == tally.points_twice == tally.unfinished == 0


@pytest.mark.campaign
@pytest.mark.wall
def test_random_kills_against_live_simulators() -> None:
    tally = Tally()
    live_trials(5, random.Random(7), tally)
    assert tally.live_kills >= 5 and tally.clean, str(tally)
