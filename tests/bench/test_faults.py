"""Campaigns on a bench with faults: losses counted exactly as the truth log has them, each fault with its outcome."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench.conclude import RunEnd
from bench.errors import BenchFailure
from bench.journal import read_journal
from bench.verify.verify import verify
from tests.bench.campaigns import GRID, run_campaign, virtual_bench

COUNTED = ("duplicates", "bad_checksum", "skipped_bytes", "resyncs")
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


@dataclass
class Session:
    """What a gyro's reader got to hear between two discards: frames first ... end - 1, and what was done to them."""

    began_s: float
    first: int
    end: int = 0
    records: list[dict[str, Any]] = field(default_factory=list)

    @property
    def lost(self) -> set[int]:
        records = (record for record in self.records if record.get("lost"))
        return {number for record in records for number in range(record["frame"], record["frame"] + record["frames"])}

    @property
    def countable(self) -> int:
        """Frames lost between two that arrived; a counter tells of no others."""
        edges = (*range(self.first, self.first + 999), *range(self.end - 999, self.end))
        arrived = [number for number in edges if self.first <= number < self.end and number not in self.lost]
        return sum(arrived[0] < number < arrived[-1] for number in self.lost) if arrived else 0


def truth_folder(end: RunEnd) -> Path:
    return end.folder.parent / ".truth" / end.folder.name


def faults_of(end: RunEnd) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (truth_folder(end) / "faults.jsonl").read_text().splitlines()]


def sessions_of(end: RunEnd, dut: str) -> list[Session]:
    sessions: list[Session] = []
    for record in faults_of(end):
        if record["instrument"] != dut:
            continue
        if record["fault"] == "discard":
            if sessions:
                sessions[-1].end = record["frame"]
            sessions.append(Session(record["t_s"], record["frame"] + record["frames"]))
        else:
            sessions[-1].records.append(record)
    sessions[-1].end = 10**9
    return sessions


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> RunEnd:
    folder = tmp_path_factory.mktemp("noisy")
    duts = {"FOG-A01": {"class": "ts_a"}, "FOG-B01": {"class": "ts_b"}}
    return run_campaign(folder, "noisy", TOLERANT, virtual_bench(folder, seed=3, duts=duts, faults=ALL_ON))


@pytest.mark.parametrize("dut", ["FOG-A01", "FOG-B01"])
def test_every_loss_of_every_point_is_counted_as_the_truth_has_it(noisy: RunEnd, dut: str) -> None:
    points = pd.read_csv(noisy.folder / "points.csv").query("dut == @dut")
    sessions = sessions_of(noisy, dut)
    assert len(points) == 28
    for _, row in points.iterrows():
        session = [session for session in sessions if session.began_s <= row["started_at_s"] + 1e-6][-1]
        first = next(number for number in range(session.first, session.first + 999) if number not in session.lost)
        lost = [number for number in session.lost if first <= number < first + 1000]
        assert row["frames_lost"] == len(lost)
        assert row["frames"] == 1000 - len(lost)
        heard = [record for record in session.records if record["t_s"] <= row["ended_at_s"]]
        for name in COUNTED:
            assert row[name] == sum(record.get(name, 0) for record in heard), (row["point"], name)
    assert points["frames_lost"].sum() > 20 and points["duplicates"].sum() > 5


@pytest.mark.parametrize("dut", ["FOG-A01", "FOG-B01"])
def test_every_loss_of_the_whole_run_is_counted_as_the_truth_has_it(noisy: RunEnd, dut: str) -> None:
    quality = noisy.manifest["data_quality"][dut]
    sessions = sessions_of(noisy, dut)
    assert quality["lost"] == sum(session.countable for session in sessions)
    records = [record for session in sessions for record in session.records]
    for name in COUNTED:
        assert quality[name] == sum(record.get(name, 0) for record in records), name
    assert quality["lost"] > 100
    expected = set(WIRE) if dut == "FOG-A01" else {"loss", "burst_loss", "duplicate"}
    assert {record["fault"] for record in records} == expected


def test_a_noisy_line_alone_changes_no_verdict(noisy: RunEnd) -> None:
    assert noisy.outcome == "PASS", noisy.message


def test_the_same_seed_gives_the_same_faults(noisy: RunEnd, tmp_path: Path) -> None:
    duts = {"FOG-A01": {"class": "ts_a"}, "FOG-B01": {"class": "ts_b"}}
    again = run_campaign(tmp_path, "noisy", TOLERANT, virtual_bench(tmp_path, seed=3, duts=duts, faults=ALL_ON))
    assert (again.folder / "points.csv").read_bytes() == (noisy.folder / "points.csv").read_bytes()
    assert faults_of(again) == faults_of(noisy)


