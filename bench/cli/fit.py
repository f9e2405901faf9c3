"""fogbench fit"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option, table
from bench.errors import UserMistake

if TYPE_CHECKING:
    from bench.userdata.fit import Outcome


@click.command("fit")
@click.argument("what", metavar="RUN|DATA")
@click.option("--model", "models", multiple=True, metavar="NAME", help="Fit these models instead of the procedure's.")
@click.option(
    "--map",
    "columns",
    multiple=True,
    metavar="QUANTITY=COLUMN,...",
    help="Of DATA: which columns hold temperature (several: T1+T2), rate, truth (or a number), group and time.",
)
@click.option("-o", "out", type=click.Path(path_type=Path, dir_okay=False), help="Of DATA: the model file to write.")
@results_option
@json_option
def command(
    what: str, models: tuple[str, ...], columns: tuple[str, ...], out: Path | None, results: Path, as_json: bool
) -> None:
    """Fit models to the points of RUN (a run folder or run id) again, or one model to DATA, a CSV or Parquet file.

    \b
    RUN   writes models/, metrics.json and the report
    DATA  writes the model file given by -o. Rates are in deg/s, temperatures in degC. truth=COL is the true
          rate, and the model gives it; truth=0 says that the gyro was at rest, and the model gives its error.
          Rows of one group (a dwell, a cycle) are held back together when the model is judged.
          time=COL, in s and even, lets the model of a gyro at rest look at the history of its temperature.
    """
    from bench.userdata.tables import is_table

    if is_table(Path(what)):
        if out is None:
            raise UserMistake(f"{what}: where shall the model go? Say -o MODEL.json")
        _fit_data(Path(what), columns, models, out, as_json)
    else:
        if columns or out is not None:
            raise UserMistake(f"'{what}' is no .csv or .parquet file; --map and -o are for these, not for runs.")
        _fit_run(what, models, results, as_json)


def _fit_run(run: str, models: tuple[str, ...], results: Path, as_json: bool) -> None:
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


def _fit_data(path: Path, columns: tuple[str, ...], models: tuple[str, ...], out: Path, as_json: bool) -> None:
    from bench.userdata.fit import fit_recording

    outcome = fit_recording(path, columns, models, out)
    if as_json:
        print_json(outcome.as_dict())
    else:
        _show(outcome)


def _show(outcome: Outcome) -> None:
    recording = outcome.recording
    dropped = ", ".join(f"{count} without {name}" for name, count in recording.missing.items())
    lost = recording.rows - len(recording.target)
    click.echo(f"{recording.path}: {recording.rows} rows" + (f", {lost} left out ({dropped})" if lost else ""))
    held = "whole groups left out" if recording.groups is not None else "stretches of rows left out"
    click.echo(f"Errors, deg/s: of all rows before, of held-back rows after (random rows, and {held})")
    before = [f"{outcome.before.max_abs_dps:.3g}", f"{outcome.before.std_dps:.3g}"]
    rows = [["none", *before, "–", "–"]]
    for one in outcome.models:
        figures = [one.judged[split] for split in ("random", "left_out")]
        rows.append([one.name, *(f"{value:.3g}" for one in figures for value in (one.max_abs_dps, one.std_dps))])
    rows[0] = ["none (before)", *before, *before]
    click.echo(table(rows, ["model", "max|e| random", "std random", "max|e| left out", "std left out"]))
    for note in outcome.notes:
        click.echo(note)
    click.echo(f"model: {outcome.path} ({outcome.models[0].name})")
