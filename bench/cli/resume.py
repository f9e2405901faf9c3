"""fogbench resume"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.options import json_option, junit_option, results_option


@click.command("resume")
@click.argument("run")
@click.option(
    "--accept",
    multiple=True,
    type=click.Choice(["procedure", "bench"]),
    help="Go on with a file that changed since the run began, if only steps not yet run change.",
)
@click.option(
    "--missing",
    is_flag=True,
    help="Of a run that came to its end, measure what it lacks: points of a DUT that was lost, points that failed.",
)
@click.option(
    "--after",
    metavar="TIME",
    help="Of a virtual bench: how long it stood since, e.g. '1 h'; its faults and its cooling go on for as long.",
)
@results_option
@json_option
@junit_option
def command(
    run: str,
    accept: tuple[str, ...],
    missing: bool,
    after: str | None,
    results: Path,
    as_json: bool,
    junit: Path | None,
) -> None:
    """Take RUN up again after an abort, a failure, a crash or a power cut.

    Finished points are kept and never measured again; an acquisition that was broken off is dropped. The bench is
    brought back to its setpoints; a soak goes on only if the gap was short and the DUTs stayed as warm as they were
    (the procedure's resume: block), else it starts over.

    With --missing only the temperatures and rates are visited where a DUT lacks a point, and only such DUTs are
    connected to. A point measured anew replaces one that failed; points that did not fail are never measured twice.
    """
    from bench.cli.run import carry_out
    from bench.junit import junit_file
    from bench.resume import prepare_resume
    from bench.runfolder import find_run

    with junit_file(junit, Path(run).name) as file:
        carry_out(prepare_resume(find_run(run, results), accept, missing, _seconds(after)), as_json, file)


def _seconds(after: str | None) -> float | None:
    from bench.errors import UserMistake
    from bench.units import parse_quantity

    try:
        seconds = None if after is None else parse_quantity(after, "s")
    except ValueError as error:
        raise UserMistake(f"--after {after}: {error}") from error
    if seconds is not None and seconds < 0:
        raise UserMistake(f"--after {after}: a time that has passed is not negative.")
    return seconds
