"""The manifest of a synthetic run, with the keys of a real one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

EXIT_CODES = {"PASS": 0, "FAIL": 1, "ERROR": 3, "ABORTED": 130}
MESSAGES = {
    "PASS": "all limits met",
    "FAIL": "3 of 24 points failed their quality limits",
    "ERROR": "chamber at sim://chamber: no reply to 'TEMP?' within 1.0 s (3 tries)",
    "ABORTED": "interrupted; the bench was brought to its safe state",
}
LIMITS = (("ts_joint", "leave_temperatures_out", "std_dps", 0.5), ("ts_joint", "random", "max_abs_dps", 0.25))
Metrics = Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]


def manifest_of(
    folder: Path,
    points: pd.DataFrame,
    metrics: Metrics,
    duts: Sequence[str],
    duration_s: float,
    counts: Mapping[str, int],
    outcome: str,
    virtual: bool,
    seed: int,
) -> dict[str, Any]:
    """The manifest of the run in `folder`, whose other files are already written."""
    bench = "virtual" if virtual else "lab-3"
    return {
        "run_id": folder.name,
        "procedure": _source("temperature_rate_grid", "procedures")
        | {"title": "Temperature × rate grid, 703 points", "experiment": "ts"},
        "bench": _source(bench, "benches") | {"virtual": virtual},
        "overrides": [],
        "seed": seed,
        "started_utc": "2026-11-03T08:15:00Z",
        "ended_utc": "2026-11-03T08:15:41Z",
        "host": {"system": "Linux", "machine": "x86_64"},
        "versions": {"fogbench": "0.1.0", "python": "3.11.9", "numpy": np.__version__, "pandas": pd.__version__},
        "outcome": outcome,
        "exit_code": EXIT_CODES[outcome],
        "duration_s": duration_s,
        "wall_s": 41.3,
        "points_planned": counts["planned"],
        "points_measured": counts["measured"],
        "limits": [_limit(metrics, duts, *limit) for limit in LIMITS],
        "files": _hashes(folder),
        "duts": {dut: _dut(dut, number) for number, dut in enumerate(duts)},
        "identities": {"chamber": "Watlow F4, model 5270", "rate_table": "Acutronic ACL, axis 1"},
        "data_quality": {dut: _losses(points[points["dut"] == dut]) for dut in duts},
        "events": [
            {"t_s": 0.0, "kind": "note", "text": "bench identified"},
            {"t_s": duration_s, "kind": "safe", "text": "table at rest, chamber at 25 degC, both read back"},
        ],
        "message": MESSAGES[outcome],
        "notes": [],
    }


def _source(name: str, folder: str) -> dict[str, Any]:
    return {"name": name, "file": f"{folder}/{name}.yaml", "sha256": sha256(name.encode()).hexdigest()}


def _limit(
    metrics: Metrics, duts: Sequence[str], model: str, split: str, quantity: str, limit: float
) -> dict[str, Any]:
    measured = {dut: metrics.get(dut, {}).get(model, {}).get(split, {}).get(quantity) for dut in duts}
    passed = all(value is not None and value <= limit for value in measured.values())
    fields = {"model": model, "split": split, "quantity": quantity, "limit": limit}
    return {**fields, "measured": measured, "passed": passed}


def _dut(dut: str, number: int) -> dict[str, Any]:
    if number % 2 == 0:
        return {"driver": "serial_frames", "port": f"sim://{dut}", "describe": "KVH 36-byte frames, 100 Hz"}
    return {"driver": "can_dbc", "port": f"can:{dut}", "describe": "CAN frames by DBC, 100 Hz"}


def _losses(points: pd.DataFrame) -> dict[str, int]:
    lost, frames = int(points["frames_lost"].sum()), int(points["frames"].sum())
    return {"frames": frames, "lost": lost, "duplicates": 0, "bad_checksum": 2, "skipped_bytes": 72, "resyncs": 2}


def _hashes(folder: Path) -> dict[str, str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): sha256(path.read_bytes()).hexdigest() for path in paths}
