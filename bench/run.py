"""One run from check to report: the run folder appears when the bench answers, and is complete whatever happens."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from bench.attempt import begin, go_on
from bench.clock import Clock, StopRequest
from bench.composition import LATER_ATTEMPT, open_bench
from bench.conclude import ReportWriter, RunEnd, conclude
from bench.control import Control
from bench.engine import Listener
from bench.errors import BenchFailure, FogbenchError, Interrupted
from bench.execution import execute
from bench.guardian import Guardian
from bench.journal import Journal, load_journal
from bench.locks import port_locks, run_lock
from bench.preparation import Prepared as Prepared
from bench.preparation import RunRequest as RunRequest
from bench.preparation import prepare as prepare
from bench.safe import NOT_SAFE
from bench.station import Station, check_reach

TRUTH_FOLDER = ".truth"


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
        journal = go_on(prepared, station, clock) if resumed else begin(prepared, station, clock)
        control = Control(folder, clock.stop)
        guardian = None if clock.virtual else Guardian(folder)
        if guardian:
            clock.stop.alive = guardian.beat
        try:
            failure = execute(prepared, station, clock, journal, control, listener)
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
    return open_bench(bench, seed, truth, start_s, resumed.duts, resumed.may_be_absent, resumed.may_be_off)


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
    attempts = [number for number, entry in enumerate(entries) if entry["kind"] == "resumed"]
    last = entries[attempts[-1] if attempts else 0 :]
    safe = [entry["text"] for entry in last if entry["kind"] == "safe" and entry["instrument"] != "guardian"]
    if safe and not any(text.startswith(NOT_SAFE) for text in safe):
        guardian.dismiss()
    else:
        guardian.leave()


def _truth_dir(prepared: Prepared) -> Path | None:
    """Where the simulators of this attempt log the truth, out of the run folder; None on a real bench."""
    if not prepared.checked.bench.virtual:
        return None
    folder = prepared.folder.parent / TRUTH_FOLDER / prepared.folder.name
    return folder / f"{LATER_ATTEMPT}{prepared.resumed.attempt}" if prepared.resumed else folder
