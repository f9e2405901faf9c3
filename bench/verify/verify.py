"""All checks of a run, in the order of the data: journal, copies, raw frames, points, models, manifest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bench.verify.findings import Check, Finding, Tell, Verification, attempt
from bench.verify.raw_files import check_raw
from bench.verify.record import JOURNAL, Record, read_record
from bench.verify.results import MANIFEST, check_results
from bench.verify.series import check_series
from bench.verify.tables import check_tables
from fitting.strict_json import read_object

DERIVED = ("points.csv", MANIFEST, "metrics.json")


def verify(folder: Path, tell: Tell = lambda text: None) -> Verification:
    """Compute again what can be computed of a run, and compare.

    `tell` is given what is being done. Never raises for what is in the folder: a file that cannot be used is a finding.
    """
    tell("journal")
    record, checks = read_record(folder)
    if record.entries:
        checks += _guarded("raw files", lambda: check_raw(record, tell))
        checks += _guarded("records", lambda: check_series(record, tell))
        checks += _concluded(record, tell)
    return Verification(str(folder), checks)


def _concluded(record: Record, tell: Tell) -> list[Check]:
    """What the end of a run wrote."""
    name = "results"
    if not any((record.folder / file).exists() for file in DERIVED):
        if record.state == "ended":
            findings = [Finding("is missing, though the run ended. Write it with: fogbench report RUN", MANIFEST)]
            return [Check(name, "nothing to verify", findings)]
        return [Check(name, "none yet: the run is not ended")]
    if record.damaged:
        findings = [Finding("cannot be folded: what follows from it was not verified", JOURNAL)]
        return [Check(name, "not verified", findings)]
    folded, notes = _as_concluded(record)
    tell("points and timeline")
    checks = _guarded("points and timeline", lambda: [check_tables(folded)])
    tell("fitting the models again")
    return [*notes, *checks, *_guarded(name, lambda: check_results(folded))]


def _as_concluded(record: Record) -> tuple[Record, list[Check]]:
    """The journal as far as it went when the files were written: a resumed run has those of its last end."""
    if record.state != "resumed":
        return record, []
    try:
        duration_s = read_object(record.folder / MANIFEST).get("duration_s")
    except (OSError, ValueError):
        return record, []
    before = record.before_resuming()
    if not before.entries or duration_s != before.entries[-1]["t_s"]:
        return record, []
    text = "the run was resumed and has not ended: points, models and manifest are those from before"
    return before, [Check("results", "not of the whole journal", [Finding(text, MANIFEST, severity="note")])]


def _guarded(name: str, checks: Callable[[], list[Check]]) -> list[Check]:
    """Checks that may meet anything on disk; what they cannot digest is a finding."""
    findings: list[Finding] = []
    done = attempt(findings, name, checks)
    return list(done) if done is not None else [Check(name, "could not be verified", findings)]
