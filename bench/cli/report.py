"""fogbench report"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option


@click.command("report")
@click.argument("run")
@results_option
@json_option
def command(run: str, results: Path, as_json: bool) -> None:
    """Write report.html of RUN (a run folder or run id) again, from what is on disk."""
    from bench.refit import complete
    from bench.report.render import write_report
    from bench.runfolder import find_run

    folder = find_run(run, results)
    complete(folder)
    path = write_report(folder)
    if as_json:
        print_json({"report": str(path)})
    else:
        click.echo(f"report: {path}")
