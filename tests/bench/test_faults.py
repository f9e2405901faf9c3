"""Every fault has one defined outcome for each way in which it comes; the documents have the same table."""

import re
from pathlib import Path

import pytest
import yaml

from bench.conclude import RunEnd
from bench.errors import BenchFailure, ExitCode
from bench.journal import read_journal
from bench.resume import prepare_resume
from bench.run import run
from bench.verify.verify import verify
from simulated_hw.faults.kinds import FAULTS, faults_of
from tests.bench.campaigns import ROOT, run_campaign, virtual_bench
from tests.bench.fault_outcomes import CASES, Case
from tests.bench.faulty import DUTS, SHORT, begins, broken, events, faults_in, points_of, truth_folders
from tests.bench.faulty import faults_of as faults_by_the_log

PAGE = ROOT / "docs" / "how-to" / "faults.md"
EVERY = [
    pytest.param(case, on, id=f"{case.fault}-{case.how}-{on}".replace(" ", "_")) for case in CASES for on in case.on
]


def test_every_fault_has_an_outcome_on_every_instrument_that_can_have_it() -> None:
    told = {(case.fault, on) for case in CASES for on in case.on}
    kinds = {
        "chamber": faults_of("chamber"),
        "rate_table": faults_of("rate_table"),
        DUTS[0]: faults_of("dut"),
        DUTS[1]: faults_of("dut", can=True),
    }
    assert told == {(name, on) for on, names in kinds.items() for name in names}
    assert {name for name, _ in told} == set(FAULTS)


def test_the_documents_have_the_same_table() -> None:
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+?) \|[^|]+\| (\w+), (\d) \| ([^|]+?) \|$", PAGE.read_text(), re.MULTILINE)
    documented = {(fault, how): (outcome, int(code)) for fault, how, outcome, code, _ in rows}
    assert len(documented) == len(rows)
    assert documented == {(case.fault, case.how): (case.outcome, case.exit_code) for case in CASES}
    record = {(fault, how): text for fault, how, _, _, text in rows}
    for case in CASES:
        for word in filter(None, (case.said, case.column)):
            assert word in record[case.fault, case.how], (case.fault, case.how)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> RunEnd:
    """The short campaign on a bench without a fault."""
    return broken(tmp_path_factory.mktemp("healthy"))


def carried_out(folder: Path, case: Case, on: str, first_point_s: float) -> RunEnd:
    path = virtual_bench(folder, seed=1, faults=[case.script(on, first_point_s)])
    if case.real_door:
        bench = yaml.safe_load(path.read_text())
        bench["chamber"]["settings"] = {"door_register": 106}
        path.write_text(yaml.safe_dump(bench, sort_keys=False))
    return run_campaign(folder, "broken", case.procedure, path)


@pytest.mark.parametrize(("case", "on"), EVERY)
def test_the_outcome_is_the_defined_one(tmp_path: Path, healthy: RunEnd, case: Case, on: str) -> None:
    first_point_s = float(points_of(healthy)["started_at_s"].iloc[0])
    if case.outcome == "refused":
        with pytest.raises(BenchFailure, match=case.said) as refusal:
            carried_out(tmp_path, case, on, first_point_s)
        assert refusal.value.exit_code == ExitCode.BENCH_FAILED and not (tmp_path / "results" / "broken").exists()
        return
    end = carried_out(tmp_path, case, on, first_point_s)
    assert (end.outcome, end.exit_code) == (case.outcome, case.exit_code), end.message
    check_happened(case, on, end)
    check_record(case, on, end)
    if case.resumed:
        check_resumed(case, end)


def check_happened(case: Case, on: str, end: RunEnd) -> None:
    """The truth log has the fault, and no other."""
    records = [record for record in faults_by_the_log(end) if record["fault"] != "discard"]
    assert {(record["fault"], record["instrument"]) for record in records} == {(case.fault, on)}


def check_record(case: Case, on: str, end: RunEnd) -> None:
    points, others = points_of(end), [dut for dut in DUTS if dut != on]
    said = {
        "message": [end.message],
        "events": events(end),
        "reasons": points["reasons"].tolist(),
        "": [],
    }[case.where]
    assert not case.said or any(case.said in text for text in said), said
    if case.outcome == "ERROR":
        # with the step's place; what cannot be made safe for it does not answer is said to be so
        assert re.search(r"broken\.yaml:\d+:\d+", end.message)
        assert ("NOT SAFE" in end.message) == (case.how == "for good")
        assert len(events(end, "safe")) == 2
    else:
        assert len(points) == 6
    if on in DUTS:
        mine = points[points["dut"] == on]
        assert (points[points["dut"].isin(others)]["verdict"] == "pass").all()
        assert (mine["verdict"] == "fail").any() == (case.outcome == "FAIL")
        assert not case.column or mine[case.column].sum() > 0
    else:
        assert (points["verdict"] != "fail").all()


