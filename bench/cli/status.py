"""fogbench status"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option

WATCH_PERIOD_S = 2.0


@click.command("status")
@click.argument("run")
@click.option("--watch", is_flag=True, help="Look again every two seconds until the run has ended.")
@results_option
@json_option
def command(run: str, watch: bool, results: Path, as_json: bool) -> None:
    """Say what RUN is doing, or how it ended: step, point, readbacks, ETA, last events. Reads its journal only."""
    from bench.clock import WallClock
    from bench.runfolder import find_run
    from bench.status import status_of

    folder, clock = find_run(run, results), WallClock()
    while True:
        status = status_of(folder)
        if as_json:
            print_json(status)
        else:
            click.echo(_text(status))
        if not watch or status["state"] not in ("running", "paused"):
            return
        clock.wait(WATCH_PERIOD_S)


def _text(status: dict[str, Any]) -> str:
    from bench.units import format_duration

    step = status["step"]
    lines = [f"{status['run_id']}: {status['state']}, {format_duration(status['t_s'])} of bench time, {_done(status)}"]
    if step:
        lines.append(f"  step {step['step']} {step['verb']} ({step['at']})")
    readbacks = ", ".join(f"{key} {value}" for key, value in status["readbacks"].items() if value is not None)
    lines += [f"  {readbacks}"] if readbacks else []
    for dut, left in status["missing"].items():
        texts = [f"{why.replace('_', ' ')} {points}" for why, points in left.items()]
        lines.append(f"  {dut}: points {', '.join(texts)}")
    if status["missing"] and status["state"] == "ended":
        lines.append(f"  they are measured by: fogbench resume {status['run_id']} --missing")
    if status["remaining_s"] is not None:
        lines.append(f"  ETA {format_duration(status['remaining_s'])}")
    lines += [f"  {format_duration(e['t_s'])}: {e['kind']}: {e['text']}" for e in status["events"]]
    if status["state"] == "stopped":
        lines.append(f"  its process died; go on with: fogbench resume {status['run_id']}")
    return "\n".join(lines)


def _done(status: dict[str, Any]) -> str:
    """How much of the plan is measured, in words."""
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in status["verdicts"].items())
    parts = [f"{status['points_measured']} of {status['points_planned']} points ({verdicts})"]
    if status["records_planned"]:
        made = f"{status['records_made']} of {status['records_planned']} records"
        parts = [*parts, made] if status["points_planned"] else [made]
    return ", ".join(parts)
