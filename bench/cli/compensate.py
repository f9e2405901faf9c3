"""fogbench compensate"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option


@click.command("compensate")
@click.argument("model", metavar="MODEL|RUN")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="The CSV to write.")
@click.option(
    "--map", "columns", multiple=True, metavar="INPUT=COLUMN,...", help="Which columns of FILE the model's inputs are."
)
@click.option(
    "--period",
    "period_s",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Between rows of FILE, for models of thermal history; without it, as in their training.",
)
@click.option("--dut", metavar="DUT", help="Of RUN: this gyro.")
@click.option("--model", "name", metavar="NAME", help="Of RUN: this model.")
@results_option
@json_option
def command(
    model: str,
    file: Path,
    out: Path,
    columns: tuple[str, ...],
    period_s: float | None,
    dut: str | None,
    name: str | None,
    results: Path,
    as_json: bool,
) -> None:
    """Compensate the rates of FILE (CSV or Parquet) with a model file, or with a model of a run.

    Writes a copy with two more columns: compensated_dps, and guarded, 1 where a row is outside the range that the
    model was trained in (its temperature is then held at the edge) or has a value missing (it stays nan).

    Columns are found by the names of the model's inputs, with or without unit (temperature or temperature_degc, rate
    or rate_dps), then by the names of those it was fitted to; --map temperature=T_coil,rate=omega says others.
    """
    from bench.exporting import load, the_model
    from bench.userdata.compensate import compensate_file

    compensation = load(the_model(model, dut, name, results))
    done = compensate_file(compensation, file, columns, out, period_s)
    if as_json:
        print_json(done.as_dict())
        return
    counts = done.counts
    taken = ", ".join(f"{name} from '{column}'" for name, column in done.columns.items())
    click.echo(f"{file}: {counts.rows} rows; {taken}")
    share = f" ({100.0 * counts.outside / counts.rows:.2g} %)" if counts.outside else ""
    click.echo(f"outside the training range, guarded: {counts.outside}{share}")
    click.echo(f"a value missing, left as nan: {counts.missing}")
    click.echo(f"written: {out}")