def check_resumed(case: Case, end: RunEnd) -> None:
    """What came once does not come again, and what was missing is measured."""
    again = run(prepare_resume(end.folder, missing=case.outcome == "FAIL"))
    assert again.outcome == case.resumed, again.message
    assert (points_of(again)["verdict"] == "pass").all() and len(points_of(again)) == 6
    first, second = (faults_in(folder) for folder in truth_folders(end.folder))
    assert [name for name, _ in begins(first)][:1] == [case.fault] or case.fault == "silence"
    lasted_s = 40.0
    assert all(t_s <= next(begins(first))[1] + lasted_s for _, t_s in begins(second))


def test_an_open_door_shows_in_the_points(tmp_path: Path) -> None:
    """Nothing tells of it but the chamber's readback, which drifts off its setpoint."""
    cold = SHORT.replace("to: 20", "to: 0").replace("soak: 10 min", "soak: 1 h")
    before = points_of(broken(inside(tmp_path, "healthy"), procedure=cold))
    begins_s = before["started_at_s"].min() - 300.0
    door = {"name": "door_open", "on": "chamber", "leak": 50, "at": f"{begins_s} s", "for": "20 min"}
    end = broken(inside(tmp_path, "open"), door, procedure=cold)
    after = points_of(end)
    assert before["chamber_readback_degc"].abs().max() < 0.5 and after["chamber_readback_degc"].min() > 1.5
    assert dict(begins(faults_by_the_log(end))) == {"door_open": pytest.approx(begins_s)}


def inside(folder: Path, name: str) -> Path:
    (folder / name).mkdir()
    return folder / name


@pytest.mark.parametrize("dut", DUTS)
def test_a_frozen_gyro_fails_only_the_points_it_froze_in(tmp_path: Path, dut: str) -> None:
    end = broken(tmp_path, {"name": "frozen", "on": dut, "when": {"table_above": "60 deg/s"}})
    assert points_of(end, dut)["reasons"].tolist() == ["", "", "output frozen"]


@pytest.mark.parametrize("dut", DUTS)
@pytest.mark.parametrize("size", ["0.2 deg/s", "1000 deg/s"])
def test_spikes_move_no_mean(tmp_path: Path, healthy: RunEnd, dut: str, size: str) -> None:
    end = broken(tmp_path, {"name": "spike", "on": dut, "probability": 2e-3, "size": size})
    points = points_of(end, dut)
    assert points["verdict"].tolist() == ["marginal" if found > 1 else "pass" for found in points["spikes"]]
    assert points["spikes"].sum() >= 3 and points["frames_lost"].sum() == points["outliers"].sum() == 0
    assert not verify(end.folder).wrong
    clean = points_of(healthy, dut)["rate_mean_dps"].to_numpy()
    # leaving out some frames of a thousand changes a mean by a fraction of its uncertainty
    assert (abs(points["rate_mean_dps"].to_numpy() - clean) < 0.5 * points["rate_mean_u_dps"].to_numpy()).all()


def test_the_rehearsal_knows_no_faults(tmp_path: Path) -> None:
    end = broken(tmp_path, {"name": "fault", "on": "rate_table", "at": "1 min"})
    forecast = next(entry for entry in read_journal(end.folder / "journal.jsonl") if entry["kind"] == "forecast")
    assert end.outcome == "ERROR" and forecast["failure"] is None


def test_an_end_that_was_not_safe_is_not_said_of_the_attempts_behind_it(tmp_path: Path) -> None:
    lying = {"name": "encoder_error", "rate_offset": "0.5 deg/s", "when": {"table_above": "20 deg/s"}, "for": "3 min"}
    e_stop = {"name": "e_stop", "when": {"table_above": "60 deg/s"}, "for": "10 s"}
    end = broken(tmp_path, *({"on": "rate_table", **fault} for fault in (lying, e_stop)))
    assert "NOT SAFE: rate table: still turning at 0." in end.message
    again = run(prepare_resume(end.folder))
    assert "emergency stop" in again.message and "NOT SAFE" not in again.message
    # the record keeps it all the same
    assert any("NOT SAFE" in text for text in events(again, "safe"))
