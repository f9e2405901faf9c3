"""The power verb: switches the DUTs that the supply feeds off and on, and takes them back when they send again.

A DUT that is off by command is in `station.off`: nobody reads it, and neither guards nor links take it for lost.
"""

from __future__ import annotations

from typing import cast

from bench.engine import Engine
from bench.procedure.language import Power
from bench.procedure.plan import PlannedStep
from bench.station import switch_output
from bench.units import format_duration
from drivers.codecs.batch import FrameBatch

# How soon a DUT that begins to send is heard, and how often all else is read and guarded meanwhile.
HEAR_S, GUARD_S = 0.25, 5.0


def power(engine: Engine, step: PlannedStep) -> None:
    """Carry out a power step; doing it again changes nothing."""
    args, station = cast(Power, step.args), engine.station
    if station.supply is None:
        raise engine.fail(step, "this bench has no power supply.")
    on = args.to == "on"
    if on:
        # What came on a line without power is not the gyro's, and its counter begins anew.
        for gyro in station.off.values():
            gyro.discard()
    else:
        # A supply that does not answer has switched nothing.
        station.supply.is_on()
        _lay_off(engine)
    began_s = engine.clock.now()
    if wrong := switch_output(station.supply, on, engine.clock, args.timeout_s):
        raise engine.fail(step, f"{wrong}. Look at the supply: has it tripped, is it locked to its panel?")
    text = f"the supply's output reads {args.to}"
    engine.log.append("power", engine.clock.now(), to=args.to, duts=list(engine.bench.powered), text=text)
    engine.log.commit()
    if on:
        _take_back(engine, step, began_s, args.timeout_s)


def _lay_off(engine: Engine) -> None:
    """From here on the DUTs that the supply feeds are not listened to; nothing remembers how warm they were."""
    station = engine.station
    for name in engine.bench.powered:
        if name in station.gyros:
            station.off[name] = station.gyros.pop(name)
            engine.readbacks.dut_degc.pop(name, None)
            engine.history.pop(name, None)
            engine.newest.pop(name, None)
            engine.silent_s.pop(name, None)
            engine.heard_s.pop(name, None)


def _take_back(engine: Engine, step: PlannedStep, began_s: float, timeout_s: float) -> None:
    """Listen to each DUT from its first frame; one that sends none in time is silent from now on."""
    station, clock, guarded_s = engine.station, engine.clock, began_s
    while station.off:
        for name, gyro in list(station.off.items()):
            if len(batch := gyro.take()):
                _here(engine, name, batch)
        if not station.off or clock.now() - began_s >= timeout_s:
            break
        if clock.now() - guarded_s >= GUARD_S:
            guarded_s = clock.now()
            engine.poll()
        clock.wait(HEAR_S)
    if late := list(station.off):
        waited = format_duration(clock.now() - began_s)
        text = f"nothing valid was received from {', '.join(late)} in the {waited} since power came on"
        engine.log.append("warning", clock.now(), step=step.number, text=text)
    for name in late:
        engine.heard_s[name] = began_s
        _here(engine, name, FrameBatch.empty())


def _here(engine: Engine, name: str, batch: FrameBatch) -> None:
    """The DUT is listened to again, in its place among the others; these were the first frames."""
    station = engine.station
    here = {**station.gyros, name: station.off.pop(name)}
    station.gyros.clear()
    station.gyros.update({dut: here[dut] for dut in engine.bench.duts if dut in here})
    engine.heard(name, here[name], batch)
