"""One attempt at a plan on an open bench: from power on to the safe state, journaled, whatever happens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from bench.acquire import RecordingAcquirer
from bench.check import Checked
from bench.clock import Clock, stopwatch, utc_now
from bench.control import Control
from bench.dutlinks import DutLinks
from bench.earth import earth_rate_dps
from bench.engine import Engine, Listener
from bench.errors import BenchFailure, FogbenchError, Interrupted
from bench.guards import checker, guards_of
from bench.journal import Journal, load_journal
from bench.links import CommandedLinks
from bench.missing import only_missing, steps_for
from bench.points import finished_rows
from bench.preparation import Prepared
from bench.procedure.plan import PlannedStep
from bench.rawstore import RawStore
from bench.record import SeriesRecorder
from bench.recovery import Recovery
from bench.resumption import pauser
from bench.safe import make_safe
from bench.station import Station
from bench.steps import STEPS
from drivers.errors import DriverError


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


def _watched(engine: Engine, checked: Checked, control: Control) -> tuple[DutLinks, Recovery]:
    """Have links and guards looked after and pauses kept; the links of the DUTs, and what overcomes trouble."""
    plan, policy = checked.plan, checked.head.resume
    links = DutLinks(checked.bench, engine.station, checked.bench.file.links)
    links.attach(engine, pauser(control, plan, policy))
    recovery = Recovery(plan, policy, CommandedLinks(checked.bench))
    engine.recover = recovery.recover
    return links, recovery


def _begun(engine: Engine, prepared: Prepared, recovery: Recovery) -> Sequence[PlannedStep]:
    """The bench under power, guarded and where the run stopped; the steps that are left."""
    checked, resumed = prepared.checked, prepared.resumed
    recovery.energise(engine)
    if engine.station.switched_on:
        text = "the supply's output was off: switched on"
        engine.log.append("power", engine.clock.now(), to="on", duts=list(checked.bench.powered), text=text)
    engine.check_guards = checker(guards_of(checked.bench.file.guards, checked.head.guards))
    if resumed is None:
        return checked.plan
    if resumed.missing is not None:
        return steps_for(checked.plan, resumed.missing)
    return recovery.take_up(engine, resumed.stop, resumed.gap_s)


def execute(
    prepared: Prepared, station: Station, clock: Clock, journal: Journal, control: Control, listener: Listener
) -> FogbenchError | None:
    """Run the plan and leave the bench safe; how it failed, or None."""
    began = stopwatch()
    store = RawStore(prepared.folder / "raw", clock.stop.look)
    engine = _equipped(prepared, station, clock, journal, store, listener)
    links, recovery = _watched(engine, prepared.checked, control)
    failure: FogbenchError | None = None
    try:
        engine.run(_begun(engine, prepared, recovery))
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
