"""One run from check to report: the run folder appears when the bench answers, and is complete whatever happens."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.acquire import RecordingAcquirer
from bench.check import Checked, check
from bench.clock import Clock, StopRequest, stopwatch, utc_now
from bench.composition import open_bench, seed_of
from bench.conclude import ReportWriter, RunEnd, conclude
from bench.control import Control
from bench.dutlinks import DutLinks
from bench.earth import earth_rate_dps
from bench.engine import Engine, Listener
from bench.errors import BenchFailure, FogbenchError, Interrupted, UserMistake
from bench.forecast import Forecast, rehearse
from bench.guardian import FILE as GUARDIAN_FILE
from bench.guardian import Guardian
from bench.guards import checker, guards_of, responder
from bench.journal import Journal, load_journal
from bench.links import CommandedLinks
from bench.locks import port_locks, run_lock
from bench.manifest import head_of, sha256
from bench.missing import Missing, only_missing, steps_for
from bench.overrides import Override
from bench.points import finished_rows
from bench.procedure.plan import PlannedStep
from bench.rawstore import RawStore
from bench.record import SeriesRecorder
from bench.resumption import Interruption, pauser, reestablish
from bench.runfolder import DECLARATIONS, INCLUDED, copy_into, new_run_folder, sync_folder
from bench.safe import NOT_SAFE, make_safe
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
class Resumed:
    """The earlier part of a run that goes on: where it stopped, for how long it stood, and which attempt this is.

    missing: of a run whose plan was carried out, what alone is measured now. may_be_absent: DUTs that were lost when it
    stopped.
    """

    stop: Interruption
    gap_s: float
    attempt: int
    accepted: str = ""
    missing: Missing | None = None
    may_be_absent: Collection[str] = ()

    @property
    def duts(self) -> Collection[str] | None:
        """The only DUTs that are opened; None: all."""
        return None if self.missing is None else self.missing.duts


@dataclass(frozen=True)
class Prepared:
    """A run that may begin or go on: checked, rehearsed, named; nothing was touched yet."""

    folder: Path
    checked: Checked
    seed: int
    forecast: Forecast
    overrides: Sequence[Override] = ()
    resumed: Resumed | None = None


def prepare(request: RunRequest) -> Prepared:
    """Check and rehearse a run. Raises UserMistake; touches neither hardware nor results."""
    checked = check(request.procedure, request.bench, request.overrides)
    run_id = request.run_id
    if run_id is None:
        run_id = f"{checked.head.procedure}-{utc_now().replace('-', '').replace(':', '')}"
    folder = new_run_folder(request.results, run_id)
    _check_disk(request.results, checked.disk_bytes)
    seed = request.seed if request.seed is not None else seed_of(checked.bench)
    return Prepared(folder, checked, seed, rehearse(checked, seed), request.overrides)


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
    checked, folder, resumed = prepared.checked, prepared.folder, prepared.resumed
    start_s = resumed.stop.at_s + resumed.gap_s if resumed else 0.0
    real_ports = [item.address for item in checked.bench.instruments if not item.simulated]
    folder.parent.mkdir(parents=True, exist_ok=True)
    with (
        run_lock(folder),
        port_locks(real_ports, folder.name),
        _open(prepared, start_s) as (station, clock),
    ):
        on_stop(clock.stop)
        check_reach(station, checked.plan)
        journal = _go_on(prepared, station, clock) if resumed else _begin(prepared, station, clock)
        control = Control(folder, clock.stop)
        guardian = None if clock.virtual else Guardian(folder)
        if guardian:
            clock.stop.alive = guardian.beat
        try:
            failure = _execute(prepared, station, clock, journal, control, listener)
        finally:
            control.close()
            unwritten = _closed(journal)
            if guardian:
                _let_go(guardian, folder / "journal.jsonl")
    failure = failure or unwritten
    if clock.stop.hurried:
        text = "stopped at once: the bench was commanded to its safe state, points and report were not written"
        raise Interrupted(f"{text}. Go on with: fogbench resume {folder}")
    clock.stop.over = True
    try:
        return conclude(folder, checked.head, failure, write_report)
    except OSError as error:
        why = f"{failure}; then the results" if failure else "the results"
        text = f"{why} could not be written: {error}. What was journaled is kept; see to the disk, then"
        raise BenchFailure(f"{text}: fogbench resume {folder}") from error


def _open(prepared: Prepared, start_s: float) -> AbstractContextManager[tuple[Station, Clock]]:
    bench, seed, truth, resumed = prepared.checked.bench, prepared.seed, _truth_dir(prepared), prepared.resumed
    if resumed is None:
        return open_bench(bench, seed, truth, start_s)
    return open_bench(bench, seed, truth, start_s, resumed.duts, resumed.may_be_absent)


def _closed(journal: Journal) -> BenchFailure | None:
    """Close the journal; the failure to do so."""
    try:
        journal.close()
    except OSError as error:
        return BenchFailure(f"the journal could not be written to its end: {error}")
    return None


def _let_go(guardian: Guardian, journal: Path) -> None:
    """Dismiss the guardian if the bench was left safe for all one can read; else it goes on where we give up."""
    try:
        entries = load_journal(journal)
    except (FogbenchError, OSError):
        entries = []
    safe = [entry["text"] for entry in entries if entry["kind"] == "safe"]
    if safe and not any(text.startswith(NOT_SAFE) for text in safe[-2:]):
        guardian.dismiss()
    else:
        guardian.leave()


def _truth_dir(prepared: Prepared) -> Path | None:
    """Where the simulators of this attempt log the truth, out of the run folder; None on a real bench."""
    if not prepared.checked.bench.virtual:
        return None
    folder = prepared.folder.parent / TRUTH_FOLDER / prepared.folder.name
    return folder / f"attempt-{prepared.resumed.attempt}" if prepared.resumed else folder


def _go_on(prepared: Prepared, station: Station, clock: Clock) -> Journal:
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


def _begin(prepared: Prepared, station: Station, clock: Clock) -> Journal:
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


def _equipped(
    prepared: Prepared, station: Station, clock: Clock, journal: Journal, store: RawStore, listener: Listener
) -> Engine:
    """The engine with what measures and records; of a run taken up for what it lacks, that alone."""
    checked, resumed = prepared.checked, prepared.resumed
    earth = earth_rate_dps(checked.bench.file.site.latitude_deg)
    acquirer = RecordingAcquirer(checked.head.quality, earth, checked.head.raw, store)
    if resumed:
        acquirer.remember(finished_rows(load_journal(prepared.folder / "journal.jsonl")), checked.plan)
    verbs = only_missing(STEPS, resumed.missing) if resumed and resumed.missing is not None else STEPS
    engine = Engine(verbs, checked.bench, station, clock, journal, acquirer, listener)
    engine.recorder = SeriesRecorder(checked.head.quality, store, frames_too=checked.head.raw == "frames")
    return engine


def _watched(engine: Engine, checked: Checked, control: Control) -> DutLinks:
    """Have links and guards looked after and pauses kept; the links of the DUTs."""
    plan, policy = checked.plan, checked.head.resume
    links = DutLinks(checked.bench, engine.station, checked.bench.file.links)
    links.attach(engine, pauser(control, plan, policy))
    engine.on_link = CommandedLinks(checked.bench, plan, policy).restore
    engine.on_trip = responder(guards_of(checked.bench.file.guards, checked.head.guards), plan, policy)
    return links


def _begun(engine: Engine, prepared: Prepared) -> Sequence[PlannedStep]:
    """The bench under power, guarded and where the run stopped; the steps that are left."""
    checked, resumed = prepared.checked, prepared.resumed
    energise(engine.station, engine.clock)
    engine.check_guards = checker(guards_of(checked.bench.file.guards, checked.head.guards))
    if resumed is None:
        return checked.plan
    if resumed.missing is not None:
        return steps_for(checked.plan, resumed.missing)
    return reestablish(engine, checked.plan, resumed.stop, resumed.gap_s, checked.head.resume)


def _execute(
    prepared: Prepared, station: Station, clock: Clock, journal: Journal, control: Control, listener: Listener
) -> FogbenchError | None:
    """Run the plan and leave the bench safe; how it failed, or None."""
    began = stopwatch()
    store = RawStore(prepared.folder / "raw", clock.stop.look)
    engine = _equipped(prepared, station, clock, journal, store, listener)
    links = _watched(engine, prepared.checked, control)
    failure: FogbenchError | None = None
    try:
        engine.run(_begun(engine, prepared))
    except Interrupted as error:
        failure = error
        journal.append("interrupted", clock.now(), text="asked to stop; bringing the bench to its safe state")
    except (FogbenchError, DriverError, OSError) as error:
        failure = error if isinstance(error, FogbenchError) else BenchFailure(str(error))
        journal.append("error", clock.now(), text=str(error))
    finally:
        clock.stop.forget()
        engine.check_guards = lambda engine: None
        unsafe = make_safe(engine)
        clock.stop.safe = True
    try:
        store.close()
    except (BenchFailure, Interrupted) as error:
        failure = failure or error
        journal.append("error", clock.now(), text=str(error))
    if unsafe and failure is None:
        failure = BenchFailure("the bench could not be made safe")
    losses = {name: asdict(counts) for name, counts in links.losses().items()}
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
