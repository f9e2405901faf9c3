"""fogbench check"""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.main import print_json
from bench.cli.options import bench_option, existing_file, json_option, set_option
from bench.errors import InvalidFiles


@click.command("check")
@click.argument("procedures", nargs=-1, required=True, type=existing_file)
@bench_option
@set_option
@json_option
def command(procedures: tuple[Path, ...], bench_path: Path, settings: tuple[str, ...], as_json: bool) -> None:
    """Find every mistake in PROCEDURES and a bench file at once, and say what a run takes. Touches no hardware.

    The duration is a sum of stated times; `fogbench dry-run` rehearses the procedure and knows better.
    """
    from bench.check import check
    from bench.overrides import parse_overrides
    from bench.units import format_duration

    overrides = parse_overrides(settings)
    problems, summaries = [], []
    for path in procedures:
        try:
            checked = check(path, bench_path, overrides)
        except InvalidFiles as error:
            problems += error.problems
            continue
        points, duts = checked.points, len(checked.bench.duts)
        summaries.append(
            {
                "procedure": str(path),
                "bench": str(bench_path),
                "virtual": checked.bench.virtual,
                "steps": len(checked.plan),
                "points": points,
                "duts": duts,
                "duration_s": checked.duration_s,
                "disk_bytes": checked.disk_bytes,
            }
        )
        if not as_json:
            kind = "virtual" if checked.bench.virtual else "real"
            click.echo(
                f"{path}: ok on {checked.bench.file.bench} ({kind} bench): {len(checked.plan)} steps, {points} points "
                f"of {duts} DUT{'s' if duts != 1 else ''}, about {format_duration(checked.duration_s)}, "
                f"{checked.disk_bytes / 1e6:.0f} MB on disk, all setpoints within limits"
            )
    if problems:
        raise InvalidFiles(problems)
    if as_json:
        print_json(summaries)
