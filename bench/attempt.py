"""The journal of an attempt: a new one, in a run folder that appears whole or not at all, or the old one continued."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.check import Checked
from bench.clock import Clock, utc_now
from bench.errors import BenchFailure
from bench.guardian import FILE as GUARDIAN_FILE
from bench.journal import Journal
from bench.manifest import head_of, sha256
from bench.preparation import Prepared
from bench.runfolder import DECLARATIONS, INCLUDED, copy_into, sync_folder
from bench.station import Station


def go_on(prepared: Prepared, station: Station, clock: Clock) -> Journal:
    """Continue the journal of a run that stopped."""
    resumed = prepared.resumed
    assert resumed is not None
    try:
        journal = Journal.reopen(prepared.folder / "journal.jsonl")
    except OSError as error:
        raise BenchFailure(f"{prepared.folder}: its journal cannot be continued: {error}") from error
    dropped = f", {resumed.stop.dropped} rows of a broken-off acquisition dropped" if resumed.stop.dropped else ""
    text = f"attempt {resumed.attempt}, {resumed.stop.next_step} steps done{dropped}; the gap was {resumed.gap_s:.0f} s"
    about: dict[str, Any] = {}
    if resumed.missing is not None:
        text = f"attempt {resumed.attempt}, only what is missing: {resumed.missing.text}"
        about = {"missing": True, "points": {str(n): sorted(duts) for n, duts in resumed.missing.points.items()}}
    planned = prepared.checked.points
    journal.append(
        "resumed",
        clock.now(),
        text=f"{text}{resumed.accepted}",
        gap_s=resumed.gap_s,
        attempt=resumed.attempt,
        utc=utc_now(),
        points_planned=planned,
        records_planned=prepared.checked.records,
        procedure={"sha256": sha256(prepared.folder / "procedure.yaml")},
        bench={"sha256": sha256(prepared.folder / "bench.yaml")},
        **about,
    )
    journal.append("identities", clock.now(), found=station.identities)
    if resumed.missing is not None:
        _journal_forecast(prepared, journal, clock)
    _take_note_of_guardian(prepared.folder, journal, clock)
    return journal


def _take_note_of_guardian(folder: Path, journal: Journal, clock: Clock) -> None:
    """Put what the guardian did after the last attempt into the journal."""
    path = folder / GUARDIAN_FILE
    if path.is_file():
        try:
            about = json.loads(path.read_text(encoding="utf-8"))
            text = f"the guardian acted at {about['utc']} because {about['why']}: {'; '.join(about['done'])}"
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            text = f"the guardian acted, but {GUARDIAN_FILE} cannot be read"
        journal.append("safe", clock.now(), instrument="guardian", text=text)
        path.unlink()


def begin(prepared: Prepared, station: Station, clock: Clock) -> Journal:
    """Create the run folder with the copies and the head of the journal; it appears whole or not at all."""
    folder, checked = prepared.folder, prepared.checked
    growing = folder.with_name(f".{folder.name}.new")
    try:
        shutil.rmtree(growing, ignore_errors=True)
        growing.mkdir(parents=True)
        record_files(growing, checked)
        overrides = [item.text for item in prepared.overrides]
        head = head_of(checked, folder.name, prepared.seed, overrides, utc_now())
        journal = Journal.create(growing / "journal.jsonl", head)
        growing.rename(folder)
        sync_folder(folder.parent)
    except OSError as error:
        raise BenchFailure(f"{folder}: the run folder could not be written: {error}. Nothing was started.") from error
    journal.append("identities", clock.now(), found=station.identities)
    _journal_forecast(prepared, journal, clock)
    return journal


def _journal_forecast(prepared: Prepared, journal: Journal, clock: Clock) -> None:
    forecast = prepared.forecast
    ends_s = [round(end, 1) for end in forecast.ends_s]
    journal.append("forecast", clock.now(), duration_s=forecast.duration_s, failure=forecast.failure, ends_s=ends_s)


def record_files(folder: Path, checked: Checked, kinds: Sequence[str] = ("procedure", "bench")) -> None:
    """Copy procedure and bench file, with what they refer to, into the run folder. Raises OSError."""
    if "procedure" in kinds:
        copy_into(folder, "procedure.yaml", Path(checked.procedure.document.file))
        for number, path in enumerate(checked.procedure.included, start=1):
            copy_into(folder, f"{INCLUDED}/{number:04d}-{path.name}", path)
    if "bench" in kinds:
        copy_into(folder, "bench.yaml", Path(checked.bench.document.file))
        for path in checked.bench.declaration_files:
            copy_into(folder, f"{DECLARATIONS}/{path.name}", path)
