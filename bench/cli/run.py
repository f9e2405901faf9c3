"""fogbench run"""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.cli.main import print_json
from bench.cli.options import (
    bench_option,
    existing_file,
    json_option,
    junit_option,
    results_option,
    seed_option,
    set_option,
)

if TYPE_CHECKING:
    from bench.clock import StopRequest
    from bench.conclude import RunEnd
    from bench.junit import JUnitFile
    from bench.run import Prepared


@click.command("run")
@click.argument("procedure", type=existing_file)
@bench_option
@results_option
@click.option("--run-id", help="Name of the run folder; procedure and time if left out.")
@seed_option
@set_option
@json_option
@junit_option
def command(
    procedure: Path,
    bench_path: Path,
    results: Path,
    run_id: str | None,
    seed: int | None,
    settings: tuple[str, ...],
    as_json: bool,
    junit: Path | None,
) -> None:
    """Run PROCEDURE on a bench: measure, fit, report. Ctrl-C ends it in order, safe; a second one at once, safe too."""
    from bench.junit import junit_file
    from bench.overrides import parse_overrides
    from bench.run import RunRequest, prepare

    with junit_file(junit, f"{procedure.stem}.{bench_path.stem}") as file:
        request = RunRequest(procedure, bench_path, results, run_id, seed, parse_overrides(settings))
        carry_out(prepare(request), as_json, file)


def carry_out(prepared: Prepared, as_json: bool, junit: JUnitFile) -> None:
    """Run what was prepared, with progress, results, the JUnit file and the exit code."""
    from bench.cli.progress import ProgressPrinter
    from bench.report.render import write_report
    from bench.run import run

    printer = ProgressPrinter(prepared, quiet=as_json)
    printer.begin()
    end = run(prepared, printer.tell, _stop_on_signals, write_report)
    printer.end()
    junit.tell_run(end)
    if as_json:
        print_json(summary(end))
    else:
        show(end)
    raise SystemExit(int(end.exit_code))


def _stop_on_signals(stop: StopRequest) -> None:
    """First Ctrl-C, SIGTERM or SIGHUP asks for an orderly end; a later Ctrl-C for one at once, safe all the same.

    No signal interrupts the making-safe itself, however often it comes. Once that is over Ctrl-C ends the process: what
    is left to write can be written by a resume.
    """
    asked: list[int] = []

    def ask(number: int, frame: Any) -> None:
        if number == signal.SIGINT and stop.over:
            raise KeyboardInterrupt
        # A closing session may send several signals at once: only a person at the keyboard is in a hurry.
        if number == signal.SIGINT and asked:
            stop.hurry()
        asked.append(number)
        stop.ask()

    # SIGHUP: a terminal that was closed or a dropped remote login must not leave the table turning.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), ask)


def summary(end: RunEnd) -> dict[str, Any]:
    """The end of a run as data."""
    return {
        "run": str(end.folder),
        "outcome": end.outcome,
        "exit_code": int(end.exit_code),
        "message": end.message,
        "points": end.manifest.get("points_measured"),
        "duration_s": end.manifest.get("duration_s"),
        "report": str(end.folder / "report.html"),
        "limits": end.manifest.get("limits"),
        "metrics": end.metrics,
    }


def show(end: RunEnd) -> None:
    """Print the results table, the limits and where the report is."""
    from bench.cli.results import limits_table, results_table
    from bench.units import format_duration

    if end.metrics:
        click.echo(results_table(end.metrics))
    if end.limits:
        click.echo("\n" + limits_table(end.limits))
    manifest = end.manifest
    colour = {"PASS": "green", "FAIL": "yellow"}.get(end.outcome, "red")
    wall_s = manifest.get("wall_s") or 0.0
    ratio = (
        f", {manifest['duration_s'] / wall_s:,.0f} times real time" if manifest["bench"]["virtual"] and wall_s else ""
    )
    click.echo(
        f"\n{click.style(end.outcome, fg=colour, bold=True)}: {end.message}\n"
        f"{_measured(manifest)}, "
        f"{format_duration(manifest['duration_s'])} of bench time in {wall_s:.1f} s{ratio}\n"
        f"report: {end.folder / 'report.html'}"
    )


def _measured(manifest: dict[str, Any]) -> str:
    """How much of the plan was measured, in words."""
    made = len({one["record"] for one in manifest["series"]})
    counts = [("points", manifest["points_measured"], manifest["points_planned"])]
    counts.append(("records", made, manifest["records_planned"]))
    return ", ".join(f"{done} of {planned} {what}" for what, done, planned in counts if planned) or "nothing to measure"
