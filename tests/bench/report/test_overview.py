"""Several runs on one page."""

from pathlib import Path

from click.testing import CliRunner

from bench.cli.overview import command
from tests.bench.analyses.test_cycles import CYCLES
from tests.bench.campaigns import run_campaign


def test_every_run_has_a_chapter_with_what_it_found(tmp_path: Path) -> None:
    grid = run_campaign(tmp_path, "grid")
    cycles = run_campaign(tmp_path, "cycles", CYCLES)
    arguments = [str(grid.folder), "cycles", "--results", str(tmp_path / "results"), "--title", "Both <runs>"]
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "results" / "overview.html").read_text(encoding="utf-8")
    assert "<h1>Both &lt;runs&gt;</h1>" in page and "Virtual bench." in page
    assert 'id="run-0"' in page and 'id="run-1"' in page
    assert "lag_bank" in page and cycles.message.split(";")[0] in page and grid.message in page
    # the same figure drawn for two DUTs, and in two runs, keeps its ids apart
    assert 'id="r1-cycles0-' in page and page.count('id="r1-cycles0-') == len(set(ids(page, "r1-cycles0-")))
    assert cycles.folder.name in page


def ids(page: str, start: str) -> list[str]:
    return [part.split('"')[0] for part in page.split(f'id="{start}')[1:]]


def test_a_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    done = CliRunner().invoke(command, [str(tmp_path / "nothing")])
    assert done.exit_code != 0 and "neither a run folder nor a run id" in str(done.exception)
