"""fogbench pause, continue, abort: requests to a run in another process."""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.options import results_option
from bench.control import Ask

EFFECT: dict[Ask, str] = {
    "pause": "it holds after the step under way: the table at rest, the chamber at its setpoint",
    "continue": "it goes on",
    "abort": "it ends in order, the bench is made safe, and it can be resumed",
}


def _request(what: Ask, run: str, results: Path) -> None:
    from bench.control import ask
    from bench.errors import UserMistake
    from bench.locks import run_is_held
    from bench.runfolder import find_run

    folder = find_run(run, results)
    if not run_is_held(folder):
        raise UserMistake(f"no process is running '{folder.name}'. See: fogbench status {folder}")
    ask(folder, what)
    click.echo(f"{folder.name}: {what} requested; {EFFECT[what]}")


@click.command("pause")
@click.argument("run")
@results_option
def pause(run: str, results: Path) -> None:
    """Hold RUN, which runs in another process, after its present step. Costs no soak and no point."""
    _request("pause", run, results)


@click.command("continue")
@click.argument("run")
@results_option
def go_on(run: str, results: Path) -> None:
    """Let a paused RUN go on."""
    _request("continue", run, results)


@click.command("abort")
@click.argument("run")
@results_option
def abort(run: str, results: Path) -> None:
    """End RUN, which runs in another process, in order: safe, with what was measured kept. It can be resumed."""
    _request("abort", run, results)
