"""JUnit files: what CI systems read out of them, and that there is one whatever happens."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analyses.context import Judged
from bench.cli.main import main
from bench.conclude import RunEnd
from bench.errors import BenchFailure, ExitCode
from bench.junit import Case, JUnitFile, cases_of_run, document, junit_file
from bench.run import RunRequest, prepare, run
from tests.bench.campaigns import VIRTUAL, write

SHORT = """\
procedure: short
raw: none
quality: {slope: 5 degC/min}
steps:
  - sweep:
      rate: {from: -100 deg/s, to: 100 deg/s, step: 50 deg/s}
      steps:
        - settle: {band: 0.02 deg/s, for: 0.5 s, timeout: 30 s}
        - acquire: {count: 20, every: 0.2 s}
analysis:
  models: [linear]
  splits: {random: {train: 3}}
  limits:
    - {model: linear, split: random, max_abs: 50 deg/s, std: 1e-9 deg/s}
"""

Typed = Callable[..., int]


def read(path: Path) -> dict[str, ElementTree.Element]:
    """The cases by name, after what every reader counts on has been checked."""
    root = ElementTree.parse(path).getroot()
    assert root.tag == "testsuites"
    (suite,) = root
    cases = suite.findall("testcase")
    for element in (root, suite):
        assert int(element.attrib["tests"]) == len(cases)
        assert int(element.attrib["failures"]) == len(suite.findall("testcase/failure"))
        assert int(element.attrib["errors"]) == len(suite.findall("testcase/error"))
    assert [child.tag for child in suite] == ["properties"] + ["testcase"] * len(cases)
    for case in cases:
        assert float(case.attrib["time"]) >= 0 and case.attrib["classname"]
        assert [child.tag for child in case] in (
            *([], ["system-out"], ["failure"], ["error"]),
            *(["failure", "system-out"], ["error", "system-out"]),
        )
        assert all("type" in child.attrib for child in case if child.tag != "system-out")
    return {case.attrib["name"]: case for case in cases}


def message(case: ElementTree.Element, tag: str) -> str:
    found = case.find(tag)
    assert found is not None
    return found.attrib["message"]


@pytest.fixture
def fogbench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Typed:
    def typed(*arguments: Any) -> int:
        monkeypatch.setattr(sys, "argv", ["fogbench", *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0)

    return typed


def test_a_run_has_a_case_for_its_outcome_each_limit_and_each_duts_points(fogbench: Typed, tmp_path: Path) -> None:
    procedure = write(tmp_path, "short.yaml", SHORT)
    bad = "bench.simulation.faults=[{name: loss, on: FOG-B01, probability: 0.05}]"
    code = fogbench("run", procedure, "--bench", VIRTUAL, "--junit", "made/j.xml", "--set", bad, "--run-id", "a")
    cases = read(tmp_path / "made" / "j.xml")
    assert code == ExitCode.FAILED
    limits = ["limit: linear, random, max_abs_dps", "limit: linear, random, std_dps"]
    assert list(cases) == ["outcome", *limits, "points: FOG-A01", "points: FOG-B01"]
    assert "5 of 10 points failed" in message(cases["outcome"], "failure")
    # FOG-B01 has no usable point: its figure was not measured, and has not passed.
    assert message(cases[limits[0]], "failure") == "not measured (FAIL)"
    assert message(cases["points: FOG-B01"], "failure") == "5 of 5 points failed"
    text = cases["points: FOG-B01"].findtext("failure") or ""
    assert "without a temperature setpoint: 5 of 5 points fail (frames lost)" in text
    assert "point 1, -100 deg/s: frames lost" in text
    assert cases["points: FOG-A01"].find("failure") is None
    suite = ElementTree.parse(tmp_path / "made" / "j.xml").getroot()[0]
    assert suite.attrib["name"] == "short.virtual"
    properties = {item.attrib["name"]: item.attrib["value"] for item in suite.iter("property")}
    assert properties["run_id"] == "a" and properties["exit_code"] == "1"
    assert list((tmp_path / "made").iterdir()) == [tmp_path / "made" / "j.xml"]


def test_a_limit_is_a_case_of_its_own(fogbench: Typed, tmp_path: Path) -> None:
    procedure = write(tmp_path, "short.yaml", SHORT)
    assert fogbench("run", procedure, "--bench", VIRTUAL, "--junit", "j.xml", "--json") == ExitCode.FAILED
    cases = read(tmp_path / "j.xml")
    assert "is over 3.6e-06 deg/h" in message(cases["limit: linear, random, std_dps"], "failure")
    passed = cases["limit: linear, random, max_abs_dps"]
    assert [child.tag for child in passed] == ["system-out"]
    assert "FOG-A01: " in (passed.findtext("system-out") or "")


def test_error_and_then_resume(fogbench: Typed, tmp_path: Path) -> None:
    procedure = write(tmp_path, "short.yaml", SHORT)
    bad = "bench.simulation.faults=[{name: fault, on: rate_table, at: 20 s}]"
    arguments = ("--bench", VIRTUAL, "--junit", "j.xml", "--set", bad, "--run-id", "broken")
    assert fogbench("run", procedure, *arguments) == ExitCode.BENCH_FAILED
    cases = read(tmp_path / "j.xml")
    error = cases["outcome"].find("error")
    assert error is not None and error.attrib["type"] == "ERROR" and "safe" in (error.text or "")
    assert "points were not measured" in message(cases["points: FOG-A01"], "error")
    assert message(cases["limit: linear, random, std_dps"], "error") == "not measured (ERROR)"
    fogbench("resume", "broken", "--junit", "again.xml")
    assert "outcome" in read(tmp_path / "again.xml")


def test_aborted(tmp_path: Path) -> None:
    request = RunRequest(write(tmp_path, "short.yaml", SHORT), VIRTUAL, tmp_path / "results")
    end = run(prepare(request), on_stop=lambda stop: stop.ask())
    assert end.outcome == "ABORTED"
    with junit_file(tmp_path / "j.xml", "short.virtual") as file:
        file.tell_run(end)
    cases = read(tmp_path / "j.xml")
    assert message(cases["outcome"], "error").startswith("ABORTED")
    assert message(cases["points: FOG-B01"], "error") == "5 of 5 points were not measured"


def test_mistakes_are_errors_of_a_run_and_failures_of_a_check(fogbench: Typed, tmp_path: Path) -> None:
    good = write(tmp_path, "good.yaml", SHORT)
    bad = write(tmp_path, "bad.yaml", SHORT.replace("settle", "setle").replace("raw: none", "raw: all"))
    assert fogbench("run", bad, "--bench", VIRTUAL, "--junit", "run.xml") == ExitCode.USER_MISTAKE
    outcome = read(tmp_path / "run.xml")["outcome"]
    assert "Did you mean settle?" in (outcome.findtext("error") or "")
    assert not (tmp_path / "results").exists()
    assert fogbench("check", good, bad, "--bench", VIRTUAL, "--junit", "check.xml") == ExitCode.USER_MISTAKE
    cases = read(tmp_path / "check.xml")
    assert message(cases[f"check: {bad}"], "failure").startswith("2 mistakes, the first: ")
    assert cases[f"check: {good}"].find("failure") is None


def test_a_process_that_dies_leaves_a_file_that_says_so(tmp_path: Path) -> None:
    path = write(tmp_path, "j.xml", "of an earlier run")
    JUnitFile(path, "short.virtual").begin()
    assert "did not come to its end" in message(read(path)["outcome"], "error")


def test_a_defect_is_an_error_too(fogbench: Typed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def defective(request: RunRequest) -> None:
        raise RuntimeError("oh \x00")

    monkeypatch.setattr("bench.run.prepare", defective)
    procedure = write(tmp_path, "short.yaml", SHORT)
    assert fogbench("run", procedure, "--bench", VIRTUAL, "--junit", "j.xml") == ExitCode.BENCH_FAILED
    error = read(tmp_path / "j.xml")["outcome"].find("error")
    assert error is not None and error.attrib["type"] == "RuntimeError" and error.text == "oh \ufffd"


def test_a_file_that_cannot_be_written_is_told_before_anything_is_touched(fogbench: Typed, tmp_path: Path) -> None:
    write(tmp_path, "file", "in the way")
    procedure = write(tmp_path, "short.yaml", SHORT)
    assert fogbench("run", procedure, "--bench", VIRTUAL, "--junit", "file/j.xml") == ExitCode.USER_MISTAKE
    assert not (tmp_path / "results").exists()


def test_a_file_that_cannot_be_written_at_the_end_does_not_hide_the_result(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    with pytest.raises(BenchFailure, match="The result was: too hot"), junit_file(folder / "j.xml", "a") as file:
        (folder / "j.xml").unlink()
        folder.rmdir()
        file.tell([Case("outcome", "failure", "FAIL", "too hot")], {})


def test_points_are_grouped_by_temperature_and_verdict(tmp_path: Path) -> None:
    rows = [(n, "X", -10.0 if n < 20 else float("nan"), float(n), *verdict(n)) for n in range(1, 25)]
    columns = ["point", "dut", "chamber_setpoint_degc", "rate_setpoint_dps", "verdict", "reasons"]
    pd.DataFrame(rows, columns=columns).to_parquet(tmp_path / "points.parquet")
    manifest = {"points_planned": 26, "duts": {"X": {}}, "events": [], "wall_s": None}
    judged = [Judged("linear", "random", "std_dps", 1.0, {})]
    end = RunEnd(tmp_path, "FAIL", ExitCode.FAILED, "bad", {}, judged, manifest)
    _, limit, points = cases_of_run(end)
    assert limit.status == "failure"
    assert points.message == "13 of 24 points failed; 2 of 26 points were not measured"
    assert "at -10 degC: 12 of 19 points fail (frames lost, no samples)" in points.details
    assert "  point 3, 3 deg/s: no samples" in points.details and "  and 2 more, see points.csv" in points.details
    assert "without a temperature setpoint: 1 of 5 points fail (frames lost)" in points.details
    assert points.output.startswith("without a temperature setpoint: 1 of 5 points marginal (outliers)")


def verdict(point: int) -> tuple[str, str]:
    if point == 3:
        return "fail", "no samples"
    if point <= 12 or point == 20:
        return "fail", "frames lost 1.2e+04 over 1000 ppm"
    return ("marginal", "outliers 6e3 over 5000 ppm") if point == 21 else ("pass", "")


@given(st.text(), st.text(), st.text())
def test_any_text_can_be_in_a_message(name: str, told: str, value: str) -> None:
    data = document("s", [Case(name, "error", told, told, told, told)], {"p": value}, "2010-01-01T00:00:00Z")
    (suite,) = ElementTree.fromstring(data)
    assert suite.attrib["timestamp"] == "2010-01-01T00:00:00"
    error = suite.find("testcase/error")
    assert error is not None
    assert error.attrib["message"] == "".join(c if in_xml(ord(c)) else "\ufffd" for c in told)


def in_xml(code: int) -> bool:
    """XML 1.0, production [2] Char."""
    return code in (9, 10, 13) or 0x20 <= code <= 0xD7FF or 0xE000 <= code <= 0xFFFD or code >= 0x10000
