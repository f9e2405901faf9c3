"""`status`: what a run is doing, folded from its journal; any process may ask, at any time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.forecast import Forecast
from bench.journal import Entry, load_journal
from bench.locks import run_is_held
from bench.manifest import EVENT_KINDS, event_text, planned, points_planned
from bench.points import finished_rows
from bench.replacement import left_to_measure, ranges
from bench.series import finished_series

LAST_EVENTS = 5


def status_of(folder: Path) -> dict[str, Any]:
    """State (running, paused, ended, stopped), step, points, readbacks, ETA and last events of a run.

    Raises JournalDamaged or OSError.
    """
    entries = load_journal(folder / "journal.jsonl")
    step = next((entry for entry in reversed(entries) if entry["kind"] == "step"), None)
    readback = next((entry for entry in reversed(entries) if entry["kind"] == "readback"), {})
    verdicts = [row["verdict"] for row in finished_rows(entries)]
    state = _state(entries, run_is_held(folder))
    return {
        "run_id": entries[0]["run_id"],
        "state": state,
        "t_s": entries[-1]["t_s"],
        "step": step and {key: step[key] for key in ("step", "verb", "at")},
        "points_measured": len({row["point"] for row in finished_rows(entries)}),
        "points_planned": points_planned(entries),
        "records_made": len({one["record"] for one in finished_series(entries)}),
        "records_planned": planned(entries, "records_planned"),
        "verdicts": {verdict: verdicts.count(verdict) for verdict in ("pass", "marginal", "fail")},
        "missing": _missing(entries, state),
        "readbacks": {key: value for key, value in readback.items() if key not in ("n", "t_s", "kind")},
        "remaining_s": _remaining_s(entries, step) if state in ("running", "paused") else None,
        "events": [
            {"t_s": entry["t_s"], "kind": entry["kind"], "text": event_text(entry)}
            for entry in entries
            if entry["kind"] in EVENT_KINDS
        ][-LAST_EVENTS:],
    }


def _missing(entries: Sequence[Entry], state: str) -> dict[str, dict[str, str]]:
    """Per DUT the points that the run has passed and that are not measured or failed; at its end, of all planned."""
    rows = finished_rows(entries)
    carried_out = state == "ended" and any(entry["kind"] == "end" and entry["failure"] is None for entry in entries)
    passed = points_planned(entries) if carried_out else max((row["point"] for row in rows), default=0)
    left = left_to_measure(rows, list(entries[0]["duts"]), passed)
    return {dut: {why: ranges(points) for why, points in about.items() if points} for dut, about in left.items()}


def _state(entries: Sequence[Entry], held: bool) -> str:
    last = next((e["kind"] for e in reversed(entries) if e["kind"] in ("end", "resumed", "paused", "continued")), None)
    if last == "end":
        return "ended"
    if not held:
        return "stopped"
    return "paused" if last == "paused" else "running"


def _remaining_s(entries: Sequence[Entry], step: Entry | None) -> float | None:
    """The ETA, from the rehearsal that was made before hour 0."""
    rehearsed = next((entry for entry in reversed(entries) if entry["kind"] == "forecast"), None)
    if rehearsed is None or step is None or not rehearsed["ends_s"]:
        return None
    forecast = Forecast(tuple(rehearsed["ends_s"]), ({"t_s": rehearsed["duration_s"]},), None)
    return forecast.remaining_s(step["step"], entries[-1]["t_s"] - step["t_s"])
