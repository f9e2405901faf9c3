"""fogbench export"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option, table

if TYPE_CHECKING:
    from bench.exporting import Written


@click.command("export")
@click.argument("run", required=False)
@click.option("--dut", metavar="DUT", help="Of this gyro only.")
@click.option("--model", metavar="NAME", help="This model only.")
@click.option("--file", "model_file", type=click.Path(path_type=Path), help="A model file in place of RUN.")
@click.option("--to", "target", type=click.Choice(["c", "csv", "json"]), default="c", show_default=True)
@click.option("--precision", type=click.Choice(["double", "float"]), default="double", show_default=True, help="Of C.")
@click.option(
    "-o", "folder", type=click.Path(path_type=Path, file_okay=False), default=".", show_default=True, help="Where to."
)
@results_option
@json_option
def command(
    run: str | None,
    dut: str | None,
    model: str | None,
    model_file: Path | None,
    target: str,
    precision: str,
    folder: Path,
    results: Path,
    as_json: bool,
) -> None:
    """Write the models of RUN (a run folder or run id) for other programs, and say what each one costs.

    \b
    c     a header and a source of C99 for the gyro's own processor, with a guard for rows outside the
          training range and a self-test; nothing but math.h is needed
    csv   a table of all coefficients, with names and units
    json  the model file itself, which 'fogbench compensate' reads
    """
    from bench.exporting import models_of, one_model, write_model

    found = one_model(run, model_file) if model_file else models_of(run, dut, model, results)
    # Asked for by name, a model that cannot be exported is a mistake; among all models of a run it is a line.
    written = [write_model(one, target, precision, folder, strict=len(found) == 1) for one in found]
    if as_json:
        print_json([one.as_dict() for one in written])
    else:
        _show(written)


def _show(written: list[Written]) -> None:
    header = ["DUT", "model", "file", "numbers", "bytes", "object", "+ -", "*", "/", "exp etc.", "compares", "rounding"]
    click.echo(table([_row(one) for one in written], header))
    for one in written:
        if one.refused:
            click.echo(f"{one.dut} {one.model}: {one.refused}")
    if any(one.cost for one in written):
        click.echo(
            "bytes: of the coefficients; object: code and coefficients for this computer, -Os, without the self-test; "
            "rounding: most that the self-test allows, in the output's unit"
        )


def _row(one: Written) -> list[Any]:
    if one.cost is None:
        return [one.dut, one.model, one.path or "–", *["–"] * 9]
    cost = one.cost
    size = "–" if cost.object_bytes is None else cost.object_bytes
    return [
        one.dut, one.model, one.path, cost.coefficients, cost.coefficient_bytes, size, *cost.operations.counts(),
        f"{cost.rounding:.1e} {cost.unit}",
    ]  # fmt: skip
