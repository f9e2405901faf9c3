"""Campaigns on a bad line: every loss is counted exactly as the simulators' truth log has it."""

from pathlib import Path

import pandas as pd
import pytest

from bench.conclude import RunEnd
from tests.bench.campaigns import GRID, run_campaign, virtual_bench
from tests.bench.faulty import COUNTED, DUTS, SHORT, Session, broken, faults_of, points_of, session_of, sessions_of

WIRE = {
    "loss": {"probability": 5e-4},
    "burst_loss": {"enter": 1e-4, "mean_frames": 10},
    "bit_error": {"probability": 2e-6},
    "duplicate": {"probability": 5e-4},
    "sync_slip": {"probability": 5e-4},
}
ALL_ON = [{"name": name, "on": "FOG-A01", **about} for name, about in WIRE.items()] + [
    {"name": name, "on": "FOG-B01", **WIRE[name]} for name in ("loss", "burst_loss", "duplicate")
]
TOLERANT = GRID.replace("quality: {slope: 5 degC/min}", "quality: {slope: 5 degC/min, lost: 10 %}")
# Frames until the counter begins again: 7 bits of the serial frame, 8 of the CAN message.
PERIOD = {"FOG-A01": 128, "FOG-B01": 256}


def noisy_campaign(folder: Path) -> RunEnd:
    duts = {"FOG-A01": {"class": "ts_a"}, "FOG-B01": {"class": "ts_b"}}
    return run_campaign(folder, "noisy", TOLERANT, virtual_bench(folder, seed=3, duts=duts, faults=ALL_ON))


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> RunEnd:
    return noisy_campaign(tmp_path_factory.mktemp("noisy"))


@pytest.mark.parametrize("dut", DUTS)
def test_every_loss_of_every_point_is_counted_as_the_truth_has_it(noisy: RunEnd, dut: str) -> None:
    points, sessions = points_of(noisy, dut), sessions_of(noisy, dut)
    assert len(points) == 28
    for _, row in points.iterrows():
        check_point(row, session_of(row, sessions), planned=1000)
    assert points["frames_lost"].sum() > 20 and points["duplicates"].sum() > 5


def check_point(row: pd.Series, session: Session, planned: int) -> None:
    """A point is made of the first frame received and those that follow it."""
    first = next(number for number in range(session.first, session.end) if number not in session.lost)
    lost = [number for number in session.lost if first <= number < first + planned]
    assert (row["frames_lost"], row["frames"]) == (len(lost), planned - len(lost))
    heard = [record for record in session.records if record["t_s"] <= row["ended_at_s"]]
    for name in COUNTED:
        assert row[name] == sum(record.get(name, 0) for record in heard), (row["point"], name)


@pytest.mark.parametrize("dut", DUTS)
def test_every_loss_of_the_whole_run_is_counted_as_the_truth_has_it(noisy: RunEnd, dut: str) -> None:
    quality = noisy.manifest["data_quality"][dut]
    sessions = sessions_of(noisy, dut)
    assert quality["lost"] == sum(session.countable for session in sessions)
    for name in COUNTED:
        assert quality[name] == sum(session.total(name) for session in sessions), name
    assert quality["lost"] > 100
    expected = set(WIRE) if dut == "FOG-A01" else {"loss", "burst_loss", "duplicate"}
    assert {record["fault"] for session in sessions for record in session.records} == expected


def test_a_noisy_line_alone_changes_no_verdict(noisy: RunEnd) -> None:
    assert noisy.outcome == "PASS", noisy.message


def test_the_same_seed_gives_the_same_faults(noisy: RunEnd, tmp_path: Path) -> None:
    again = noisy_campaign(tmp_path)
    assert (again.folder / "points.csv").read_bytes() == (noisy.folder / "points.csv").read_bytes()
    assert faults_of(again) == faults_of(noisy)


@pytest.fixture(scope="module")
def first_point_s(tmp_path_factory: pytest.TempPathFactory) -> float:
    """When the first point of the short campaign is measured."""
    return float(points_of(broken(tmp_path_factory.mktemp("healthy")))["started_at_s"].iloc[0])


@pytest.mark.parametrize("dut", DUTS)
@pytest.mark.parametrize("for_s", [0.07, 2.0, 3.7])
def test_a_silence_is_so_many_frames(tmp_path: Path, first_point_s: float, dut: str, for_s: float) -> None:
    end = broken(tmp_path, {"name": "silence", "on": dut, "at": f"{first_point_s + 4.0} s", "for": f"{for_s} s"})
    silent = sum(session.total("lost") for session in sessions_of(end, dut))
    assert end.manifest["data_quality"][dut]["lost"] == silent == pytest.approx(100.0 * for_s, abs=1.0)


@pytest.mark.parametrize("dut", DUTS)
@pytest.mark.parametrize("for_s", [2.0, 3.7])
def test_a_power_reset_is_so_many_frames_but_for_whole_periods(
    tmp_path: Path, first_point_s: float, dut: str, for_s: float
) -> None:
    end = broken(tmp_path, {"name": "power_reset", "on": dut, "at": f"{first_point_s + 4.0} s", "for": f"{for_s} s"})
    (reset,) = (session.reset for session in sessions_of(end, dut) if session.reset)
    lost = end.manifest["data_quality"][dut]["lost"]
    # behind frame min - 1 came one with counter 0
    assert (lost + min(reset)) % PERIOD[dut] == 0
    assert abs(lost - len(reset)) < PERIOD[dut] and len(reset) == pytest.approx(100.0 * for_s, abs=1.0)


@pytest.mark.parametrize("dut", DUTS)
def test_spikes_are_counted_as_the_truth_has_them(tmp_path: Path, dut: str) -> None:
    end = broken(tmp_path, {"name": "spike", "on": dut, "probability": 4e-3, "size": "1000 deg/s"})
    points, sessions = points_of(end, dut), sessions_of(end, dut)
    for _, row in points.iterrows():
        session = session_of(row, sessions)
        assert row["spikes"] == sum(number < session.first + 1000 for number in session.numbers("spike"))
    assert points["spikes"].sum() >= 5


@pytest.mark.parametrize("dut", DUTS)
def test_frozen_frames_are_counted_as_the_truth_has_them(tmp_path: Path, first_point_s: float, dut: str) -> None:
    """Behind the first point's acquisition no other follows that would take its place."""
    procedure = "quality: {slope: 5 degC/min, repeats: 0}"
    end = broken(
        tmp_path,
        {"name": "frozen", "on": dut, "at": f"{first_point_s + 4.0} s", "for": "3 s"},
        procedure=SHORT.replace("quality: {slope: 5 degC/min}", procedure),
    )
    (session,) = (session for session in sessions_of(end, dut) if session.numbers("frozen"))
    # the first of them is the one that the others repeat
    assert points_of(end, dut)["frames_held"].tolist() == [len(session.numbers("frozen")) - 1, 0, 0]


@pytest.mark.parametrize("dut", DUTS)
def test_a_late_stream_loses_nothing(tmp_path: Path, first_point_s: float, dut: str) -> None:
    end = broken(tmp_path, {"name": "late", "on": dut, "at": f"{first_point_s + 9.0} s", "for": "1.8 s"})
    assert end.outcome == "PASS" and end.manifest["data_quality"][dut]["lost"] == 0
    assert (points_of(end)["frames_lost"] == 0).all()
