"""When faults come in a campaign: by time, by place, by probability; and what of it is over when a run is resumed."""

from pathlib import Path
from typing import Any

import pytest

from bench.resume import prepare_resume
from bench.run import run
from tests.bench.faulty import (
    DUTS,
    SHORT,
    Record,
    begins,
    broken,
    faults_in,
    faults_of,
    points_of,
    sessions_of,
    truth_folders,
)

# Twice there and back: the table is above 60 deg/s at points 3, 4, 7 and 8.
TWICE = SHORT.replace(
    "rate: {from: 0 deg/s, to: 100 deg/s, step: 50 deg/s}",
    "rate: [0 deg/s, 50 deg/s, 100 deg/s, -100 deg/s, 0 deg/s, 50 deg/s, 100 deg/s, -100 deg/s]",
).replace("slope: 5 degC/min", "slope: 5 degC/min, repeats: 0")


def held(folder: Path, dut: str, **script: Any) -> list[int]:
    """The points at which a DUT's output was frozen."""
    end = broken(folder, {"name": "frozen", "on": dut, **script}, procedure=TWICE)
    points = points_of(end, dut)
    return points[points["frames_held"] > 0]["point"].tolist()


@pytest.mark.parametrize("dut", DUTS)
def test_by_place_as_long_as_it_lasts(tmp_path: Path, dut: str) -> None:
    assert held(tmp_path, dut, when={"table_above": "60 deg/s"}) == [3, 4, 7, 8]


@pytest.mark.parametrize("dut", DUTS)
def test_by_place_and_for_a_time_once(tmp_path: Path, dut: str) -> None:
    assert held(tmp_path, dut, when={"table_above": "60 deg/s"}, **{"for": "10 s"}) == [3]


@pytest.mark.parametrize("dut", DUTS)
def test_by_time_and_by_place_not_before_that_time(tmp_path: Path, dut: str) -> None:
    begin_s = points_of(broken(tmp_path, procedure=TWICE), dut)["started_at_s"].to_numpy()
    about = {"when": {"table_above": "60 deg/s"}, "for": "10 s"}
    assert held(inside(tmp_path, "place"), dut, at=f"{begin_s[4]} s", **about) == [7]
    assert held(inside(tmp_path, "time"), dut, at=f"{begin_s[4]} s", **{"for": "9 s"}) == [5]


@pytest.mark.parametrize("dut", DUTS)
def test_by_probability(tmp_path: Path, dut: str) -> None:
    end = broken(tmp_path, {"name": "loss", "on": dut, "probability": 0.01})
    sessions = sessions_of(end, dut)
    heard, lost = sum(one.end - one.first for one in sessions), sum(len(one.lost) for one in sessions)
    # four standard deviations of a binomial count
    assert abs(lost - 0.01 * heard) < 4.0 * (0.01 * heard) ** 0.5 and lost > 300


def inside(folder: Path, name: str) -> Path:
    (folder / name).mkdir()
    return folder / name


ONCE: list[Record] = [
    {"name": "silence", "on": "FOG-A01", "when": {"table_above": "20 deg/s"}, "for": "2 s"},
    {"name": "spike", "on": "FOG-B01", "probability": 1.0, "when": {"table_above": "20 deg/s"}, "for": "0.5 s"},
    {"name": "no_reply", "on": "chamber", "when": {"table_above": "20 deg/s"}, "for": "3 s"},
    {"name": "e_stop", "on": "rate_table", "when": {"table_above": "20 deg/s"}, "for": "10 s"},
    {"name": "fault", "on": "rate_table", "when": {"table_above": "60 deg/s"}, "for": "10 s"},
]


def test_what_came_once_does_not_come_again_in_a_resumed_run(tmp_path: Path) -> None:
    """Each attempt passes the places of the one before on its way; none gets beyond what stops the table there."""
    end = broken(tmp_path, *ONCE)
    outcomes = [end.outcome]
    while outcomes[-1] == "ERROR" and len(outcomes) < 5:
        outcomes.append(run(prepare_resume(end.folder)).outcome)
    assert outcomes == ["ERROR", "ERROR", "PASS"]
    came = [{name for name, _ in begins(faults_in(folder))} for folder in truth_folders(end.folder)]
    assert came == [{"silence", "spike", "no_reply", "e_stop"}, {"fault"}, set()]


def test_what_lasts_as_long_as_its_place_comes_whenever_the_place_does(tmp_path: Path) -> None:
    end = broken(tmp_path, {"name": "stuck", "on": "rate_table", "when": {"table_above": "60 deg/s"}}, ONCE[3])
    assert end.outcome == "ERROR"
    run(prepare_resume(end.folder))
    came = [[name for name, _ in begins(faults_in(folder))] for folder in truth_folders(end.folder)]
    assert "e_stop" in came[0] and set(came[1]) == {"stuck"}


def test_what_was_never_seen_is_in_the_log_all_the_same(tmp_path: Path) -> None:
    """The gyro's frames of that time were thrown away unread."""
    end = broken(tmp_path, {"name": "spike", "on": "FOG-A01", "when": {"table_above": "1 deg/s"}, "for": "0.01 s"})
    assert [name for name, _ in begins(faults_of(end))] == ["spike"]
