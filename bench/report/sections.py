"""Sections that only some runs have: each is made by a function of what was read, or left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.report.data import ReportData
from bench.report.figures import Figure
from bench.report.tables import Table


@dataclass(frozen=True)
class Section:
    """One section between the campaign and the data quality: paragraphs, tables, figures, then remarks as a list.

    `anchor` is its place in the page, `short` what the list of contents calls it (the title if empty).
    """

    anchor: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    remarks: tuple[str, ...] = ()
    label: str = ""

    @property
    def short(self) -> str:
        """What the list of contents calls it."""
        return self.label or self.title


Maker = Callable[[ReportData], Section | None]


def makers() -> tuple[Maker, ...]:
    """The functions that make sections, in the order of the page."""
    from bench.report.section_calibration import calibration
    from bench.report.section_cycles import cycles
    from bench.report.section_north import north
    from bench.report.section_records import records

    return (records, calibration, cycles, north)


def sections(data: ReportData) -> list[Section]:
    """The sections this run has."""
    made = (make(data) for make in makers())
    return [section for section in made if section is not None]
