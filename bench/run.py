"""One run from check to report: the run folder appears when the bench answers, and is complete whatever happens."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bench.acquire import RecordingAcquirer
from bench.analysis import Judged, analyse, judge_limits
from bench.check import Checked, check
from bench.clock import Clock, StopRequest, stopwatch, utc_now
from bench.composition import open_bench, seed_of
from bench.earth import earth_rate_dps
from bench.engine import Engine, Listener
from bench.errors import BenchFailure, ExitCode, FogbenchError, Interrupted, UserMistake
from bench.forecast import Forecast, rehearse
from bench.journal import Entry, Journal, read_journal
from bench.manifest import head_of, manifest_of, sha256
from bench.overrides import Override
from bench.points import points_of, timeline_of, write_points, write_table
from bench.procedure.language import Analysis
from bench.rawstore import RawStore
from bench.runfolder import copy_into, new_run_folder, write_json
from bench.safe import make_safe
from bench.station import Station, energise
from bench.steps import STEPS
from drivers.errors import DriverError

TRUTH_FOLDER = ".truth"
HASHED_FILES = ("procedure.yaml", "bench.yaml", "points.csv", "points.parquet", "metrics.json")


@dataclass(frozen=True)
class RunRequest:
    """What the user asked for."""

    procedure: Path
    bench: Path
    results: Path
    run_id: str | None = None
    seed: int | None = None
    overrides: Sequence[Override] = ()


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


@dataclass(frozen=True)
class Prepared:
    """A run that may begin: checked, rehearsed, named; nothing was touched yet."""

    request: RunRequest
    checked: Checked
    folder: Path
    seed: int
    forecast: Forecast


def prepare(request: RunRequest) -> Prepared:
    """Check and rehearse a run. Raises UserMistake; touches neither hardware nor results."""
    checked = check(request.procedure, request.bench, request.overrides)
    run_id = (
        request.run_id
        if request.run_id is not None
        else f"{checked.head.procedure}-{utc_now().translate({ord(c): None for c in '-:'})}"
    )
    folder = new_run_folder(request.results, run_id)
    _check_disk(request.results, checked.disk_bytes)
    seed = request.seed if request.seed is not None else seed_of(checked.bench)
    return Prepared(request, checked, folder, seed, rehearse(checked, seed))


def _check_disk(results: Path, needed: float) -> None:
    existing = next(path for path in (results, *results.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if free < needed:
        raise UserMistake(
            f"{results}: {free / 1e9:.1f} GB are free, the run needs about {needed / 1e9:.1f} GB. Free space, choose "
            "another folder with --results, or keep less with --set procedure.raw=samples (or none)."
        )


def run(
    prepared: Prepared,
    listener: Listener = lambda progress: None,
    on_stop: Callable[[StopRequest], None] = lambda stop: None,
    write_report: Callable[[Path], Any] | None = None,
) -> RunEnd:
    """Carry out a prepared run. Raises BenchFailure only if the bench does not answer; later failures are outcomes.

    `on_stop` gets the handle with which a signal handler may ask the run to end in order.
    """
    checked, folder = prepared.checked, prepared.folder
    truth_dir = prepared.request.results / TRUTH_FOLDER / folder.name if checked.bench.virtual else None
    with open_bench(checked.bench, prepared.seed, truth_dir) as (station, clock):
        on_stop(clock.stop)
        journal = _begin(prepared, station, clock)
        try:
            failure = _execute(prepared, station, clock, journal, listener)
        finally:
            journal.close()
    return finish(folder, checked.head.analysis, failure, write_report)


def _begin(prepared: Prepared, station: Station, clock: Clock) -> Journal:
    """Create the run folder with the copies and the head of the journal."""
    folder, checked = prepared.folder, prepared.checked
    try:
        folder.mkdir(parents=True)
        copy_into(folder, "procedure.yaml", prepared.request.procedure)
        copy_into(folder, "bench.yaml", prepared.request.bench)
        for number, path in enumerate(checked.procedure.included, start=1):
            copy_into(folder, f"included/{number:02d}-{path.name}", path)
        overrides = [item.text for item in prepared.request.overrides]
        head = head_of(checked, folder.name, prepared.seed, overrides, utc_now())
        journal = Journal(folder / "journal.jsonl", head)
    except OSError as error:
        raise BenchFailure(f"{folder}: the run folder could not be written: {error}. Nothing was started.") from error
    journal.append("identities", clock.now(), found=station.identities)
    journal.append("forecast", clock.now(), duration_s=prepared.forecast.duration_s, failure=prepared.forecast.failure)
    return journal


def _execute(
    prepared: Prepared, station: Station, clock: Clock, journal: Journal, listener: Listener
) -> FogbenchError | None:
    """Run the plan and leave the bench safe; how it failed, or None."""
    checked, began = prepared.checked, stopwatch()
    store = RawStore(prepared.folder / "raw")
    earth = earth_rate_dps(checked.bench.file.site.latitude_deg)
    acquirer = RecordingAcquirer(checked.head.quality, earth, checked.head.raw, store.put)
    engine = Engine(STEPS, checked.bench, station, clock, journal, acquirer, listener)
    failure: FogbenchError | None = None
    try:
        energise(station, clock)
        engine.run(checked.plan)
    except Interrupted as error:
        failure = error
        journal.append("interrupted", clock.now(), text="asked to stop; bringing the bench to its safe state")
    except (FogbenchError, DriverError, OSError) as error:
        failure = error if isinstance(error, FogbenchError) else BenchFailure(str(error))
        journal.append("error", clock.now(), text=str(error))
    finally:
        clock.stop.forget()
        unsafe = make_safe(engine)
    try:
        store.close()
    except BenchFailure as error:
        failure = failure or error
        journal.append("error", clock.now(), text=str(error))
    if unsafe and failure is None:
        failure = BenchFailure("the bench could not be made safe: " + "; ".join(unsafe))
    losses = {name: asdict(gyro.losses) for name, gyro in station.gyros.items()}
    journal.append(
        "end",
        clock.now(),
        failure=None if failure is None else {"kind": type(failure).__name__, "text": str(failure)},
        losses=losses,
        wall_s=stopwatch() - began,
        ended_utc=utc_now(),
        raw_queue_deepest=store.deepest,
    )
    return failure


def finish(
    folder: Path,
    analysis: Analysis | None,
    failure: FogbenchError | None,
    write_report: Callable[[Path], Any] | None = None,
) -> RunEnd:
    """Fold the journal of an ended run into points, timeline, models, metrics, manifest and report."""
    entries = list(read_journal(folder / "journal.jsonl"))
    points = points_of(entries)
    write_points(folder, points)
    write_table(folder / "timeline.parquet", timeline_of(entries))
    duts = list(entries[0]["duts"])
    metrics: dict[str, Any] = {}
    judged: list[Judged] = []
    notes: list[str] = []
    if analysis:
        result = analyse(folder, points, duts, analysis, {"run_id": entries[0]["run_id"]})
        metrics, notes = result["metrics"], result["notes"]
        judged = judge_limits(analysis, metrics, duts)
    outcome, code, message = _outcome(entries, points, judged, notes, failure)
    files = {name: sha256(folder / name) for name in HASHED_FILES if (folder / name).is_file()}
    manifest = manifest_of(entries, judged, outcome, code, files) | {"message": message, "notes": notes}
    write_json(folder / "manifest.json", manifest)
    if write_report:
        write_report(folder)
    return RunEnd(folder, outcome, code, message, metrics, judged, manifest)


def _outcome(
    entries: Sequence[Entry], points: Any, judged: Sequence[Judged], notes: Sequence[str], failure: FogbenchError | None
) -> tuple[str, ExitCode, str]:
    """PASS, FAIL, ERROR or ABORTED (law 9): an unmeasured quantity is not passed."""
    if isinstance(failure, Interrupted):
        return "ABORTED", ExitCode.INTERRUPTED, "interrupted; the bench was brought to its safe state"
    if failure is not None:
        return "ERROR", ExitCode.BENCH_FAILED, str(failure)
    reasons = [
        f"{item.model} {item.split} {item.quantity} over {item.limit:g} deg/s" for item in judged if not item.passed
    ]
    failed = int((points["verdict"] == "fail").sum())
    planned = entries[0]["points_planned"] * len(entries[0]["duts"])
    reasons += [f"{failed} of {len(points)} points failed their quality limits"] if failed else []
    reasons += [f"{planned - len(points)} points were not measured"] if len(points) < planned else []
    reasons += list(notes)
    if reasons:
        return "FAIL", ExitCode.FAILED, "; ".join(reasons)
    return "PASS", ExitCode.PASSED, "all limits met"


def failure_of(entries: Sequence[Entry]) -> FogbenchError | None:
    """How a run on disk failed, so that it can be folded again; None if it came to its end."""
    end = next((entry for entry in reversed(entries) if entry["kind"] == "end"), None)
    if end is None:
        return BenchFailure("the run did not come to its end (its process died)")
    if end["failure"] is None:
        return None
    kind = Interrupted if end["failure"]["kind"] == "Interrupted" else BenchFailure
    return kind(end["failure"]["text"])
