"""Guards: what must hold while a run is under way, and what happens when it does not.

Checked before the first step, on entry to every step and at every readback; a guard whose signal is lost has tripped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from bench.engine import Engine, Tripped
from bench.errors import BenchFailure
from bench.procedure.language import Guard, ResumePolicy
from bench.procedure.plan import PlannedStep
from bench.resumption import Interruption, reestablish
from bench.units import format_duration

Trip = tuple[Guard, str | None, str]

# A DUT is silent if nothing valid came from it for this long and for this many of its frames.
SILENT_S, SILENT_FRAMES = 2.0, 20

# What every bench is guarded against, unless its file or the procedure has a guard of the same name.
BUILT_IN = (
    Guard.model_validate({"name": "chamber_alarm", "watch": "chamber_alarm"}),
    Guard.model_validate({"name": "table_fault", "watch": "table_fault"}),
)


def guards_of(engine_guards: Sequence[Guard], more: Sequence[Guard]) -> list[Guard]:
    """The built-in guards, then those of bench and procedure; a later one replaces an earlier one of its name."""
    return list({guard.name: guard for guard in (*BUILT_IN, *engine_guards, *more)}.values())


def checker(guards: Sequence[Guard]) -> Callable[[Engine], None]:
    """What the engine calls to have its guards checked; raises Tripped with all that do not hold."""

    def check(engine: Engine) -> None:
        trips = list(tripped(engine, guards))
        if trips:
            raise Tripped(trips)

    return check


def tripped(engine: Engine, guards: Sequence[Guard]) -> Iterator[Trip]:
    """The guards that do not hold now, judged by the newest readbacks."""
    for guard in guards:
        if guard.watch == "dut_temperature":
            yield from _of_duts(engine, guard)
        elif (text := _of_bench(engine, guard)) is not None:
            yield guard, None, text


def _of_bench(engine: Engine, guard: Guard) -> str | None:
    station, now = engine.station, engine.readbacks
    if guard.watch == "chamber_alarm":
        alarm = station.chamber.alarm() if station.chamber else None
        return f"the chamber reports {alarm}" if alarm else None
    if guard.watch == "table_fault":
        fault = station.table.fault() if station.table else None
        return f"the rate table reports {fault}" if fault else None
    if guard.watch == "rate":
        limit = guard.max_rate_dps or 0.0
        fast = now.rate_dps is not None and abs(now.rate_dps) > limit
        return f"the table turns at {now.rate_dps:g} deg/s, allowed are ± {limit:g}" if fast else None
    return _outside(guard, "the chamber", now.chamber_degc)


def _of_duts(engine: Engine, guard: Guard) -> Iterator[Trip]:
    for name, gyro in engine.station.gyros.items():
        silent_s = engine.silent_s.get(name, 0.0)
        if silent_s > max(SILENT_S, SILENT_FRAMES / gyro.data_rate_hz):
            yield guard, name, f"{name}: nothing valid was received for {format_duration(silent_s)}"
        elif (text := _outside(guard, name, engine.readbacks.dut_degc.get(name))) is not None:
            yield guard, name, text


def _outside(guard: Guard, what: str, degc: float | None) -> str | None:
    band = guard.inside
    if band is None or degc is None or band.from_degc <= degc <= band.to_degc:
        return None
    return f"{what} reads {degc:g} degC, allowed are {band.from_degc:g} to {band.to_degc:g} degC"


def responder(
    guards: Sequence[Guard], plan: Sequence[PlannedStep], policy: ResumePolicy
) -> Callable[[Engine, PlannedStep, Tripped], None]:
    """What the engine calls when guards tripped: returns when the broken-off step may be tried again."""

    def respond(engine: Engine, step: PlannedStep, trip: Tripped) -> None:
        while True:
            engine.log.append("guard", engine.clock.now(), text=str(trip), step=step.number)
            first = trip.trips[0][0]
            if first.action == "abort":
                raise BenchFailure(f"step {step.number} '{step.verb}' ({step.mark}): {trip}")
            before_degc, began_s = dict(engine.readbacks.dut_degc), engine.clock.now()
            if first.action == "drop":
                _drop(engine, trip)
                return
            _hold(engine, guards, first)
            try:
                stop = Interruption(step.number - 1, began_s, 0.0, before_degc)
                reestablish(engine, plan, stop, engine.clock.now() - began_s, policy)
                return
            except Tripped as again:
                trip = again

    return respond


def _drop(engine: Engine, trip: Tripped) -> None:
    """Go on without the DUTs whose guards tripped."""
    for guard, name, text in trip.trips:
        if guard.action == "drop" and name in engine.station.gyros:
            del engine.station.gyros[name]
            engine.readbacks.dut_degc.pop(name, None)
            engine.log.append("dropped", engine.clock.now(), dut=name, text=text)
    if not engine.station.gyros:
        raise BenchFailure(f"no DUT is left: {trip}")


def _hold(engine: Engine, guards: Sequence[Guard], first: Guard) -> None:
    """Table at rest, chamber at its setpoint, until no guard has been tripped for long enough."""
    if engine.station.table:
        engine.station.table.set_rate_dps(0.0)
    engine.log.append("held", engine.clock.now(), text=f"by guard '{first.name}'")
    engine.log.commit()
    checked, engine.check_guards = engine.check_guards, lambda engine: None
    began_s, clear_s = engine.clock.now(), None
    try:
        while clear_s is None or engine.clock.now() - clear_s < first.clear_for_s:
            engine.clock.wait(min(engine.watch_period_s, max(first.clear_for_s, 1.0)))
            engine.poll()
            trips = list(tripped(engine, guards))
            if not trips:
                clear_s = engine.clock.now() if clear_s is None else clear_s
                continue
            clear_s = None
            if engine.clock.now() - began_s > first.timeout_s:
                raise BenchFailure(f"held for {format_duration(first.timeout_s)} and not clear: {Tripped(trips)}")
    finally:
        engine.check_guards = checked
    engine.log.append("clear", engine.clock.now(), text=f"after {format_duration(engine.clock.now() - began_s)}")
