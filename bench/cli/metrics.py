"""fogbench metrics: the figures a laboratory must report, of any run, each with what it is and how well it is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option, table

if TYPE_CHECKING:
    from bench.certificate.gather import Calibrated

_HEADER = ["figure", "", "value", "unit", "95 %", "n", "at", "limit"]


@click.command("metrics")
@click.argument("run")
@click.option("--dut", help="Only this DUT.")
@click.option("--tables", is_flag=True, help="Also bias over temperature, and what the line leaves at every rate.")
@results_option
@json_option
def command(run: str, dut: str | None, tables: bool, results: Path, as_json: bool) -> None:
    """Print the calibration figures of RUN: value, limits for 95 %, definition, source.

    RUN is a run id or folder. A procedure with a calibration block says what is stated, and is judged by its limits. Of
    another run what its data allow: scale-factor figures of a grid of rates, bias stability and Allan coefficients of
    the longest record at rest.
    """
    from bench.certificate.gather import calibrated
    from bench.runfolder import find_run

    found = calibrated(find_run(run, results), dut)
    if as_json:
        print_json({"run_id": found.run_id, "asked": found.asked, "notes": found.notes, "duts": found.documents})
        return
    if not found.asked:
        click.echo(f"{found.run_id}: its procedure has no calibration block; this is what its data allow\n")
    for name, document in found.documents.items():
        _print(found, name, document)
        if tables:
            _tables(document["tables"])
    for note in found.notes:
        click.echo(f"not stated: {note}")


def _print(found: Calibrated, dut: str, document: Mapping[str, Any]) -> None:
    from bench.analyses.calibration_words import limits_of, value_of

    click.echo(f"{dut} of {found.run_id}")
    rows = [
        [
            one["symbol"],
            one["name"],
            value_of(one),
            one["unit"],
            limits_of(one),
            one["n"],
            one["at"],
            _judged(found, one),
        ]
        for one in document["figures"]
    ]
    click.echo(table(rows, _HEADER))
    click.echo("\nwhat they are:")
    for line in _definitions(document):
        click.echo(f"  {line}")
    for line in _records(document):
        click.echo(f"  {line}")
    conditions = document["conditions"]
    raw = conditions["raw_data"]
    click.echo(
        f"  outliers: {conditions['outlier_rule']}; gaps: {conditions['gap_rule']}; latitude "
        f"{_given(conditions['latitude_deg'], 'deg')}; raw data {raw['sha256'] or 'not kept'}\n"
    )


def _tables(tables: Mapping[str, Any]) -> None:
    from bench.analyses.calibration_words import polynomial_of

    biases = tables.get("bias_over_temperature")
    if biases:
        rows = [[f"{row[k]:.4g}" for k in ("temperature_degc", "bias_dph", "u_dph")] for row in biases["rows"]]
        click.echo(table(rows, ["DUT degC", "bias deg/h", "u deg/h"]))
        click.echo(f"{polynomial_of(biases)}\n")
    rates = tables.get("rates")
    if rates:
        rows = [
            [row["at"], f"{row['rate_dps']:g}", f"{row['full_scale_ppm']:.3g}", f"{row['reading_ppm']:.4g}"]
            for row in rates
        ]
        click.echo(table(rows, ["at", "rate deg/s", "residual ppm of full scale", "ppm of reading"]) + "\n")


def _judged(found: Calibrated, one: Mapping[str, Any]) -> str:
    limit = found.limits.get(one["symbol"])
    if limit is None:
        return ""
    value = one["value"]
    return f"{limit:g} {'pass' if value is not None and abs(value) <= limit else 'FAIL'}"


def _definitions(document: Mapping[str, Any]) -> Iterator[str]:
    """Definition and source of each symbol, as the first figure of it has them."""
    seen: set[str] = set()
    for one in document["figures"]:
        if one["symbol"] not in seen:
            seen.add(one["symbol"])
            yield f"{one['symbol']}: {one['definition']} [{one['source']}]"


def _records(document: Mapping[str, Any]) -> Iterator[str]:
    """What was done to each record, and how warm and how steady the DUT was meanwhile."""
    seen: set[str] = set()
    for one in document["figures"]:
        about = one["conditions"]
        if "record" in about and about["record"] not in seen:
            seen.add(about["record"])
            degc = about["dut_temperature_degc"]
            yield (
                f"record {about['record']}: {about['record_length_s']:.6g} s after {about['warm_up_cut_s']:g} s of "
                f"warm-up, DUT {degc['min']:.2f} to {degc['max']:.2f} degC, {degc['slope_degc_min']:+.2g} degC/min; "
                f"{about['outliers']} outliers, {about['frames_lost']} frames lost, "
                f"{about['rows_filled']} rows filled, {about['rows_cut']} cut off"
            )


def _given(value: float | None, unit: str) -> str:
    return "not known" if value is None else f"{value:g} {unit}"
