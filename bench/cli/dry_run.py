"""fogbench dry-run"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.main import print_json
from bench.cli.options import bench_option, existing_file, json_option, seed_option, set_option, table
from bench.errors import BenchFailure, ExitCode


@click.command("dry-run")
@click.argument("procedure", type=existing_file)
@bench_option
@seed_option
@set_option
@json_option
def command(procedure: Path, bench_path: Path, seed: int | None, settings: tuple[str, ...], as_json: bool) -> None:
    """Rehearse PROCEDURE with engine and drivers in virtual time, a simulator under each driver of the bench.

    Real ports are not touched. Says what will happen, when, and what would go wrong.
    """
    from bench.check import check
    from bench.clock import stopwatch
    from bench.composition import seed_of
    from bench.forecast import rehearse
    from bench.overrides import parse_overrides
    from bench.timeline import phases, remarks
    from bench.units import format_duration

    began = stopwatch()
    checked = check(procedure, bench_path, parse_overrides(settings))
    forecast = rehearse(checked, seed if seed is not None else seed_of(checked.bench))
    listed = phases(checked.plan, forecast.ends_s)
    limits_hit = remarks(checked.plan, forecast.ends_s)
    if as_json:
        print_json(
            {
                "duration_s": forecast.duration_s,
                "steps": len(checked.plan),
                "points": checked.points,
                "warnings": [*forecast.warnings, *limits_hit],
                "failure": forecast.failure,
                "timeline": [phase.as_dict() for phase in listed],
            }
        )
    else:
        click.echo(table([phase.row() for phase in listed], ["from", "until", "chamber", "what", "points"]))
        for warning in [*forecast.warnings, *limits_hit]:
            click.echo(f"warning: {warning}")
        click.echo(
            f"\n{checked.head.procedure} on {checked.bench.file.bench}: {len(forecast.ends_s)} of {len(checked.plan)} "
            f"steps rehearsed, {format_duration(forecast.duration_s)} of bench time (in {stopwatch() - began:.1f} s). "
            "No port was opened and nothing was written."
        )
    if forecast.failure:
        error = BenchFailure(f"this would go wrong: {forecast.failure}")
        if as_json:
            raise SystemExit(int(ExitCode.BENCH_FAILED))
        raise error
