"""fogbench allan: overlapping Allan deviation, noise coefficients and plot, of a file or of a record of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option, table

if TYPE_CHECKING:
    from bench.allan.read import Rates
    from fitting.random_errors.allan import AllanCurve
    from fitting.random_errors.allan_fit import AllanFit

_SHOWN_PER_DECADE = 3


@click.command("allan")
@click.argument("source", metavar="FILE-OR-RUN")
@click.option("--column", help="Which column of the file, or rate of the record (default rate_dps).")
@click.option("--rate", help="Samples per second of a file, e.g. 100 or '1 kHz'.")
@click.option("--every", help="Time between samples of a file instead, e.g. '10 ms'.")
@click.option("--unit", default="deg/h", show_default=True, help="Unit of the rates in a file: deg/h, deg/s, rad/s …")
@click.option("--dut", help="Only this DUT of a run.")
@click.option("--record", help="Which record of a run; the longest if left out.")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Where the plot goes (SVG).")
@results_option
@json_option
def command(
    source: str,
    column: str | None,
    rate: str | None,
    every: str | None,
    unit: str,
    dut: str | None,
    record: str | None,
    output: Path | None,
    results: Path,
    as_json: bool,
) -> None:
    """Overlapping Allan deviation of a FILE (csv, txt, parquet, npy) or of a record at rest of a RUN.

    Prints the curve with limits for 95 %; the coefficients Q, N, B, K, R of the fit with theirs; and, on a line of its
    own, the minimum of the curve, which is not B. Missing samples (nan) are left out, never closed up.
    """
    from bench.allan.read import interval_of, is_recording, read_file, read_run
    from bench.errors import UserMistake
    from bench.runfolder import find_run

    if output is not None and output.suffix.lower() != ".svg":
        raise UserMistake(f"{output}: the plot is an SVG file; give a name that ends in .svg")
    if is_recording(source):
        if dut or record:
            raise UserMistake(f"--dut and --record are of a run; {source} is a file.")
        rates = [read_file(Path(source), column, interval_of(rate, every), unit)]
    else:
        if rate or every:
            raise UserMistake("--rate and --every are of a file; a run knows its own.")
        rates = read_run(find_run(source, results), dut, record, column)
    made = [(one, *_fitted(one)) for one in rates]
    if output is not None:
        _draw(made, output)
    if as_json:
        print_json([_document(*one) for one in made])
        return
    for one in made:
        _print(*one)
    if output is not None:
        click.echo(f"plot: {output}")


def _fitted(rates: Rates) -> tuple[AllanCurve, AllanFit]:
    from bench.errors import UserMistake
    from fitting.random_errors.allan import allan_curve
    from fitting.random_errors.allan_fit import fit_allan

    try:
        curve = allan_curve(rates.rate_dph, rates.every_s)
        return curve, fit_allan(curve)
    except ValueError as error:
        raise UserMistake(f"{rates.title}: {error}") from error


def _document(rates: Rates, curve: AllanCurve, fit: AllanFit) -> dict[str, Any]:
    from bench.analyses.calibration_parts import allan_table
    from fitting.metrics.allan_figures import allan_figures

    figures = [figure.record() for figure in allan_figures(fit, curve.samples)]
    about = {"title": rates.title, "samples": curve.samples, "missing": curve.missing, "outliers": rates.outliers}
    return about | {"every_s": rates.every_s, "figures": figures, "curve": allan_table("", curve, fit)}


def _draw(made: list[tuple[Rates, AllanCurve, AllanFit]], output: Path) -> None:
    from bench.analyses.calibration_parts import allan_table
    from bench.report.figures_allan import standalone
    from bench.runfolder import write_atomic

    output.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(output, standalone([(one.title, allan_table("", curve, fit)) for one, curve, fit in made]))


def _print(rates: Rates, curve: AllanCurve, fit: AllanFit) -> None:
    from bench.units import format_duration

    length = format_duration(curve.samples * rates.every_s)
    click.echo(f"{rates.title}: {curve.samples} samples every {rates.every_s:g} s, {length}")
    if curve.missing:
        click.echo(
            f"{curve.missing} samples are missing ({rates.outliers} of them outliers): differences that touch one are "
            "left out, and gaps stay open"
        )
    step = max(1, round(len(curve.factors) / (_SHOWN_PER_DECADE * 6)))
    rows = [
        [f"{tau:.4g}", f"{deviation:.4g}", f"{low:.4g}", f"{high:.4g}", count]
        for tau, deviation, low, high, count in zip(
            curve.tau_s[::step],
            curve.deviation_dph[::step],
            curve.low_dph[::step],
            curve.high_dph[::step],
            curve.differences[::step].tolist(),
            strict=True,
        )
    ]
    click.echo(table(rows, ["tau s", "deviation deg/h", "low", "high", "differences"]))
    click.echo(f"\ncoefficients of the fit, limits for {100 * fit.coverage:g} %:")
    for line in _coefficients(fit):
        click.echo(f"  {line}")
    low = fit.minimum
    last = "; the longest time of this record: it may go on falling" if low.tau_s >= curve.tau_s[-1] else ""
    click.echo(
        f"Allan minimum: {low.deviation_dph:.4g} deg/h at {low.tau_s:.4g} s ({low.low_dph:.4g} to {low.high_dph:.4g}); "
        f"not the bias instability B{last}\n"
    )


def _coefficients(fit: AllanFit) -> list[str]:
    lines = []
    for one in fit.coefficients:
        what = f"{one.symbol}  {one.name:<18}"
        if one.claimed:
            lines.append(f"{what} {one.value:.4g} {one.unit} ({one.low:.4g} to {one.high:.4g})")
        else:
            lines.append(f"{what} below {one.high:.4g} {one.unit}: the record does not need this term")
    return lines
