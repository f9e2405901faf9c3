"""fogbench check"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.cli.main import print_json
from bench.cli.options import bench_option, existing_file, json_option, junit_option, set_option
from bench.errors import InvalidFiles, Problem

if TYPE_CHECKING:
    from bench.check import Checked
    from bench.junit import JUnitFile


@click.command("check")
@click.argument("procedures", nargs=-1, required=True, type=existing_file)
@bench_option
@set_option
@json_option
@junit_option
def command(
    procedures: tuple[Path, ...], bench_path: Path, settings: tuple[str, ...], as_json: bool, junit: Path | None
) -> None:
    """Find every mistake in PROCEDURES and a bench file at once, and say what a run takes. Touches no hardware.

    The duration is a sum of stated times; `fogbench dry-run` rehearses the procedure and knows better.
    """
    from bench.junit import junit_file

    with junit_file(junit, f"check.{bench_path.stem}") as file:
        _check(procedures, bench_path, settings, as_json, file)


def _check(
    procedures: Sequence[Path], bench_path: Path, settings: Sequence[str], as_json: bool, junit: JUnitFile
) -> None:
    from bench.check import check
    from bench.junit import case_of_check
    from bench.overrides import parse_overrides

    overrides = parse_overrides(settings)
    problems: list[Problem] = []
    summaries, cases = [], []
    for path in procedures:
        try:
            checked = check(path, bench_path, overrides)
        except InvalidFiles as error:
            problems += error.problems
            cases.append(case_of_check(path, error.problems, ""))
            continue
        summaries.append(_summary(path, bench_path, checked))
        line = _line(path, checked)
        cases.append(case_of_check(path, [], line))
        if not as_json:
            click.echo(line)
    junit.tell(cases, {"bench": bench_path})
    if problems:
        raise InvalidFiles(problems)
    if as_json:
        print_json(summaries)


def _summary(path: Path, bench_path: Path, checked: Checked) -> dict[str, Any]:
    return {
        "procedure": str(path),
        "bench": str(bench_path),
        "virtual": checked.bench.virtual,
        "steps": len(checked.plan),
        "points": checked.points,
        "duts": len(checked.bench.duts),
        "identities": {item.name: item.identity for item in checked.bench.instruments if item.identity},
        "duration_s": checked.duration_s,
        "disk_bytes": checked.disk_bytes,
    }


def _line(path: Path, checked: Checked) -> str:
    from bench.units import format_duration

    kind = "virtual" if checked.bench.virtual else "real"
    duts = len(checked.bench.duts)
    return (
        f"{path}: ok on {checked.bench.file.bench} ({kind} bench): {len(checked.plan)} steps, {checked.content} "
        f"of {duts} DUT{'s' if duts != 1 else ''}, about {format_duration(checked.duration_s)}, "
        f"{checked.disk_bytes / 1e6:.0f} MB on disk, all setpoints within limits{_expected(checked)}"
    )


def _expected(checked: Checked) -> str:
    """Who the instruments have to say that they are before a run begins."""
    named = [f"{item.name} '{item.identity}'" for item in checked.bench.instruments if item.identity]
    return f"; expected are {', '.join(named)}" if named else ""
