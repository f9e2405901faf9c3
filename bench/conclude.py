"""The end of a run, and any later look at it: the journal folded into points, models, manifest and report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.analyses.context import Context, Judged
from bench.analyses.everything import analyse
from bench.errors import BenchFailure, ExitCode, FogbenchError, Interrupted
from bench.journal import Entry, load_journal
from bench.manifest import manifest_of, missing_points, planned, points_planned, sha256
from bench.points import points_of, timeline_of, write_points, write_table
from bench.procedure.language import ProcedureHead
from bench.quantities import shown
from bench.runfolder import write_json
from bench.safe import NOT_SAFE
from bench.series import write_series

if TYPE_CHECKING:
    import pandas as pd

# Patterns of the files whose hashes the manifest has: all but the journal, which checks itself, and raw files likewise.
HASHED_FILES = (
    *("procedure.yaml", "bench.yaml", "included/*", "declarations/*", "points.csv", "points.parquet"),
    *("timeline.parquet", "series/*.parquet", "residuals.parquet", "metrics.json", "models/*/*.json"),
    *("analyses/*", "analyses/models/*/*.json"),
)
ANALYSES = "analyses"
ReportWriter = Callable[[Path], Any]


@dataclass(frozen=True)
class RunEnd:
    """How a run ended and where it is."""

    folder: Path
    outcome: str
    exit_code: ExitCode
    message: str
    metrics: dict[str, Any] = field(default_factory=dict)
    limits: Sequence[Judged] = ()
    manifest: dict[str, Any] = field(default_factory=dict)


def conclude(
    folder: Path,
    head: ProcedureHead,
    failure: FogbenchError | None,
    write_report: ReportWriter | None = None,
    models: Sequence[str] = (),
    recorded: Path | None = None,
) -> RunEnd:
    """Fold the journal of an ended run into points, timeline, models, metrics, manifest and report.

    `head` says what the procedure asks for, and what the run is judged by. `models`, if given, are fitted instead of
    its models; figures of models fitted before are kept, so that trying another model changes no verdict.
    `recorded` is the run folder with the raw files, if it is another.
    """
    entries = load_journal(folder / "journal.jsonl")
    points = points_of(entries)
    write_points(folder, points)
    write_table(folder / "timeline.parquet", timeline_of(entries))
    series = write_series(folder, entries, recorded or folder)
    duts = list(entries[0]["duts"])
    site = entries[0].get("site", {})
    context = Context(folder, recorded or folder, head, str(entries[0]["run_id"]), duts, points, series, models, site)
    found = analyse(context)
    if found.metrics or head.analysis:
        write_json(folder / "metrics.json", found.metrics)
    for name, document in found.documents.items():
        (folder / ANALYSES).mkdir(exist_ok=True)
        write_json(folder / ANALYSES / f"{name}.json", document)
    notes = list(found.notes)
    outcome, code, message = _outcome(entries, points, series, found.judged, notes if found.counts else [], failure)
    hashed = [path for pattern in HASHED_FILES for path in sorted(folder.glob(pattern)) if path.is_file()]
    files = {path.relative_to(folder).as_posix(): sha256(path) for path in hashed}
    manifest = manifest_of(entries, found.judged, outcome, code, files) | {"message": message, "notes": notes}
    write_json(folder / "manifest.json", manifest)
    if write_report:
        write_report(folder)
    return RunEnd(folder, outcome, code, message, found.metrics, found.judged, manifest)


def _outcome(
    entries: Sequence[Entry],
    points: pd.DataFrame,
    series: Sequence[dict[str, Any]],
    judged: Sequence[Judged],
    notes: Sequence[str],
    failure: FogbenchError | None,
) -> tuple[str, ExitCode, str]:
    """PASS, FAIL, ERROR or ABORTED (law 9): an unmeasured quantity is not passed."""
    unsafe = [
        entry["text"]
        for entry in _newest_attempt(entries)
        if entry["kind"] == "safe" and entry["text"].startswith(NOT_SAFE)
    ]
    warning = f"; {'; '.join(unsafe)}" if unsafe else ""
    if isinstance(failure, Interrupted) and not unsafe:
        return "ABORTED", ExitCode.INTERRUPTED, "interrupted; the bench was brought to its safe state"
    if failure is not None:
        return "ERROR", ExitCode.BENCH_FAILED, f"{failure}{warning}"
    reasons = [_in_words(item) for item in judged if not item.passed]
    failed = int((points["verdict"] == "fail").sum())
    rows_planned = points_planned(entries) * len(entries[0]["duts"])
    reasons += [f"{failed} of {len(points)} points failed their quality limits"] if failed else []
    reasons += [f"{rows_planned - len(points)} points were not measured"] if len(points) < rows_planned else []
    reasons += _left_over(entries)
    reasons += _record_reasons(entries, series)
    reasons += list(dict.fromkeys(notes))
    if reasons:
        return "FAIL", ExitCode.FAILED, "; ".join(reasons)
    measured = "record made" if series and not len(points) else "point measured"
    return "PASS", ExitCode.PASSED, f"every {measured}" + (", all limits met" if judged else "; no limit was set")


def _newest_attempt(entries: Sequence[Entry]) -> Sequence[Entry]:
    """What was recorded since the run was last taken up, which found the bench as it was left before."""
    begun = [number for number, entry in enumerate(entries) if entry["kind"] == "resumed"]
    return entries[begun[-1] :] if begun else entries


def _left_over(entries: Sequence[Entry]) -> list[str]:
    """Which points of which DUT are missing, and how they are measured after all."""
    names = {"not_measured": "not measured", "failed": "failed"}
    left = [
        f"{dut}: " + ", ".join(f"{names[why]} {points}" for why, points in about.items())
        for dut, about in missing_points(entries).items()
    ]
    run_id = entries[0]["run_id"]
    return [f"missing are, of {'; of '.join(left)} (measure them: fogbench resume {run_id} --missing)"] if left else []


def _record_reasons(entries: Sequence[Entry], series: Sequence[dict[str, Any]]) -> list[str]:
    """What is wrong with the records of the run."""
    bad = [one for one in series if one["verdict"] == "fail"]
    reasons = [f"record '{one['label']}' of {one['dut']}: {one['reasons']}" for one in bad]
    missing = planned(entries, "records_planned") * len(entries[0]["duts"]) - len(series)
    return reasons + ([f"{missing} records were not made"] if missing > 0 else [])


def _in_words(item: Judged) -> str:
    """Why a limit was not passed."""
    as_shown = shown(item.quantity, item.limit)
    what = f"{item.model}, {item.split.replace('_', ' ')}: {as_shown.words}"
    if any(value is None for value in item.measured.values()) or not item.measured:
        return f"{what} was not measured"
    worst = max(value for value in item.measured.values() if value is not None)
    return f"{what} {as_shown.text(worst)} is over its limit {as_shown.text(item.limit)}"


def failure_of(entries: Sequence[Entry]) -> FogbenchError | None:
    """How a run on disk failed, so that it can be folded again; None if it came to its end."""
    end = next((entry for entry in reversed(entries) if entry["kind"] in ("end", "resumed")), None)
    if end is None or end["kind"] == "resumed":
        return BenchFailure("the run did not come to its end: its process died, or it still runs")
    if end["failure"] is None:
        return None
    kind = Interrupted if end["failure"]["kind"] == "Interrupted" else BenchFailure
    return kind(end["failure"]["text"])
