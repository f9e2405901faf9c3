"""One run from check to report: the run folder appears when the bench answers, and is complete whatever happens."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.acquire import RecordingAcquirer
from bench.check import Checked, check
from bench.clock import Clock, StopRequest, stopwatch, utc_now
from bench.composition import open_bench, seed_of
from bench.conclude import ReportWriter, RunEnd, conclude
from bench.earth import earth_rate_dps
from bench.engine import Engine, Listener
from bench.errors import BenchFailure, FogbenchError, Interrupted, UserMistake
from bench.forecast import Forecast, rehearse
from bench.journal import Journal
from bench.manifest import head_of
from bench.overrides import Override
from bench.rawstore import RawStore
from bench.runfolder import copy_into, new_run_folder
from bench.safe import make_safe
from bench.station import Station, check_reach, energise
from bench.steps import STEPS
from drivers.errors import DriverError

TRUTH_FOLDER = ".truth"


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
    run_id = request.run_id
    if run_id is None:
        run_id = f"{checked.head.procedure}-{utc_now().replace('-', '').replace(':', '')}"
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
    write_report: ReportWriter | None = None,
) -> RunEnd:
    """Carry out a prepared run. Raises BenchFailure only if the bench does not answer; later failures are outcomes.

    `on_stop` gets the handle with which a signal handler may ask the run to end in order.
    """
    checked, folder = prepared.checked, prepared.folder
    truth_dir = prepared.request.results / TRUTH_FOLDER / folder.name if checked.bench.virtual else None
    with open_bench(checked.bench, prepared.seed, truth_dir) as (station, clock):
        on_stop(clock.stop)
        check_reach(station, checked.plan)
        journal = _begin(prepared, station, clock)
        try:
            failure = _execute(prepared, station, clock, journal, listener)
        finally:
            journal.close()
    return conclude(folder, checked.head.analysis, failure, write_report)


def _begin(prepared: Prepared, station: Station, clock: Clock) -> Journal:
    """Create the run folder with the copies and the head of the journal."""
    folder, checked = prepared.folder, prepared.checked
    try:
        folder.mkdir(parents=True)
        copy_into(folder, "procedure.yaml", prepared.request.procedure)
        copy_into(folder, "bench.yaml", prepared.request.bench)
        for number, path in enumerate(checked.procedure.included, start=1):
            copy_into(folder, f"included/{number:02d}-{path.name}", path)
        for path in checked.bench.declaration_files:
            copy_into(folder, f"declarations/{path.name}", path)
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
        failure = BenchFailure("the bench could not be made safe")
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