def broken(folder: Path, *faults: dict[str, Any], procedure: str = SHORT) -> RunEnd:
    return run_campaign(folder, "broken", procedure, virtual_bench(folder, seed=1, faults=list(faults)))


def reasons(end: RunEnd, dut: str = "FOG-A01") -> list[str]:
    points = pd.read_csv(end.folder / "points.csv", keep_default_na=False)
    return points[points["dut"] == dut]["reasons"].tolist()


def safe_events(end: RunEnd) -> list[str]:
    return [event["text"] for event in end.manifest["events"] if event["kind"] == "safe"]


AT_100 = {"when": {"table_above": "60 deg/s"}}


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"name": "fault", **AT_100}, "Fault: drive"),
        ({"name": "e_stop", **AT_100}, "Fault: emergency stop"),
        ({"name": "over_speed", **AT_100}, "Fault: over-speed"),
        ({"name": "stuck", **AT_100}, "did not stay within 100"),
        ({"name": "encoder_error", "rate_offset": "0.5 deg/s", **AT_100}, "did not stay within 100"),
    ],
)
def test_a_table_that_fails_is_an_error_with_its_place(tmp_path: Path, fault: dict[str, Any], said: str) -> None:
    end = broken(tmp_path, {"on": "rate_table", **fault})
    assert end.outcome == "ERROR", end.message
    assert "broken.yaml:10:11" in end.message and said in end.message
    assert len(safe_events(end)) == 2
    assert end.manifest["points_measured"] == 2
    assert fault["name"] in {record["fault"] for record in faults_of(end)}


def test_weak_cooling_is_an_error_with_its_place(tmp_path: Path) -> None:
    end = broken(tmp_path, {"name": "weak_cooling", "on": "chamber"}, procedure=SHORT.replace("to: 20", "to: -30"))
    assert end.outcome == "ERROR" and "broken.yaml:5:5" in end.message and "the chamber reads -1" in end.message


def test_a_broken_sensor_is_an_error_with_its_place(tmp_path: Path) -> None:
    end = broken(tmp_path, {"name": "sensor_break", "on": "chamber", "at": "1 min"})
    # its reading, or the high alarm that it sets off
    assert end.outcome == "ERROR" and "broken.yaml:5:5" in end.message
    assert "800" in end.message or "alarm 1 high" in end.message


def test_an_open_door_shows_in_the_points(tmp_path: Path) -> None:
    """The chamber drifts off its setpoint while the points are measured."""
    cold = SHORT.replace("to: 20", "to: 0").replace("soak: 10 min", "soak: 1 h")
    before = pd.read_csv(broken(folder(tmp_path, "healthy"), procedure=cold).folder / "points.csv")
    begins_s = before["started_at_s"].min() - 300.0
    door = {"name": "door_open", "on": "chamber", "leak": 50, "at": f"{begins_s} s", "for": "20 min"}
    end = broken(folder(tmp_path, "open"), door, procedure=cold)
    after = pd.read_csv(end.folder / "points.csv")
    assert before["chamber_readback_degc"].abs().max() < 0.5 and after["chamber_readback_degc"].min() > 1.5
    assert [record["t_s"] for record in faults_of(end) if record["fault"] == "door_open"] == [pytest.approx(begins_s)]


def folder(inside: Path, name: str) -> Path:
    (inside / name).mkdir()
    return inside / name


def test_an_alarm_before_hour_0_refuses_the_start(tmp_path: Path) -> None:
    with pytest.raises(BenchFailure, match="the chamber reports: alarm 2 low"):
        broken(tmp_path, {"name": "alarm", "on": "chamber", "alarm": 2, "state": "low"})


@pytest.mark.parametrize("on", ["chamber", "rate_table"])
def test_an_instrument_that_answers_no_more_is_an_error(tmp_path: Path, on: str) -> None:
    end = broken(tmp_path, {"name": "no_reply", "on": on, "at": "5 min"})
    assert end.outcome == "ERROR" and "no reply" in end.message
    assert "broken.yaml:" in end.message and len(safe_events(end)) == 2


