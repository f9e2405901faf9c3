"""The commands as typed: what they print, their exit codes, --json."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.cli.main import main
from bench.errors import ExitCode
from tests.bench.campaigns import GRID, ROOT, VIRTUAL, write

SHORT = """\
procedure: short
raw: samples
quality: {slope: 5 degC/min}
steps:
  - sweep:
      rate: {from: -100 deg/s, to: 100 deg/s, step: 50 deg/s}
      steps:
        - settle: {band: 0.02 deg/s, for: 0.5 s, timeout: 30 s}
        - acquire: {count: 20, every: 0.2 s}
analysis: {models: [linear], splits: {random: {train: 3}}}
"""

Typed = tuple[int, str, str]


@pytest.fixture
def fogbench(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., Typed]:
    def typed(*arguments: Any) -> Typed:
        monkeypatch.setattr(sys, "argv", ["fogbench", *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as left:
            main()
        printed = capsys.readouterr()
        return int(left.value.code or 0), printed.out, printed.err

    return typed


def test_help_says_what_the_exit_codes_are(fogbench: Callable[..., Typed]) -> None:
    code, out, _ = fogbench("--help")
    assert code == 0
    for command in ("check", "dry-run", "run", "fit", "report", "list", "schema"):
        assert command in out
    for number in ("0 ", "1 ", "2 ", "3 ", "130"):
        assert number in out


def test_check_says_what_a_run_takes(fogbench: Callable[..., Typed], tmp_path: Path) -> None:
    path = ROOT / "procedures" / "temperature_rate_grid.yaml"
    code, out, _ = fogbench("check", path, "--bench", VIRTUAL)
    assert code == 0 and "703 points of 2 DUTs" in out and "6 d 13 h" in out
    code, out, _ = fogbench("check", path, "--bench", VIRTUAL, "--json")
    (summary,) = json.loads(out)
    assert summary["points"] == 703 and summary["virtual"] and summary["duration_s"] > 155 * 3600
    assert list(tmp_path.iterdir()) == []


def test_check_reports_all_mistakes_of_all_files_with_their_places(
    fogbench: Callable[..., Typed], tmp_path: Path
) -> None:
    one = write(tmp_path, "one.yaml", GRID.replace("soak: 10 min", "soak: 10 deg/s"))
    two = write(tmp_path, "two.yaml", GRID.replace("settle", "setle").replace("to: 30 degC", "to: 99 degC"))
    code, _, err = fogbench("check", one, two, "--bench", VIRTUAL)
    assert code == ExitCode.USER_MISTAKE
    assert f"{one}:9:17:" in err and f"{two}:13:17:" in err and "Did you mean settle?" in err
    code, out, _ = fogbench("check", one, two, "--bench", VIRTUAL, "--json")
    assert code == ExitCode.USER_MISTAKE
    assert {problem["line"] for problem in json.loads(out)["problems"]} >= {9, 13}


def test_dry_run_of_a_real_bench_touches_no_port(fogbench: Callable[..., Typed], tmp_path: Path) -> None:
    procedure = write(tmp_path, "p.yaml", SHORT)
    lab = ROOT / "benches" / "lab_example.yaml"
    code, out, _ = fogbench("dry-run", procedure, "--bench", lab, "--json")
    forecast = json.loads(out)
    assert code == 0 and forecast["failure"] is None and forecast["points"] == 5
    assert 5 * 4 < forecast["duration_s"] < 5 * 15
    code, out, _ = fogbench("dry-run", procedure, "--bench", lab)
    assert code == 0 and "No port was opened" in out
    assert [path.name for path in tmp_path.iterdir()] == ["p.yaml"]


def test_dry_run_says_what_would_go_wrong(fogbench: Callable[..., Typed], tmp_path: Path) -> None:
    impatient = write(tmp_path, "p.yaml", SHORT.replace("timeout: 30 s", "timeout: 0.6 s"))
    code, _, err = fogbench("dry-run", impatient, "--bench", VIRTUAL)
    assert code == ExitCode.BENCH_FAILED
    assert "this would go wrong" in err and "p.yaml:8:11" in err


def test_run_fit_report_list(fogbench: Callable[..., Typed], tmp_path: Path) -> None:
    procedure = write(tmp_path, "p.yaml", SHORT)
    code, out, err = fogbench("run", procedure, "--bench", VIRTUAL, "--run-id", "first", "--seed", "3")
    folder = tmp_path / "results" / "first"
    # one temperature cannot be left out, so what was asked for was not all measured
    assert code == ExitCode.FAILED and "FAIL" in out and "temperatures left out" in out, err
    assert (folder / "report.html").is_file() and "report.html" in out
    assert "VIRTUAL bench" in err and "5 points of 2 DUTs" in err and "by rehearsal" in err

    before = (folder / "points.csv").read_bytes()
    (folder / "points.csv").unlink()
    code, out, _ = fogbench("fit", "first", "--model", "linear", "--json")
    assert set(json.loads(out)["metrics"]["FOG-A01"]) == {"none", "linear"}
    assert (folder / "points.csv").read_bytes() == before

    (folder / "report.html").unlink()
    code, out, _ = fogbench("report", folder)
    assert code == 0 and (folder / "report.html").is_file()

    code, out, _ = fogbench("list")
    assert code == 0 and "first" in out and "FAIL" in out and "5/5" in out
    code, out, _ = fogbench("list", "--json")
    assert [run["run_id"] for run in json.loads(out)] == ["first"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fit", "nothing"], "neither a run folder nor a run id"),
        (["report", "../etc"], "neither a run folder nor a run id"),
        (["fit", "nothing", "--model"], "requires an argument"),
        (["run", "p.yaml"], "--bench"),
        (["frobnicate"], "No such command"),
        (["check", "absent.yaml", "--bench", str(VIRTUAL)], "absent.yaml: cannot be read"),
        (["check", "absent.yaml", "--bench", str(VIRTUAL), "--set", "x=1"], "'procedure.' or 'bench.'"),
    ],
)
def test_mistakes_on_the_command_line_exit_with_2(
    fogbench: Callable[..., Typed], arguments: list[str], words: str
) -> None:
    code, _, err = fogbench(*arguments)
    assert code == ExitCode.USER_MISTAKE
    assert words in err and "Traceback" not in err


def test_a_full_or_broken_disk_is_not_a_failed_limit(
    fogbench: Callable[..., Typed], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import bench.conclude

    def broken(*arguments: Any, **options: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bench.conclude, "write_points", broken)
    code, _, err = fogbench("run", write(tmp_path, "p.yaml", SHORT), "--bench", VIRTUAL, "--run-id", "full")
    assert code == ExitCode.BENCH_FAILED and "No space left on device" in err
    assert (tmp_path / "results" / "full" / "journal.jsonl").is_file()


@pytest.mark.parametrize("kind", ["procedure", "bench"])
def test_schemas_are_json(fogbench: Callable[..., Typed], kind: str) -> None:
    code, out, _ = fogbench("schema", kind)
    assert code == 0 and json.loads(out)["$schema"].startswith("https://json-schema.org/")


def test_no_color_and_no_terminal_mean_plain_text(
    fogbench: Callable[..., Typed], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    _, out, err = fogbench("run", write(tmp_path, "p.yaml", SHORT), "--bench", VIRTUAL, "--run-id", "plain")
    assert "\x1b" not in out + err
