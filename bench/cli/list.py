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
            f"{_or_dash(run['points_measured'])}/{_or_dash(run['points_planned'])}",
            "–" if run["duration_s"] is None else format_duration(run["duration_s"]),
            {True: "virtual", False: "real", None: "–"}[run["virtual"]],
            run["started_utc"] or "–",
        ]
        for run in runs
    ]
    click.echo(table(rows, ["run", "outcome", "points", "bench time", "bench", "started"]))


def _or_dash(value: int | None) -> str:
    return "–" if value is None else str(value)


KEYS = ("outcome", "points_measured", "points_planned", "duration_s", "started_utc")


def _about(folder: Path) -> dict[str, Any]:
    """A run as its manifest says; without one (it runs, or died) as far as its journal goes."""
    from bench.errors import FogbenchError
    from bench.journal import load_journal
    from bench.manifest import manifest_of

    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        try:
            manifest = manifest_of(load_journal(folder / "journal.jsonl"), [], "UNFINISHED", 0, {})
        except (FogbenchError, OSError, LookupError):
            manifest = {"outcome": "UNREADABLE"}
    virtual = manifest.get("bench", {}).get("virtual")
    return {"run_id": folder.name, **{key: manifest.get(key) for key in KEYS}, "virtual": virtual}
