"""fogbench overview"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.options import results_option


@click.command("overview")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "-o", "--out", "out", type=click.Path(path_type=Path, dir_okay=False), help="The page; RESULTS/overview.html."
)
@click.option("--title", default="Results", show_default=True, help="Its title.")
@results_option
def command(runs: tuple[str, ...], out: Path | None, title: str, results: Path) -> None:
    """Put the results of RUN... (run folders or run ids) on one page, beside the published figures they repeat."""
    from bench.report.overview import write_overview
    from bench.runfolder import find_run

    path = out or results / "overview.html"
    write_overview([find_run(run, results) for run in runs], path, title)
    click.echo(f"page: {path}")
