"""fogbench fit"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option


@click.command("fit")
@click.argument("run")
@click.option("--model", "models", multiple=True, metavar="NAME", help="Fit these models instead of the procedure's.")
@results_option
@json_option
def command(run: str, models: tuple[str, ...], results: Path, as_json: bool) -> None:
    """Fit models to the points of RUN (a run folder or run id) again; writes models/, metrics.json and the report."""
    from bench.cli.run import show, summary
    from bench.refit import refit
    from bench.report.render import write_report
    from bench.runfolder import find_run

    end = refit(find_run(run, results), models, write_report)
    if as_json:
        print_json(summary(end))
    else:
        show(end)
    raise SystemExit(int(end.exit_code))
