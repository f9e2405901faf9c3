"""Progress lines: what a lab engineer reads while it runs, and the ETA from the rehearsal."""

from pathlib import Path

import pytest

from bench.cli.progress import ProgressPrinter
from bench.engine import Progress, Readbacks
from bench.run import RunRequest, prepare
from tests.bench.campaigns import GRID, VIRTUAL, write


def test_lines_tell_point_setpoints_readbacks_and_eta(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prepared = prepare(RunRequest(write(tmp_path, "p.yaml", GRID), VIRTUAL, tmp_path / "results", "x"))
    printer = ProgressPrinter(prepared, quiet=False)
    printer.begin()
    plan, ends = prepared.checked.plan, prepared.forecast.ends_s
    first_of_dwell = next(step for step in plan if step.dwell == 2)
    now = Readbacks(0.0, 10.0, 9.6, 50.0, 49.999, {"FOG-A01": 12.34})
    halfway = next(step for step in plan if step.point == 3)
    printer.tell(Progress(halfway, len(plan), True, ends[halfway.number - 1], now))
    printer.tell(Progress(first_of_dwell, len(plan), False, ends[first_of_dwell.number - 2], now))
    lines = capsys.readouterr().err.splitlines()
    assert "28 points of 2 DUTs" in lines[0] and "VIRTUAL" in lines[0]
    line = lines[-1]
    for words in ("point 3/28", "chamber 9.6/10 degC", "table 49.999/50 deg/s", "FOG-A01 12.34 degC", "ETA"):
        assert words in line
    remaining = prepared.forecast.duration_s - ends[first_of_dwell.number - 2]
    assert prepared.forecast.remaining_s(first_of_dwell.number, 0.0) == pytest.approx(remaining)


def test_quiet_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prepared = prepare(RunRequest(write(tmp_path, "p.yaml", GRID), VIRTUAL, tmp_path / "results", "x"))
    printer = ProgressPrinter(prepared, quiet=True)
    printer.begin()
    for step in prepared.checked.plan[:20]:
        printer.tell(Progress(step, 99, True, 1.0, Readbacks()))
    printer.end()
    assert capsys.readouterr().err == ""
