"""Links that fail on the virtual bench: what is waited for, what is done again, what is left out and measured later."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from bench import opening
from bench.check import check
from bench.cli.status import _text
from bench.conclude import RunEnd
from bench.dutlinks import DutLink
from bench.errors import BenchFailure, UserMistake
from bench.journal import load_journal
from bench.resume import prepare_resume
from bench.run import RunRequest, prepare, run
from bench.status import status_of
from bench.verify.verify import verify
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses
from drivers.errors import PortError
from drivers.ports import DirectSerialSource
from simulated_hw.wire.serial_frames import SimulatedSerialGyro
from tests.bench.campaigns import GRID, VIRTUAL, run_campaign, virtual_bench, write

pytestmark = pytest.mark.usefixtures("unrehearsed")
A, B = "FOG-A01", "FOG-B01"


def journal_of(end: RunEnd) -> list[dict[str, Any]]:
    return load_journal(end.folder / "journal.jsonl")


def links_of(end: RunEnd) -> list[tuple[str, str]]:
    return [(entry["instrument"], entry["state"]) for entry in journal_of(end) if entry["kind"] == "link"]


def measured(end: RunEnd) -> dict[str, list[int]]:
    points = pd.read_csv(end.folder / "points.csv")
    return {dut: points[points["dut"] == dut]["point"].tolist() for dut in (A, B)}


def with_links(bench: Path, **links: str) -> Path:
    """The bench with a `links:` block."""
    document = yaml.safe_load(bench.read_text(encoding="utf-8"))
    return write(bench.parent, "links.yaml", yaml.safe_dump(document | {"links": links}))


def with_fault(tmp_path: Path, procedure: str = GRID, patience: str = "5 min", **fault: Any) -> RunEnd:
    bench = with_links(virtual_bench(tmp_path, seed=1, faults=[fault]), patience=patience)
    return run_campaign(tmp_path, "r", procedure, bench)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    end = run_campaign(tmp_path_factory.mktemp("healthy"), "h", GRID, VIRTUAL, seed=1)
    return pd.read_csv(end.folder / "points.csv")


@pytest.fixture
def unplug(monkeypatch: pytest.MonkeyPatch) -> Callable[[float, float], None]:
    """Takes the port of the serial gyro away between two instants of bench time."""

    def arrange(begin_s: float, end_s: float) -> None:
        take, open_source = DirectSerialSource.take, opening.open_byte_source

        def taken(self: DirectSerialSource) -> tuple[bytes, float]:
            if begin_s < self._now() < end_s:
                raise PortError(self.name, "went away")
            return take(self)

        def opened(port: Any, now: Callable[[], float]) -> Any:
            if begin_s < now() < end_s:
                port.close()
                raise PortError(port.name, "does not open")
            return open_source(port, now)

        monkeypatch.setattr(DirectSerialSource, "take", taken)
        monkeypatch.setattr(opening, "open_byte_source", opened)

    return arrange


@pytest.fixture
def mute(monkeypatch: pytest.MonkeyPatch) -> Callable[[float, float], None]:
    """Makes the serial gyro silent between two instants of bench time; its port stays."""

    def arrange(begin_s: float, end_s: float) -> None:
        whole = SimulatedSerialGyro.bytes_until

        def bytes_until(self: Any, now_s: float) -> bytes:
            if begin_s < now_s < end_s:
                self.skip_until(now_s)
                return b""
            return whole(self, now_s)

        monkeypatch.setattr(SimulatedSerialGyro, "bytes_until", bytes_until)

    return arrange


@pytest.mark.parametrize(("on", "name"), [("chamber", "chamber"), ("rate_table", "rate table")])
def test_an_outage_in_an_acquisition_costs_that_acquisition_alone(
    tmp_path: Path, healthy: pd.DataFrame, on: str, name: str
) -> None:
    """Two minutes without an answer at point 9: the table rests, then the point is measured anew, once."""
    began_s = float(healthy[healthy["point"] == 9]["started_at_s"].iloc[0]) + 2.0
    end = with_fault(tmp_path, name="no_reply", on=on, at=f"{began_s} s", **{"for": "2 min"})
    assert end.outcome == "PASS", end.message
    assert links_of(end) == [(name, "lost"), (name, "restored")]
    assert measured(end) == {A: list(range(1, 29)), B: list(range(1, 29))}
    points = pd.read_csv(end.folder / "points.csv")
    assert (points["frames"] == 1000).all() and (points["verdict"] != "fail").all()
    anew = points[points["point"] == 9]["started_at_s"].iloc[0]
    # an attempt to reach the chamber lasts 3 s, and the longest wait between two is 10 s
    assert began_s + 120.0 < anew < began_s + 200.0
    again = [entry["verb"] for entry in journal_of(end) if entry.get("again")]
    # the temperature held: no soak
    assert again == ["set_temperature", "set_rate", "settle"]
    assert not [finding for check in verify(end.folder).checks for finding in check.findings]


def test_a_soak_that_lost_the_chamber_goes_on_where_it_was(tmp_path: Path, healthy: pd.DataFrame) -> None:
    soaked = GRID.replace("soak: 10 min", "soak: 1 h")
    end = with_fault(tmp_path, soaked, name="no_reply", on="chamber", at="40 min", **{"for": "1 min"})
    entries = journal_of(end)
    begins = [entry["t_s"] for entry in entries if entry["kind"] == "step" and entry["verb"] == "soak"]
    first = next(entry["step"] for entry in entries if entry["kind"] == "step" and entry["verb"] == "soak")
    done = next(entry["t_s"] for entry in entries if entry["kind"] == "done" and entry["step"] == first)
    assert begins[0] < 40 * 60.0 < begins[1] < 43 * 60.0
    lost_s, back_s = (entry["t_s"] for entry in entries if entry["kind"] == "link")
    # an hour, and the time from when the loss was noticed
    assert 10.0 < back_s - lost_s < 80.0
    assert done - begins[0] == pytest.approx(3600.0 + back_s - lost_s, abs=10.0)
    assert end.outcome == "PASS", end.message


def test_on_the_way_to_a_temperature_the_last_one_is_not_gone_back_to(tmp_path: Path, healthy: pd.DataFrame) -> None:
    """The outage is in the ramp from 0 to 10 degC."""
    at_s = float(healthy[healthy["dwell"] == 1]["ended_at_s"].max()) + 60.0
    end = with_fault(tmp_path, name="no_reply", on="chamber", at=f"{at_s} s", **{"for": "1 min"})
    assert end.outcome == "PASS" and len(links_of(end)) == 2
    later = [e["chamber_degc"] for e in journal_of(end) if e["kind"] == "readback" and e["t_s"] > at_s + 90.0]
    assert min(later) > 0.5


def test_an_outage_longer_than_the_patience_is_an_error_that_can_be_resumed(tmp_path: Path) -> None:
    fault: dict[str, Any] = {"name": "no_reply", "on": "rate_table", "at": "40 min", "for": "5 min"}
    end = with_fault(tmp_path, GRID, "1 min", **fault)
    assert end.outcome == "ERROR"
    assert "no reply" in end.message and "tried again for 1 min" in end.message and "r.yaml:" in end.message
    # out of patience, it was tried to make the table safe all the same
    safe = [entry["instrument"] for entry in journal_of(end) if entry["kind"] == "safe"]
    assert sorted(safe) == ["chamber", "rate table"]


def test_a_reply_that_is_always_wrong_is_given_up(tmp_path: Path) -> None:
    """Everything answers, but one question is never answered well: no waiting mends that."""
    end = with_fault(tmp_path, name="garbled_reply", on="chamber", at="30 min", probability=0.8)
    assert end.outcome in ("ERROR",) and "reply to" in end.message


@pytest.mark.parametrize("port_goes", [True, False], ids=["unplugged", "silent"])
def test_a_lost_dut_comes_back_and_the_others_were_measured_meanwhile(
    tmp_path: Path,
    healthy: pd.DataFrame,
    unplug: Callable[..., None],
    mute: Callable[..., None],
    port_goes: bool,
) -> None:
    began_s = float(healthy[healthy["point"] == 9]["started_at_s"].iloc[0]) + 3.0
    (unplug if port_goes else mute)(began_s, began_s + 1000.0)
    bench = with_links(virtual_bench(tmp_path, seed=1), silent_after="15 s")
    end = run_campaign(tmp_path, "r", GRID, bench)
    assert links_of(end) == [(A, "lost"), (A, "restored")]
    points = pd.read_csv(end.folder / "points.csv")
    mine, other = points[points["dut"] == A], points[points["dut"] == B]
    assert other["point"].tolist() == list(range(1, 29)) and (other["verdict"] != "fail").all()
    left = end.manifest["missing"]
    assert list(left) == [A] and end.outcome == "FAIL" and "fogbench resume r --missing" in end.message
    good = mine[mine["verdict"] != "fail"]["point"].tolist()
    # away for 1000 s: the points at 10 degC from the ninth on; back at the next temperature
    lacking = [point for point in range(1, 29) if point not in good]
    assert lacking == list(range(9, lacking[-1] + 1)) and 14 <= lacking[-1] <= 17
    assert (mine[mine["verdict"] != "fail"]["frames"] == 1000).all()
    # the other one waited for nobody
    last = float(other["ended_at_s"].max())
    assert last < float(healthy["ended_at_s"].max()) + 120.0


def test_a_dut_that_is_lost_in_mid_acquisition_does_not_have_the_others_measured_again(
    tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None]
) -> None:
    unplug(float(healthy[healthy["point"] == 9]["started_at_s"].iloc[0]) + 3.0, 1e9)
    end = run_campaign(tmp_path, "r", GRID, VIRTUAL, seed=1)
    assert not any("measured again" in entry.get("text", "") for entry in journal_of(end))
    points = pd.read_csv(end.folder / "points.csv")
    columns = ["point", "started_at_s"]
    other, undisturbed = (rows[rows["dut"] == B][columns].reset_index(drop=True) for rows in (points, healthy))
    # its late frames were waited for once; an acquisition takes 10 s
    assert (other - undisturbed).abs().max().max() < 3.0
    assert points[points["dut"] == A].query("verdict == 'fail'")["point"].tolist() == [9]


def lost_for_good(tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None]) -> RunEnd:
    began_s = float(healthy[healthy["point"] == 12]["started_at_s"].iloc[0]) + 3.0
    unplug(began_s, 1e9)
    return run_campaign(tmp_path, "r", GRID, VIRTUAL, seed=1)


def test_what_a_lost_dut_misses_is_listed_and_measured_later(
    tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    end = lost_for_good(tmp_path, healthy, unplug)
    assert end.outcome == "FAIL" and links_of(end) == [(A, "lost")]
    before = pd.read_parquet(end.folder / "points.parquet")
    status = status_of(end.folder)
    assert status["state"] == "ended" and status["missing"] == end.manifest["missing"]
    lacking = {12, *range(13, 29)}
    assert set(before[(before["dut"] == A) & (before["verdict"] != "fail")]["point"]) == set(range(1, 29)) - lacking
    with pytest.raises(UserMistake, match="--missing"):
        prepare_resume(end.folder)

    monkeypatch.undo()
    prepared = prepare_resume(end.folder, missing=True)
    assert prepared.forecast.failure is None and prepared.forecast.duration_s > 600.0
    end = run(prepared)
    assert end.outcome == "PASS", end.message
    assert end.manifest["missing"] == {} and status_of(end.folder)["missing"] == {}
    assert measured(end) == {A: list(range(1, 29)), B: list(range(1, 29))}
    points = pd.read_parquet(end.folder / "points.parquet")
    assert points["point"].is_monotonic_increasing and (points["verdict"] != "fail").all()
    # what was good is the same to the last digit, and was not measured again
    kept = points[(points["dut"] == B) | (points["point"] < 12)].reset_index(drop=True)
    good = before[(before["dut"] == B) | (before["point"] < 12)].reset_index(drop=True)
    pd.testing.assert_frame_equal(kept, good)
    entries = journal_of(end)
    resumed = next(i for i, entry in enumerate(entries) if entry["kind"] == "resumed")
    assert entries[resumed]["missing"] is True and set(map(int, entries[resumed]["points"])) == lacking
    again = [(e["row"]["point"], e["row"]["dut"]) for e in entries[resumed:] if e["kind"] == "point"]
    assert again == [(point, A) for point in sorted(lacking)]
    assert [finding.text for check in verify(end.folder).checks for finding in check.findings] == []
    with pytest.raises(UserMistake, match="nothing to resume"):
        prepare_resume(end.folder, missing=True)


def test_measuring_what_is_missing_can_be_broken_off_and_taken_up_again(
    tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = lost_for_good(tmp_path, healthy, unplug).folder
    monkeypatch.undo()
    stops: list[Any] = []

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.point == 15:
            stops[0].ask()

    end = run(prepare_resume(folder, missing=True), listen, stops.append)
    assert end.outcome == "ABORTED" and end.manifest["missing"][A] == {"not_measured": "16-28"}
    assert {finding.severity for check in verify(folder).checks for finding in check.findings} <= {"note"}
    with pytest.raises(UserMistake, match="--missing"):
        prepare_resume(folder)
    end = run(prepare_resume(folder, missing=True))
    assert end.outcome == "PASS", end.message
    rows = [(e["row"]["point"], e["row"]["dut"]) for e in journal_of(end) if e["kind"] == "point"]
    once = [row for row in rows if row != (12, A)]
    assert len(set(once)) == len(once) == 55  # of 56; the twelfth point failed once, and was measured again


@pytest.mark.parametrize("action", ["abort", "drop"])
def test_a_guard_on_a_dut_whose_port_goes_has_lost_its_signal(
    tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None], action: str
) -> None:
    began_s = float(healthy[healthy["point"] == 9]["started_at_s"].iloc[0]) + 3.0
    unplug(began_s, began_s + 300.0)
    band = "{from: -60 degC, to: 90 degC}"
    guard = f"guards:\n  - {{name: warm, watch: dut_temperature, inside: {band}, action: {action}}}\n"
    end = run_campaign(tmp_path, "r", GRID.replace("steps:\n", f"{guard}steps:\n", 1), VIRTUAL, seed=1)
    kinds = [entry["kind"] for entry in journal_of(end)]
    assert "guard" in kinds
    if action == "abort":
        assert end.outcome == "ERROR" and "guard 'warm'" in end.message
    else:
        # dropped is for good: the port that comes back is not looked for
        assert end.outcome == "FAIL" and kinds.count("dropped") == 1 and (A, "restored") not in links_of(end)
        assert measured(end)[B] == list(range(1, 29)) and list(end.manifest["missing"]) == [A]


def test_a_run_that_stopped_with_a_dut_lost_is_resumed_without_it(
    tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    began_s = float(healthy[healthy["point"] == 9]["started_at_s"].iloc[0]) + 3.0
    unplug(began_s, 1e9)
    stops: list[Any] = []

    def listen(progress: Any) -> None:
        if progress.finished and progress.step.point == 12:
            stops[0].ask()

    request = RunRequest(write(tmp_path, "r.yaml", GRID), VIRTUAL, tmp_path / "results", "r", 1)
    assert run(prepare(request), listen, stops.append).outcome == "ABORTED"
    shown = _text(status_of(tmp_path / "results" / "r"))
    assert f"{A}: points not measured 10-12, failed 9" in shown
    end = run(prepare_resume(tmp_path / "results" / "r"))
    assert measured(end)[B] == list(range(1, 29)) and end.outcome == "FAIL"
    monkeypatch.undo()
    assert "fogbench resume r --missing" in _text(status_of(end.folder))
    end = run(prepare_resume(end.folder, missing=True))
    assert end.outcome == "PASS" and end.manifest["attempts"] == 3
    assert measured(end) == {A: list(range(1, 29)), B: list(range(1, 29))}


def test_only_a_run_that_was_carried_out_can_lack_something(tmp_path: Path) -> None:
    end = with_fault(tmp_path, name="e_stop", on="rate_table", at="40 min")
    assert end.outcome == "ERROR"
    with pytest.raises(UserMistake, match="was not carried out yet"):
        prepare_resume(end.folder, missing=True)


def test_a_run_without_a_dut_left_waits_for_one_and_then_ends(
    tmp_path: Path, healthy: pd.DataFrame, unplug: Callable[..., None]
) -> None:
    alone = VIRTUAL.read_text().replace("FOG-B01: {class: ts_b}", "")
    a, b = alone.index("  FOG-B01:\n"), alone.index("# What the drivers cannot see")
    bench = write(tmp_path, "alone.yaml", alone[:a] + alone[b:])
    unplug(2400.0, 2500.0)
    short = run_campaign(tmp_path, "short", GRID, bench)
    points = pd.read_csv(short.folder / "points.csv")
    # the point that was under way failed; it was waited with the next
    assert (points["verdict"] == "fail").sum() <= 1 and points["point"].tolist() == list(range(1, 29))
    assert links_of(short) == [(A, "lost"), (A, "restored")]
    unplug(2400.0, 1e9)
    end = run_campaign(tmp_path, "long", GRID, bench)
    assert end.outcome == "ERROR" and "no DUT was heard for 5 min" in end.message
    assert "not safe" not in end.message.lower()


@pytest.mark.parametrize(
    ("setting", "found"),
    [
        ("bench.chamber.identity=Watlow F4, model 1234", "Watlow F4, model 5270"),
        ("bench.rate_table.identity=Ideal Aerosmith*", "Acutronic USA, ACT3000, simulated"),
        ("bench.duts.FOG-A01.identity='*on sim://other'", "on sim://fog-a01"),
    ],
)
def test_another_instrument_than_the_bench_file_expects_is_refused_before_hour_0(
    tmp_path: Path, setting: str, found: str
) -> None:
    with pytest.raises(BenchFailure) as failure:
        run_campaign(tmp_path, "r", GRID, VIRTUAL, (setting,))
    text = str(failure.value)
    assert found in text and setting.partition("=")[2].strip("'") in text and "identity:" in text
    assert not (tmp_path / "results" / "r").exists()


@pytest.mark.parametrize(
    "setting",
    [
        "bench.chamber.identity=Watlow F4, model 5270",
        "bench.chamber.identity=Watlow F4*",
        "bench.rate_table.identity='*ACT3000*'",
        "bench.duts.FOG-A01.identity='*100 Hz*'",
    ],
)
def test_the_expected_instrument_is_found(tmp_path: Path, setting: str) -> None:
    short = "procedure: s\nsteps:\n  - set_rate: 0 deg/s\n"
    end = run_campaign(tmp_path, "r", short, VIRTUAL, (setting,))
    assert end.outcome == "PASS", end.message
    assert end.manifest["identities"]["chamber"] == "Watlow F4, model 5270"


def test_check_shows_who_is_expected(tmp_path: Path) -> None:
    from bench.cli.check import _line, _summary
    from bench.overrides import parse_overrides

    path = write(tmp_path, "p.yaml", GRID)
    checked = check(path, VIRTUAL, parse_overrides(["bench.chamber.identity=Watlow F4*"]))
    assert _line(path, checked).endswith("; expected are chamber 'Watlow F4*'")
    assert _summary(path, VIRTUAL, checked)["identities"] == {"chamber": "Watlow F4*"}
    assert "expected" not in _line(path, check(path, VIRTUAL))


class FakeGyro:
    """A gyro of 10 Hz whose batches are given; a batch of None is a port that is gone."""

    data_rate_hz = 10.0
    meaning: Any = None

    def __init__(self, *batches: list[int] | None, lost: int = 0) -> None:
        self._batches, self.losses = list(batches), Losses(lost=lost)

    def take(self) -> FrameBatch:
        numbers = self._batches.pop(0)
        if numbers is None:
            raise PortError("p", "gone")
        index = np.array(numbers, np.int64)
        values = np.zeros(len(index))
        return FrameBatch({"rate": values}, index, values, values, np.ones(len(index), bool))

    def discard(self) -> None:
        pass

    def describe(self) -> str:
        return "fake"

    def complaint(self) -> str | None:
        return None


def test_frame_numbers_and_losses_go_on_over_a_change_of_port() -> None:
    now = [0.0]
    link = DutLink(10.0, FakeGyro([0, 1, 2], None, lost=3), lambda: now[0])
    assert link.take().index.tolist() == [0, 1, 2]
    now[0] = 0.1
    assert len(link.take()) == 0 and not link.connected and "gone" in link.why
    link.join(FakeGyro([0, 1], [2], lost=1))
    now[0] = 5.0
    # 5 s after frame 2, at 10 Hz, the newest is frame 52
    assert link.take().index.tolist() == [51, 52] and link.take().index.tolist() == [53]
    assert link.losses.lost == 3 + 48 + 1


def test_a_gap_shorter_than_the_clock_can_tell_never_repeats_a_number() -> None:
    link = DutLink(10.0, FakeGyro([7], None), lambda: 1.0)
    link.take(), link.take()
    link.join(FakeGyro([0, 1, 2]))
    assert link.take().index.tolist() == [8, 9, 10] and link.losses.lost == 0
