"""fogbench verify"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option

if TYPE_CHECKING:
    from bench.verify.findings import Check, Verification

# Findings of one check that are shown; all of them are in --json.
MOST_SHOWN = 20
CLEAR_LINE = "\r\x1b[K"


@click.command("verify")
@click.argument("run")
@results_option
@json_option
def command(run: str, results: Path, as_json: bool) -> None:
    """Compute points, models and figures of RUN (a run folder or run id) again, and say what does not match.

    Changes nothing. Exit code 0: everything matches, 1: something does not, 2: not a run.
    """
    from bench.runfolder import find_run
    from bench.verify.verify import verify

    moving = sys.stderr.isatty() and not as_json

    def tell(text: str) -> None:
        if moving:
            click.echo(f"{CLEAR_LINE}{text} ...", err=True, nl=False)

    folder = find_run(run, results)
    found = verify(folder, tell)
    if moving:
        click.echo(CLEAR_LINE, err=True, nl=False)
    if as_json:
        print_json(found.as_dict())
    else:
        show(found)
    raise SystemExit(int(found.exit_code))


def show(found: Verification) -> None:
    """One line a check, what was found below it, and the verdict."""
    width = max(len(check.name) for check in found.checks)
    for check in found.checks:
        colour = {"ok": "green", "note": "yellow", "wrong": "red"}[check.verdict]
        click.echo(f"{click.style(f'{check.verdict:5}', fg=colour)}  {check.name:{width}}  {check.summary}")
        _show_findings(check)
    wrong = len(found.wrong)
    verdict = f"{wrong} thing{'s do' if wrong != 1 else ' does'} not match" if wrong else "everything matches"
    click.echo(f"\n{found.folder}: {verdict}")


def _show_findings(check: Check) -> None:
    worst_first = sorted(check.findings, key=lambda finding: finding.severity != "wrong")
    for finding in worst_first[:MOST_SHOWN]:
        click.echo(f"         {finding}")
    if len(worst_first) > MOST_SHOWN:
        click.echo(f"         and {len(worst_first) - MOST_SHOWN} more; --json shows all")
