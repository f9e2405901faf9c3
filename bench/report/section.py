"""A section of the report that only some runs have."""

from __future__ import annotations

from dataclasses import dataclass

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
