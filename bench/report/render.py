"""Run folder to report.html: read, draw, fill the template, put the file in place in one step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from bench.report import (
    figures,
    figures_campaign,
    figures_errors,
    figures_grid,
    figures_residuals,
    published,
    remarks,
    tables,
    tables_quality,
    tables_reference,
    wording,
)
from bench.report.data import DutData, ReportData, read_run
from bench.report.formats import count as counted
from bench.report.formats import duration, listed, ratio
from bench.report.residuals import ModelLoader
from bench.report.section import Section
from bench.report.sections import sections
from bench.runfolder import write_atomic

if TYPE_CHECKING:
    from jinja2 import Environment

REPORT_NAME = "report.html"


@dataclass(frozen=True)
class DutPictures:
    """The figures of one DUT; None where there is nothing to draw."""

    scores: figures.Figure | None
    surfaces: tuple[figures.Figure, ...]
    residuals: tuple[figures.Figure, ...]
    grid: tuple[figures.Figure, ...]
    z_scales: str


def write_report(run_dir: Path, load_model: ModelLoader | None = None) -> Path:
    """Write `run_dir`/report.html from what is on disk and return its path.

    The file holds everything it needs and opens no connection. `load_model` replaces fitting.modelfile.load_model.
    Raises UserMistake if `run_dir` is not a run folder; OSError if it cannot be written.
    """
    page = render(read_run(run_dir, load_model))
    path = run_dir / REPORT_NAME
    write_atomic(path, page.encode("utf-8"))
    return path


def render(data: ReportData) -> str:
    """The whole report as one HTML text; the same data give the same text."""
    grid = bool(data.manifest.points_planned) or any(len(dut.points) for dut in data.duts)
    with figures.style():
        extra = sections(data)
        pictures = [_pictures(dut, number) for number, dut in enumerate(data.duts)]
        campaign = [figure for figure in (figures_campaign.timeline(data), figures_campaign.one_dwell(data)) if figure]
    return (
        environment()
        .get_template("report.html.j2")
        .render(
            run=data,
            manifest=data.manifest,
            remarks=remarks,
            speed=ratio(data.manifest.duration_s, data.manifest.wall_s),
            started=tables_reference.started_words(data.manifest.started_utc),
            headlines=[line for line in map(tables.headline, data.duts) if line],
            duts=list(zip(data.duts, pictures, strict=True)),
            campaign=campaign,
            scores=[drawn.scores for drawn in pictures if drawn.scores],
            score_words=listed(
                [f"DUT {dut.name}" for dut, drawn in zip(data.duts, pictures, strict=True) if drawn.scores]
            ),
            tables=tables,
            quality=tables_quality,
            reference=tables_reference,
            published=published,
            terms=wording.TERMS,
            model_name=wording.model_name,
            grid=grid,
            sections=extra,
            contents=_contents(extra, grid),
            section_numbers=count(1),
            figure_numbers=count(1),
            table_numbers=count(1),
        )
    )


def environment() -> Environment:
    """The templates, with the filters they use."""
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("bench.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(duration=duration, count=counted, next=next)
    return made


def _contents(extra: Sequence[Section], grid: bool) -> list[tuple[str, str]]:
    """Anchor and title of every section of the page, in order."""
    of_grid = [("surface", "Error surface"), ("residuals", "Residuals"), ("published", "Published figures")]
    return [
        *([("result", "Result")] if grid or not extra else ()),
        ("campaign", "Campaign"),
        *((section.anchor, section.short) for section in extra),
        *(of_grid if grid else ()),
        ("quality", "Data quality"),
        ("provenance", "Provenance"),
        ("glossary", "Words"),
    ]


def _pictures(dut: DutData, number: int) -> DutPictures:
    return DutPictures(
        scores=figures_errors.model_scores(dut, f"scores{number}"),
        surfaces=tuple(_drawn(_surfaces(dut, number))),
        residuals=tuple(
            _drawn(
                [
                    figures_residuals.against_rate(dut, f"rate{number}"),
                    figures_residuals.against_temperature(dut, number, f"temperature{number}"),
                    figures_residuals.histogram(dut, number, f"histogram{number}"),
                    figures_residuals.magnitudes(dut, number, f"magnitude{number}"),
                ]
            )
        ),
        grid=tuple(
            _drawn([figures_grid.residual_map(dut, f"map{number}"), figures_grid.verdict_map(dut, f"verdict{number}")])
        ),
        z_scales=remarks.z_scales(
            *(figures_errors.surface_bound_dps(dut, column) for column in ("error_dps", "residual_dps"))
        ),
    )


def _surfaces(dut: DutData, number: int) -> list[figures.Figure | None]:
    return [
        figures_errors.error_surface(dut, "error_dps", f"before{number}"),
        figures_errors.error_surface(dut, "residual_dps", f"after{number}"),
    ]


def _drawn(found: list[figures.Figure | None]) -> Iterator[figures.Figure]:
    return (figure for figure in found if figure is not None)
