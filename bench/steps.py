"""What each verb does: a function of the engine and the planned step (law 5)."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from bench.engine import Engine
from bench.instruments import Chamber, RateTable
from bench.power import power
from bench.procedure.language import (
    Dwell,
    GoToPosition,
    Note,
    RampTemperature,
    SetRate,
    SetTemperature,
    Settle,
    Soak,
)
from bench.procedure.plan import PlannedStep
from bench.units import format_duration

# Table readbacks while waiting for a rate or a position: often enough to see the ringing of a servo (0.2-2 s).
SETTLE_PERIOD_S = 0.25
# How often all is read back and the guards are checked meanwhile: seldom enough that an ordinary settle is not delayed.
SETTLE_GUARD_S = 5.0


def set_temperature(engine: Engine, step: PlannedStep) -> None:
    args = cast(SetTemperature, step.args)
    _move_chamber(engine, step, args.to_degc, None, args.band_k, args.timeout_s)


def ramp_temperature(engine: Engine, step: PlannedStep) -> None:
    args = cast(RampTemperature, step.args)
    _move_chamber(engine, step, args.to_degc, args.rate_degc_min, args.band_k, args.timeout_s)


def _move_chamber(
    engine: Engine, step: PlannedStep, to_degc: float, rate_degc_min: float | None, band_k: float, timeout_s: float
) -> None:
    chamber = _chamber(engine, step)
    chamber.set_ramp_degc_min(rate_degc_min)
    chamber.set_setpoint_degc(to_degc)
    engine.readbacks.chamber_setpoint_degc = to_degc
    began = engine.clock.now()
    while True:
        readback = engine.poll().chamber_degc
        if readback is not None and abs(readback - to_degc) <= band_k:
            return
        if engine.clock.now() - began >= timeout_s:
            raise engine.fail(
                step,
                f"the chamber reads {readback} degC, not {to_degc:g} ± {band_k:g} degC, after "
                f"{format_duration(timeout_s)}. Can it reach that with this load? Then raise 'timeout' or 'band'.",
            )
        engine.watch(min(20.0, timeout_s))


def soak(engine: Engine, step: PlannedStep) -> None:
    args = cast(Soak, step.args)
    began = engine.clock.now()
    engine.watch(args.for_s)
    if args.until is None:
        return
    limit, timeout = args.until.slope_degc_min, cast(float, args.timeout_s)
    while True:
        slopes = engine.dut_slopes(args.until.over_s)
        if slopes is not None and all(abs(value) <= limit for value in slopes.values()):
            return
        if engine.clock.now() - began >= timeout:
            break
        engine.watch(min(60.0, began + timeout - engine.clock.now()))
    shown = ", ".join(f"{name} {value:+.4f}" for name, value in (slopes or {}).items()) or "not known yet"
    message = f"DUT temperature slope is still outside ± {limit:g} degC/min after {format_duration(timeout)}: {shown}."
    if args.on_timeout == "fail":
        raise engine.fail(step, f"{message} Raise 'timeout' or the slope, or set on_timeout: continue.")
    engine.log.append("warning", engine.clock.now(), step=step.number, text=message)


def set_rate(engine: Engine, step: PlannedStep) -> None:
    args = cast(SetRate, step.args)
    _table(engine, step).set_rate_dps(args.to_dps)
    engine.readbacks.rate_setpoint_dps = args.to_dps


def settle(engine: Engine, step: PlannedStep) -> None:
    args = cast(Settle, step.args)
    table, wanted = _table(engine, step), engine.readbacks.rate_setpoint_dps
    if wanted is None:
        raise engine.fail(step, "there is no rate setpoint to settle to. Put a set_rate or a rate sweep before it.")
    readback = _hold_in_band(engine, table.rate_dps, wanted, args.band_dps, args.for_s, args.timeout_s)
    if readback is not None:
        raise engine.fail(
            step,
            f"the table reads {readback:g} deg/s and did not stay within {wanted:g} ± {args.band_dps:g} deg/s for "
            f"{args.for_s:g} s in {args.timeout_s:g} s. {_table_state(table)}",
        )


def go_to_position(engine: Engine, step: PlannedStep) -> None:
    args = cast(GoToPosition, step.args)
    table = _table(engine, step)
    table.go_to_deg(args.to_deg)
    engine.readbacks.rate_setpoint_dps = 0.0

    def error_deg() -> float:
        return (table.position_deg() - args.to_deg + 180.0) % 360.0 - 180.0

    readback = _hold_in_band(engine, error_deg, 0.0, args.band_deg, 0.0, args.timeout_s)
    if readback is not None:
        raise engine.fail(
            step,
            f"the table is {readback:+g} deg from {args.to_deg:g} deg, outside ± {args.band_deg:g} deg, after "
            f"{args.timeout_s:g} s. {_table_state(table)}",
        )


def _hold_in_band(
    engine: Engine, read: Callable[[], float], wanted: float, band: float, for_s: float, timeout_s: float
) -> float | None:
    """Wait until `read` has stayed within `band` for `for_s`; the last readback if that did not happen in time."""
    began = checked = engine.clock.now()
    inside_since: float | None = None
    while True:
        readback, now = read(), engine.clock.now()
        if abs(readback - wanted) <= band:
            inside_since = now if inside_since is None else inside_since
            if now - inside_since >= for_s - 1e-9:
                return None
        else:
            inside_since = None
        if now - began >= timeout_s:
            return readback
        if now - checked >= SETTLE_GUARD_S:
            engine.read_instruments()
            checked = now
        engine.clock.wait(SETTLE_PERIOD_S)


def dwell(engine: Engine, step: PlannedStep) -> None:
    engine.watch(cast(Dwell, step.args).for_s)


def acquire(engine: Engine, step: PlannedStep) -> None:
    engine.acquirer.acquire(engine, step)


def record(engine: Engine, step: PlannedStep) -> None:
    engine.recorder.begin(engine, step)


def end_record(engine: Engine, step: PlannedStep) -> None:
    engine.recorder.end(engine)


def note(engine: Engine, step: PlannedStep) -> None:
    engine.log.append("note", engine.clock.now(), text=cast(Note, step.args).text)


def _chamber(engine: Engine, step: PlannedStep) -> Chamber:
    if engine.station.chamber is None:
        raise engine.fail(step, "this bench has no chamber.")
    return engine.station.chamber


def _table(engine: Engine, step: PlannedStep) -> RateTable:
    if engine.station.table is None:
        raise engine.fail(step, "this bench has no rate table.")
    return engine.station.table


def _table_state(table: RateTable) -> str:
    fault = table.fault()
    return f"The table reports: {fault}." if fault else "The table reports no fault; is the band wider than its ripple?"


STEPS: dict[str, Callable[[Engine, PlannedStep], None]] = {
    function.__name__: function
    for function in (
        set_temperature,
        ramp_temperature,
        soak,
        set_rate,
        settle,
        go_to_position,
        dwell,
        power,
        acquire,
        record,
        end_record,
        note,
    )
}
