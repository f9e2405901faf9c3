"""The manifest: provenance and outcome of a run, folded from its journal and metrics."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.analysis import Judged
from bench.check import Checked
from bench.journal import Entry

PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "scikit-learn", "pyserial", "python-can", "simpy", "pydantic")
# Kinds of journal records that a reader of the report wants to see.
EVENT_KINDS = ("note", "warning", "error", "safe", "interrupted")


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
        "overrides": list(overrides),
        "seed": seed,
        "started_utc": started_utc,
        "host": {"system": platform.system(), "machine": platform.machine()},
        "versions": {"fogbench": version("fogbench"), "python": platform.python_version()}
        | {name: version(name) for name in PACKAGES},
        "points_planned": checked.points,
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
    points = {entry["row"]["point"] for entry in entries if entry["kind"] == "point"}
    identities: Entry = next((entry for entry in entries if entry["kind"] == "identities"), {})
    for serial, about in head["duts"].items():
        about["describe"] = identities.get("found", {}).get(serial, "")
    return {
        **head,
        "ended_utc": end.get("ended_utc"),
        "outcome": outcome,
        "exit_code": exit_code,
        "duration_s": entries[-1]["t_s"],
        "wall_s": end.get("wall_s"),
        "points_measured": len(points),
        "identities": identities.get("found", {}),
        "limits": [{**asdict(item), "passed": item.passed} for item in judged],
        "data_quality": end.get("losses", {}),
        "events": [
            {"t_s": entry["t_s"], "kind": entry["kind"], "text": _event_text(entry)}
            for entry in entries
            if entry["kind"] in EVENT_KINDS
        ],
        "files": files,
    }


def _event_text(entry: Entry) -> str:
    instrument = f"{entry['instrument']}: " if "instrument" in entry else ""
    return f"{instrument}{entry.get('text', '')}"


def sha256(path: Path) -> str:
    """Hash of a file's bytes; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
