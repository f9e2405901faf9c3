"""fogbench list"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option, table


@click.command("list")
@results_option
@json_option
def command(results: Path, as_json: bool) -> None:
    """List the runs in the results folder: outcome, points, duration."""
    from bench.units import format_duration

    runs = [_about(path.parent) for path in sorted(results.glob("*/journal.jsonl"))]
    if as_json:
        print_json(runs)
        return
    if not runs:
        click.echo(f"no runs in {results}. Make one: fogbench run procedures/smoke.yaml --bench benches/virtual.yaml")
        return
    rows = [
        [
            run["run_id"],
            run["outcome"],
            f"{run['points_measured']}/{run['points_planned']}",
            format_duration(run["duration_s"] or 0.0),
            "virtual" if run["virtual"] else "real",
            run["started_utc"] or "–",
        ]
        for run in runs
    ]
    click.echo(table(rows, ["run", "outcome", "points", "bench time", "bench", "started"]))


def _about(folder: Path) -> dict[str, Any]:
    """A run as its manifest says, or as unfinished if it has none."""
    keys = ("run_id", "outcome", "points_measured", "points_planned", "duration_s", "started_utc")
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        return {key: manifest[key] for key in keys} | {"virtual": manifest["bench"]["virtual"]}
    except (OSError, ValueError, KeyError, TypeError):
        unknown = dict.fromkeys(keys) | {"run_id": folder.name, "outcome": "UNFINISHED", "virtual": None}
        return unknown | {"points_measured": 0, "points_planned": 0}
