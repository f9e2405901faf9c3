"""The manifest: provenance and outcome of a run, folded from its journal and metrics."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.analyses.context import Judged
from bench.check import Checked
from bench.journal import Entry
from bench.points import finished_rows
from bench.rawstore import QUEUE_LENGTH
from bench.replacement import left_to_measure, ranges
from bench.series import finished_series

PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "scikit-learn", "pyserial", "python-can", "simpy", "pydantic")
# Kinds of journal records that a reader of the report wants to see.
EVENT_KINDS = (
    "note",
    "warning",
    "error",
    "safe",
    "interrupted",
    "resumed",
    "paused",
    "continued",
    "guard",
    "held",
    "clear",
    "dropped",
    "link",
)


def head_of(checked: Checked, run_id: str, seed: int, overrides: Sequence[str], started_utc: str) -> Entry:
    """What is known before hour 0; the head record of the journal."""
    procedure, bench = checked.procedure, checked.bench
    return {
        "run_id": run_id,
        "procedure": {
            "name": checked.head.procedure,
            "title": checked.head.title,
            "experiment": checked.head.experiment,
            "file": procedure.document.file,
            "sha256": sha256(Path(procedure.document.file)),
        },
        "bench": {
            "name": bench.file.bench,
            "file": bench.document.file,
            "sha256": sha256(Path(bench.document.file)),
            "virtual": bench.virtual,
        },
        "site": {"latitude_deg": bench.file.site.latitude_deg, "azimuth_deg": bench.file.site.azimuth_deg},
        "overrides": list(overrides),
        "seed": seed,
        "started_utc": started_utc,
        "host": {"system": platform.system(), "machine": platform.machine()},
        "versions": {"fogbench": version("fogbench"), "python": platform.python_version()}
        | {name: version(name) for name in PACKAGES},
        "points_planned": checked.points,
        "records_planned": checked.records,
        "duts": {
            serial: {"driver": item.driver, "port": item.address, "limits": bench.file.duts[serial].limits.rate_dps}
            for serial, item in bench.duts.items()
        },
    }


def manifest_of(
    entries: Sequence[Entry], judged: Sequence[Judged], outcome: str, exit_code: int, files: dict[str, str]
) -> dict[str, Any]:
    """The manifest as it is written to manifest.json."""
    head = {key: value for key, value in entries[0].items() if key not in ("n", "t_s", "kind", "format")}
    end: Entry = next((entry for entry in reversed(entries) if entry["kind"] == "end"), {})
    points = {row["point"] for row in finished_rows(entries)}
    ends = [entry for entry in entries if entry["kind"] == "end"]
    identities: Entry = next((entry for entry in entries if entry["kind"] == "identities"), {})
    for serial, about in head["duts"].items():
        about["describe"] = identities.get("found", {}).get(serial, "")
    return {
        **head,
        "points_planned": points_planned(entries),
        "ended_utc": end.get("ended_utc"),
        "outcome": outcome,
        "exit_code": exit_code,
        "duration_s": entries[-1]["t_s"],
        "wall_s": sum(entry["wall_s"] for entry in ends) if ends else None,
        "attempts": 1 + sum(entry["kind"] == "resumed" for entry in entries),
        "points_measured": len(points),
        "records_planned": planned(entries, "records_planned"),
        "series": finished_series(entries),
        "missing": missing_points(entries),
        "identities": identities.get("found", {}),
        "limits": [{**asdict(item), "passed": item.passed} for item in judged],
        "data_quality": _total_losses(ends),
        "raw_queue": {"deepest": max((end["raw_queue_deepest"] for end in ends), default=None), "length": QUEUE_LENGTH},
        "events": [
            {"t_s": entry["t_s"], "kind": entry["kind"], "text": event_text(entry)}
            for entry in entries
            if entry["kind"] in EVENT_KINDS
        ],
        "files": files,
    }


def missing_points(entries: Sequence[Entry]) -> dict[str, dict[str, str]]:
    """Per DUT the points that were not measured or failed, as ranges: {"FOG-A01": {"not_measured": "12-28"}}."""
    left = left_to_measure(finished_rows(entries), list(entries[0]["duts"]), points_planned(entries))
    return {dut: {why: ranges(points) for why, points in about.items() if points} for dut, about in left.items()}


def points_planned(entries: Sequence[Entry]) -> int:
    """Conditions to be measured by the plan as it is now; a resumed run may have accepted another."""
    return planned(entries, "points_planned")


def planned(entries: Sequence[Entry], what: str) -> int:
    """A count of the plan as it is now; 0 if no record of the journal has it."""
    return next((int(entry[what]) for entry in reversed(entries) if what in entry), 0)


def _total_losses(ends: Sequence[Entry]) -> dict[str, dict[str, int]]:
    """Losses of every DUT over all attempts of the run."""
    total: dict[str, dict[str, int]] = {}
    for end in ends:
        for dut, losses in end["losses"].items():
            mine = total.setdefault(dut, dict.fromkeys(losses, 0))
            for name, count in losses.items():
                mine[name] += count
    return total


def event_text(entry: Entry) -> str:
    """What an event says, with the instrument it is about."""
    instrument = f"{entry['instrument']}: " if "instrument" in entry else ""
    return f"{instrument}{entry.get('text', '')}"


def sha256(path: Path) -> str:
    """Hash of a file's bytes; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
