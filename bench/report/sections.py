"""Sections that only some runs have: each is made by a function of what was read, or left out."""

from __future__ import annotations

from collections.abc import Callable

from bench.report.data import ReportData
from bench.report.section import Section

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
