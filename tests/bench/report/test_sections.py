"""Sections that only some runs have."""

from pathlib import Path

import pytest

from bench.report.data import read_run
from bench.report.render import render, write_report
from bench.report.sections import sections
from tests.bench.campaigns import run_campaign
from tests.bench.test_record import CYCLE


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_campaign(tmp_path_factory.mktemp("recorded"), "r", CYCLE).folder


def test_a_run_of_records_has_their_section_and_none_of_the_grid(recorded: Path) -> None:
    page = write_report(recorded).read_text(encoding="utf-8")
    assert '<section id="records">' in page and 'href="#records"' in page
    for anchor in ("surface", "residuals", "published"):
        assert f'id="{anchor}"' not in page and f'href="#{anchor}"' not in page
    assert "no point was measured" not in page and "Records made</dt><dd>3 of 3" in page


def test_every_record_is_in_the_table_and_drawn(recorded: Path) -> None:
    (section,) = sections(read_run(recorded))
    assert [row[0].text for row in section.tables[0].rows] == [
        label for label in ("cycle", "turning", "turning-2") for _ in range(2)
    ]
    assert len(section.figures) == 3 and not section.remarks


def test_a_series_that_cannot_be_read_is_remarked(recorded: Path) -> None:
    broken = recorded / "series" / "cycle-FOG-A01.parquet"
    whole = broken.read_bytes()
    broken.write_bytes(whole[: len(whole) // 2])
    try:
        (section,) = sections(read_run(recorded))
        assert len(section.figures) == 3 and "cycle-FOG-A01.parquet cannot be read" in section.remarks[0]
        assert "cannot be read" in render(read_run(recorded))
    finally:
        broken.write_bytes(whole)
