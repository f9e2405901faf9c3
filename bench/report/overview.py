"""Several runs on one page: what each reached, beside what was published; their own reports have the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from bench.report import figures, published, tables, tables_reference
from bench.report.data import ReportData, read_run
from bench.report.formats import duration, listed, ratio
from bench.report.render import environment
from bench.report.section import Section
from bench.report.sections import sections
from bench.report.tables import Cell, Column, Table, table
from bench.runfolder import write_atomic

# Every seeking and every row is in the run's own report.
LEFT_OUT = ("records",)


@dataclass(frozen=True)
class Chapter:
    """One run: its title, how it ended, and what it found."""

    anchor: str
    name: str
    title: str
    outcome: str
    message: str
    about: str
    parts: tuple[Section, ...]


def write_overview(folders: Sequence[Path], path: Path, title: str) -> None:
    """Write the page. Raises UserMistake for a folder that is no run, OSError if it cannot be written."""
    runs = [read_run(folder) for folder in folders]
    with figures.style():
        chapters = [_chapter(run, number) for number, run in enumerate(runs)]
    page = (
        environment()
        .get_template("overview.html.j2")
        .render(
            title=title,
            version=runs[0].manifest.versions.get("fogbench", "") if runs else "",
            virtual=all(run.manifest.virtual for run in runs),
            summary=_summary(runs),
            chapters=chapters,
            figure_numbers=count(1),
            table_numbers=count(1),
        )
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, page.encode("utf-8"))


def _summary(runs: Sequence[ReportData]) -> Table:
    columns = [Column("Run", False), Column("Outcome", False), Column("DUTs", False), Column("Bench time", False)]
    columns += [Column("Wall time", False), Column("× real time"), Column("Limits kept", False)]
    rows: list[list[str | Cell]] = []
    for run in runs:
        m = run.manifest
        kept = f"{sum(bool(limit.passed) for limit in m.limits)} of {len(m.limits)}" if m.limits else "none set"
        outcome = Cell(m.outcome, kind="good" if m.outcome == "PASS" else "bad")
        times = [duration(m.duration_s), duration(m.wall_s), ratio(m.duration_s, m.wall_s)]
        rows.append([m.run_id, outcome, listed([dut.name for dut in run.duts]), *times, kept])
    return table("The runs of this page.", columns, rows)


def _chapter(run: ReportData, number: int) -> Chapter:
    m = run.manifest
    parts = [section for section in sections(run) if section.anchor not in LEFT_OUT]
    # Names of figures are ids of the page; two runs may draw figures of one name.
    parts = [replace(part, figures=tuple(_apart(one, number) for one in part.figures)) for part in parts]
    parts += _grid(run)
    about = f"Seed {m.seed}; {duration(m.duration_s)} of bench time." if m.virtual else ""
    message = m.message or m.outcome
    return Chapter(
        f"run-{number}", m.procedure.name or m.run_id, m.procedure.title, m.outcome, message, about, tuple(parts)
    )


def _apart(figure: figures.Figure, number: int) -> figures.Figure:
    svg = figure.svg
    for mark in ('id="', 'href="#', "url(#"):
        svg = svg.replace(mark, f"{mark}r{number}-")
    return replace(figure, svg=svg)


def _grid(run: ReportData) -> list[Section]:
    """Tables of a temperature x rate grid: results of each DUT, then the published figures."""
    duts = [dut for dut in run.duts if dut.metrics]
    if not duts:
        return []
    shown = [tables.results(dut) for dut in duts]
    remarks: tuple[str, ...] = ()
    if run.manifest.procedure.experiment == published.EXPERIMENT:
        shown += tables_reference.published_tables(run)
        remarks = tuple(tables_reference.published_notes(run))
    return [Section("grid", "Grid", tables=tuple(shown), remarks=remarks)]