@pytest.mark.parametrize(
    "fault",
    [
        {"name": "no_reply", "probability": 0.02},
        {"name": "late_reply", "probability": 0.02, "delay": "1.5 s"},
        {"name": "garbled_reply", "probability": 0.02},
    ],
)
def test_a_bad_line_to_the_chamber_is_got_over(tmp_path: Path, fault: dict[str, Any]) -> None:
    end = broken(tmp_path, {"on": "chamber", **fault})
    assert end.outcome == "PASS", end.message
    assert len(faults_of(end)) > 3


@pytest.mark.parametrize("dut", ["FOG-A01", "FOG-B01"])
def test_a_frozen_gyro_fails_its_points(tmp_path: Path, dut: str) -> None:
    end = broken(tmp_path, {"name": "frozen", "on": dut, **AT_100})
    assert end.outcome == "FAIL"
    assert reasons(end, dut)[:2] == ["", ""] and "frozen" in reasons(end, dut)[2]


@pytest.mark.parametrize("dut", ["FOG-A01", "FOG-B01"])
@pytest.mark.parametrize("size", ["0.2 deg/s", "1000 deg/s"])
def test_spikes_are_counted_as_the_truth_has_them_and_move_no_mean(
    tmp_path: Path, healthy: pd.DataFrame, dut: str, size: str
) -> None:
    end = broken(tmp_path, {"name": "spike", "on": dut, "probability": 2e-3, "size": size})
    points = pd.read_csv(end.folder / "points.csv", keep_default_na=False).query("dut == @dut")
    sessions = sessions_of(end, dut)
    for _, row in points.iterrows():
        session = [one for one in sessions if one.began_s <= row["started_at_s"] + 1e-6][-1]
        spiked = [n for one in session.records for n in range(one["frame"], one["frame"] + one["frames"])]
        assert row["spikes"] == sum(session.first <= number < session.first + 1000 for number in spiked)
        assert row["verdict"] == ("marginal" if row["spikes"] > 1 else "pass")
        assert ("spikes" in row["reasons"]) is (row["spikes"] > 1)
    assert points["spikes"].sum() >= 3 and points["frames_lost"].sum() == points["outliers"].sum() == 0
    assert not verify(end.folder).wrong
    clean = healthy.query("dut == @dut")["rate_mean_dps"].to_numpy()
    # leaving out some frames of a thousand changes a mean by a fraction of its uncertainty
    assert (abs(points["rate_mean_dps"].to_numpy() - clean) < 0.5 * points["rate_mean_u_dps"].to_numpy()).all()


def test_too_many_spikes_fail_a_point(tmp_path: Path) -> None:
    end = broken(tmp_path, {"name": "spike", "on": "FOG-A01", "probability": 2e-2, "size": "1000 deg/s"})
    assert end.outcome == "FAIL" and all("spikes" in reason for reason in reasons(end))


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """The points of the short campaign on a healthy bench."""
    return pd.read_csv(broken(tmp_path_factory.mktemp("healthy")).folder / "points.csv")


@pytest.mark.parametrize("dut", ["FOG-A01", "FOG-B01"])
@pytest.mark.parametrize("name", ["silence", "power_reset"])
def test_a_gap_is_lost_frames(tmp_path: Path, healthy: pd.DataFrame, dut: str, name: str) -> None:
    at_s = healthy["started_at_s"].iloc[0] + 4.0
    end = broken(tmp_path, {"name": name, "on": dut, "at": f"{at_s} s", "for": "2 s"})
    lost = end.manifest["data_quality"][dut]["lost"]
    # a restarted counter hides how many are missing, but for whole periods (128 or 256 frames)
    assert abs(lost - 200) <= 1 if name == "silence" else lost > 0
    # the point fails, or is measured again
    warnings = [event["text"] for event in end.manifest["events"] if event["kind"] == "warning"]
    assert "frames lost" in "".join(warnings + reasons(end, dut))


def test_a_late_stream_is_waited_for(tmp_path: Path, healthy: pd.DataFrame) -> None:
    at_s = healthy["ended_at_s"].iloc[0] - 1.0
    end = broken(tmp_path, {"name": "late", "on": "FOG-A01", "at": f"{at_s} s", "for": "1.8 s"})
    assert end.outcome == "PASS", end.message
    assert end.manifest["data_quality"]["FOG-A01"]["lost"] == 0


def test_the_rehearsal_knows_no_faults(tmp_path: Path) -> None:
    end = broken(tmp_path, {"name": "fault", "on": "rate_table", "at": "1 min"})
    forecast = next(entry for entry in read_journal(end.folder / "journal.jsonl") if entry["kind"] == "forecast")
    assert end.outcome == "ERROR" and forecast["failure"] is None
