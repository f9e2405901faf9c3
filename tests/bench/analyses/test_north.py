"""North seeking from records to headings, against the surveyed azimuth of the bench."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from bench.analyses.north import NotSought, seekings_of
from bench.errors import InvalidFiles
from bench.run import RunRequest, prepare
from bench.verify.verify import verify
from tests.bench.campaigns import ROOT, run_campaign, write

BENCH = ROOT / "benches" / "virtual_north.yaml"
SEEK = """\
procedure: seeking
raw: samples
steps:
  - dwell: 2 h
  - record: {name: still, every: 100 ms, steps: [{dwell: 30 min}]}
  - repeat:
      times: 6
      steps:
        - sweep:
            position: [0 deg, 90 deg, 180 deg, 270 deg]
            steps:
              - dwell: 10 s
              - record: {name: seek, every: 100 ms, steps: [{dwell: 2 min}]}
north: {seek: seek, still: still, max_error_mil: 8}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    end = run_campaign(tmp_path_factory.mktemp("north"), "r", SEEK, BENCH)
    assert end.outcome == "PASS", end.message
    return end.folder


def found_in(run: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((run / "analyses" / "north.json").read_text())
    return document["SEEKER-1"]


def test_north_is_found_within_the_noise_of_the_gyros(run: Path) -> None:
    """N = 0.0025 deg/sqrt(h) over 2 min and flicker of 0.02 deg/h: some mil of 6000 to the circle."""
    found = found_in(run)
    assert found["seekings"] == 6 and found["mils_per_circle"] == 6000.0
    assert 0.1 < found["two_positions"]["rms_before_mil"] < 5.0
    assert 0.1 < found["four_positions"]["four_before_mil"] < 5.0
    assert "north error" in found["two_positions"]["verdict"]


def test_a_seeker_that_is_mounted_off_the_survey_is_found_out(tmp_path: Path) -> None:
    """The product knows the survey, not where the simulator's x axis really points: the error is the difference."""
    off = BENCH.read_text().replace("{class: north}", "{class: north, seeker: {azimuth_sigma: 5 deg}}")
    procedure = SEEK.replace("times: 6", "times: 2")
    end = run_campaign(tmp_path, "r", procedure, write(tmp_path, "bench.yaml", off))
    truth = pd.read_csv(end.folder.parent / ".truth" / "r" / "truth.csv")
    (azimuth,) = [name for name in truth if name.startswith("azimuth_deg")]
    error_mil = (truth[azimuth].iloc[0] - 35.0) * 6000.0 / 360.0
    assert abs(error_mil) > 16.0
    document = json.loads((end.folder / "analyses" / "north.json").read_text())["SEEKER-1"]
    assert document["two_positions"]["rms_before_mil"] == pytest.approx(abs(error_mil), abs=5.0)
    assert end.outcome == "FAIL" and "mil is over its limit 8 mil" in end.message


def test_verify_seeks_again(run: Path) -> None:
    assert not verify(run).wrong, verify(run).wrong


def test_the_report_says_plainly_what_the_filter_does(run: Path) -> None:
    from bench.report.render import write_report

    page = write_report(run).read_text(encoding="utf-8")
    assert '<section id="north">' in page and "6000 mil to the circle" in page
    assert found_in(run)["two_positions"]["verdict"].split(":")[0] in page


def about(record: int, label: str, position: float | None, verdict: str = "pass") -> dict[str, Any]:
    return {"record": record, "label": label, "position_deg": position, "verdict": verdict}


def test_seekings_are_four_records_at_four_positions() -> None:
    made = [about(k, "seek" if k == 0 else f"seek-{k + 1}", 90.0 * (k % 4)) for k in range(8)]
    found = seekings_of([about(99, "still", None), *reversed(made)], "seek")
    assert [[one["record"] for one in four] for four in found] == [[0, 1, 2, 3], [4, 5, 6, 7]]
    made[2] = about(2, "seek-3", 180.0, "fail")
    with pytest.raises(NotSought, match="1 whole seekings"):
        seekings_of(made, "seek")


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("seek: seek,", "seek: sek,", r"there is no record 'sek'.*Did you mean seek"),
        ("180 deg, 270 deg]", "180 deg]", "no record 'seek' is made at 270 deg"),
    ],
)
def test_what_is_refused_before_hour_0(tmp_path: Path, wrong: str, right: str, message: str) -> None:
    procedure = write(tmp_path, "p.yaml", SEEK.replace(wrong, right))
    with pytest.raises(InvalidFiles, match=message):
        prepare(RunRequest(procedure, BENCH, tmp_path / "results", "r"))


def test_a_bench_that_was_not_surveyed_is_refused(tmp_path: Path) -> None:
    text = BENCH.read_text().replace(", azimuth: 35 deg}", "}", 1)
    bench = write(tmp_path, "bench.yaml", text)
    with pytest.raises(InvalidFiles, match=r"bench.yaml:\d+.*north seeking needs azimuth under 'site:'"):
        prepare(RunRequest(write(tmp_path, "p.yaml", SEEK), bench, tmp_path / "results", "r"))
