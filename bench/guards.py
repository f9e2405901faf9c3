"""Guards: what happens when something that must hold while a run is under way does not.

Checked before the first step, on entry to every step and at every readback; a guard whose signal is lost has tripped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from bench.engine import Engine, Tripped
from bench.errors import BenchFailure
from bench.procedure.conditions import Guard
from bench.procedure.plan import PlannedStep
from bench.units import format_duration
from bench.watches import Trip, Watches

# A step that was held this often trips its guard by itself.
MOST_HOLDS = 10
# What every bench is guarded against, unless its file or the procedure has a guard of the same name.
BUILT_IN = (
    Guard.model_validate({"name": "chamber_alarm", "watch": "chamber_alarm"}),
    Guard.model_validate({"name": "table_fault", "watch": "table_fault"}),
)


def guards_of(engine_guards: Sequence[Guard], more: Sequence[Guard]) -> list[Guard]:
    """The built-in guards, then those of bench and procedure; a later one replaces an earlier one of its name."""
    return list({guard.name: guard for guard in (*BUILT_IN, *engine_guards, *more)}.values())


def checker(guards: Sequence[Guard]) -> Callable[[Engine], None]:
    """What the engine calls to have its guards checked.

    DUTs whose guards say so are dropped on the spot, and what is under way goes on; for all other guards that do not
    hold it raises Tripped. Its first call reads everything, so that no guard begins without a signal.
    """
    watches, installed = Watches(guards), False

    def check(engine: Engine) -> None:
        nonlocal installed
        if not installed:
            installed = True
            engine.poll()
            return
        trips = list(watches.tripped(engine))
        if any(guard.action == "abort" for guard, _, _ in trips):
            raise Tripped(trips)
        _drop(engine, [trip for trip in trips if trip[0].action == "drop"])
        if left := [trip for trip in trips if trip[0].action == "hold"]:
            raise Tripped(left)

    return check


def _drop(engine: Engine, trips: Sequence[Trip]) -> None:
    """Go on without the DUTs whose guards tripped; of two guards on one DUT both are told."""
    texts: dict[str, list[str]] = {}
    for guard, name, text in trips:
        if name is not None:
            texts.setdefault(name, []).append(f"guard '{guard.name}': {text}")
    for name, why in texts.items():
        engine.log.append("guard", engine.clock.now(), text="; ".join(why))
        engine.log.append("dropped", engine.clock.now(), dut=name, text="; ".join(why))
        engine.station.drop(name)
        engine.readbacks.dut_degc.pop(name, None)
    if texts:
        engine.log.commit()
        if not (engine.station.gyros or engine.station.off or engine.station.absent):
            raise BenchFailure(f"no DUT is left: {'; '.join(text for why in texts.values() for text in why)}")


class Holds:
    """What is done when guards tripped: the run ends, or the bench is held until all is clear."""

    def __init__(self) -> None:
        self._of_step: Counter[int] = Counter()

    def see_to(self, engine: Engine, step: PlannedStep, trip: Tripped) -> None:
        """Returns when the bench may go on. Raises BenchFailure if a guard says abort, or if it was held for long or
        often enough."""
        where = f"step {step.number} '{step.verb}' ({step.mark})"
        engine.log.append("guard", engine.clock.now(), text=str(trip), step=step.number)
        _abort_if_asked(trip, where)
        self._of_step[step.number] += 1
        if self._of_step[step.number] > MOST_HOLDS:
            raise BenchFailure(f"{where}: {trip} (given up after it was held {MOST_HOLDS} times)")
        _hold(engine, trip, where)


def _abort_if_asked(trip: Tripped, where: str) -> None:
    if trip.trips[0][0].action == "abort":
        raise BenchFailure(f"{where}: {trip}")


def _hold(engine: Engine, trip: Tripped, where: str) -> None:
    """Table at rest, chamber at its setpoint, until no guard has been tripped for the longest time that any of those
    asks for that tripped meanwhile."""
    if engine.station.table:
        engine.station.table.set_rate_dps(0.0)
        engine.readbacks.rate_setpoint_dps = 0.0
    held = {guard.name: guard for guard, _, _ in trip.trips}
    engine.log.append("held", engine.clock.now(), text=f"by guard {_named(held)}")
    engine.log.commit()
    began_s, clear_s = engine.clock.now(), None
    while True:
        clear_for_s = max(guard.clear_for_s for guard in held.values())
        if clear_s is not None and engine.clock.now() - clear_s >= clear_for_s:
            break
        engine.clock.wait(min(engine.watch_period_s, max(clear_for_s, 1.0)))
        try:
            engine.poll()
            clear_s = engine.clock.now() if clear_s is None else clear_s
        except Tripped as again:
            clear_s = None
            _abort_if_asked(again, f"{where}, held by guard {_named(held)}")
            held |= {guard.name: guard for guard, _, _ in again.trips}
            _give_up_if_late(again, engine.clock.now() - began_s)
    engine.log.append("clear", engine.clock.now(), text=f"after {format_duration(engine.clock.now() - began_s)}")


def _named(guards: dict[str, Guard]) -> str:
    return ", ".join(f"'{name}'" for name in guards)


def _give_up_if_late(trip: Tripped, held_s: float) -> None:
    late = [guard for guard, _, _ in trip.trips if held_s > guard.timeout_s]
    if late:
        raise BenchFailure(f"held for {format_duration(late[0].timeout_s)} and not clear: {trip}")
