"""The end of a run, and any later look at it: the journal folded into points, models, manifest and report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.analysis import Judged, analyse, judge_limits
from bench.errors import BenchFailure, ExitCode, FogbenchError, Interrupted
from bench.journal import Entry, load_journal
from bench.manifest import manifest_of, points_planned, sha256
from bench.points import points_of, timeline_of, write_points, write_table
from bench.procedure.language import Analysis
from bench.runfolder import write_json
from bench.safe import NOT_SAFE

if TYPE_CHECKING:
    import pandas as pd

# Patterns of the files whose hashes the manifest has: all but the journal, which checks itself, and raw files likewise.
HASHED_FILES = (
    *("procedure.yaml", "bench.yaml", "included/*", "declarations/*", "points.csv", "points.parquet"),
    *("timeline.parquet", "residuals.parquet", "metrics.json", "models/*/*.json"),
)
QUANTITIES = {"max_abs_dps": "largest error", "std_dps": "standard deviation"}
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
    analysis: Analysis | None,
    failure: FogbenchError | None,
    write_report: ReportWriter | None = None,
    models: Sequence[str] = (),
) -> RunEnd:
    """Fold the journal of an ended run into points, timeline, models, metrics, manifest and report.

    `analysis` is what the procedure asks for, and what the run is judged by. `models`, if given, are fitted instead of
    its models; figures of models fitted before are kept, so that trying another model changes no verdict.
    """
    entries = load_journal(folder / "journal.jsonl")
    points = points_of(entries)
    write_points(folder, points)
    write_table(folder / "timeline.parquet", timeline_of(entries))
    duts = list(entries[0]["duts"])
    metrics: dict[str, Any] = {}
    notes: list[str] = []
    wanted = _wanted(analysis, models)
    if wanted:
        result = analyse(folder, points, duts, wanted, {"run_id": entries[0]["run_id"]}, keep=bool(models))
        metrics, notes = result["metrics"], result["notes"]
    judged = judge_limits(analysis, metrics, duts) if analysis else []
    outcome, code, message = _outcome(entries, points, judged, notes if analysis else [], failure)
    hashed = [path for pattern in HASHED_FILES for path in sorted(folder.glob(pattern)) if path.is_file()]
    files = {path.relative_to(folder).as_posix(): sha256(path) for path in hashed}
    manifest = manifest_of(entries, judged, outcome, code, files) | {"message": message, "notes": notes}
    write_json(folder / "manifest.json", manifest)
    if write_report:
        write_report(folder)
    return RunEnd(folder, outcome, code, message, metrics, judged, manifest)


def _wanted(analysis: Analysis | None, models: Sequence[str]) -> Analysis | None:
    """What to fit now: the procedure's models, or those named with everything else as the procedure has it."""
    if not models:
        return analysis
    if analysis is None:
        return Analysis.model_validate({"models": list(models)})
    return analysis.model_copy(update={"models": list(models)})


def _outcome(
    entries: Sequence[Entry],
    points: pd.DataFrame,
    judged: Sequence[Judged],
    notes: Sequence[str],
    failure: FogbenchError | None,
) -> tuple[str, ExitCode, str]:
    """PASS, FAIL, ERROR or ABORTED (law 9): an unmeasured quantity is not passed."""
    unsafe = [entry["text"] for entry in entries if entry["kind"] == "safe" and entry["text"].startswith(NOT_SAFE)]
    warning = f"; {'; '.join(unsafe)}" if unsafe else ""
    if isinstance(failure, Interrupted) and not unsafe:
        return "ABORTED", ExitCode.INTERRUPTED, "interrupted; the bench was brought to its safe state"
    if failure is not None:
        return "ERROR", ExitCode.BENCH_FAILED, f"{failure}{warning}"
    reasons = [_in_words(item) for item in judged if not item.passed]
    failed = int((points["verdict"] == "fail").sum())
    planned = points_planned(entries) * len(entries[0]["duts"])
    reasons += [f"{failed} of {len(points)} points failed their quality limits"] if failed else []
    reasons += [f"{planned - len(points)} points were not measured"] if len(points) < planned else []
    reasons += list(dict.fromkeys(notes))
    if reasons:
        return "FAIL", ExitCode.FAILED, "; ".join(reasons)
    return "PASS", ExitCode.PASSED, "every point measured" + (", all limits met" if judged else "; no limit was set")


def _in_words(item: Judged) -> str:
    """Why a limit was not passed."""
    what = f"{item.model}, {item.split.replace('_', ' ')}: {QUANTITIES[item.quantity]}"
    if any(value is None for value in item.measured.values()) or not item.measured:
        return f"{what} was not measured"
    worst = max(value for value in item.measured.values() if value is not None)
    return f"{what} {worst:.4g} is over its limit {item.limit:g} deg/s"


def failure_of(entries: Sequence[Entry]) -> FogbenchError | None:
    """How a run on disk failed, so that it can be folded again; None if it came to its end."""
    end = next((entry for entry in reversed(entries) if entry["kind"] in ("end", "resumed")), None)
    if end is None or end["kind"] == "resumed":
        return BenchFailure("the run did not come to its end: its process died, or it still runs")
    if end["failure"] is None:
        return None
    kind = Interrupted if end["failure"]["kind"] == "Interrupted" else BenchFailure
    return kind(end["failure"]["text"])
