"""Leaving the bench safe (law 8): table to rest, chamber and supply to their declared safe states, read back and logged.

Runs on every exit: success, failure, Ctrl-C, SIGTERM. Instruments come in the order that their `safe:` blocks declare.
All of one order are commanded first and then waited for, each until its own deadline; a command or a readback that
fails is tried again until then. What fails is logged, stops nothing else, and never hides the first error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Protocol, cast

from bench.benchfile import ChamberEntry, ChamberSafe, SupplySafe, TableSafe
from bench.engine import Engine
from bench.errors import FogbenchError
from bench.station import Chamber, RateTable, Supply
from drivers.errors import DriverError

NOT_SAFE = "NOT SAFE"
AT_REST_DPS = 0.05
# A controller set to whole degrees, of whichever unit, rounds a setpoint by up to half of one.
SETPOINT_TOLERANCE_K = 0.51
# A reading this far outside the chamber's limits is noise at their edge; farther out it is no temperature to hold.
HOLD_MARGIN_K = 2.0
POLL_S = 0.25


class Switchable(Protocol):
    """A chamber that can be switched off; the settings of its driver say so by `can_switch_off`."""

    def off(self) -> None: ...
    def is_off(self) -> bool: ...


class _NotYet(Exception):
    """What is read back is not the safe state yet; the message says what it is."""


@dataclass
class _Making:
    """One instrument on its way to its safe state.

    `command` sends it there. `reached` says in words what was read back, or raises _NotYet.
    """

    name: str
    order: int
    timeout_s: float
    command: Callable[[], None]
    reached: Callable[[], str]
    commanded: bool = False
    why: str = ""

    def advance(self) -> str | None:
        """Command what is not commanded yet, then look; what was read back once the state is reached."""
        try:
            if not self.commanded:
                self.command()
                self.commanded = True
            return self.reached()
        except (_NotYet, DriverError, FogbenchError, OSError, ValueError) as error:
            self.why = str(error)
            return None


def make_safe(engine: Engine) -> list[str]:
    """Bring table, chamber and supply to their safe states. Returns what did not work, in words.

    After a second request to stop (`hurried`) a real bench is commanded as ever but not waited for: what is not there
    at the first look is told as not safe, and the guardian sees to it.
    """
    failures: list[str] = []
    for _, together in groupby(sorted(_states(engine), key=lambda state: state.order), key=lambda state: state.order):
        _bring(engine, list(together), failures)
    try:
        engine.log.commit()
    except OSError as error:
        failures.append(f"journal: {error}")
    return failures


def _states(engine: Engine) -> Iterator[_Making]:
    file, station = engine.bench.file, engine.station
    if file.rate_table and station.table is not None:
        yield _rest(engine, station.table, file.rate_table.safe)
    if file.chamber and station.chamber is not None:
        yield _calm(engine, station.chamber, file.chamber.safe)
    # A DUT must not be cycled by accident: a supply that is to be kept as it is hears nothing.
    if file.supply and file.supply.safe.action == "off" and station.supply is not None:
        yield _unpowered(station.supply, file.supply.safe)


def _bring(engine: Engine, states: Sequence[_Making], failures: list[str]) -> None:
    """Command all of `states`, then wait for each until its deadline."""
    clock = engine.clock
    began_s, waiting = clock.now(), list(states)
    while True:
        for state in list(waiting):
            text = state.advance()
            spent_s = clock.now() - began_s
            hurried = clock.stop.hurried and not clock.virtual
            if text is None and spent_s <= state.timeout_s and not hurried:
                continue
            waiting.remove(state)
            if text is None:
                in_time = f"{spent_s:.1f} s after it was commanded, allowed are {state.timeout_s:g} s"
                advice = "It was not waited for, as asked" if hurried else "Use the E-stop or its panel"
                text = f"{NOT_SAFE}: {state.name}: {state.why} ({in_time}). {advice}."
                failures.append(text)
            engine.log.append("safe", clock.now(), instrument=state.name, text=text, took_s=round(spent_s, 2))
        if not waiting:
            return
        clock.wait(POLL_S)


def _rest(engine: Engine, table: RateTable, safe: TableSafe) -> _Making:
    """To rest at the table's own deceleration, under power; the drive is released at rest and never before."""

    def command() -> None:
        engine.readbacks.rate_setpoint_dps = 0.0
        table.stop()

    def reached() -> str:
        rate = table.rate_dps()
        if abs(rate) > AT_REST_DPS:
            raise _NotYet(f"still turning at {rate:g} deg/s")
        if safe.release:
            table.release()
        return f"at rest, reads {rate:+.4f} deg/s{', drive released' if safe.release else ''}"

    return _Making("rate table", safe.order, safe.timeout_s, command, reached)


def _calm(engine: Engine, chamber: Chamber, safe: ChamberSafe) -> _Making:
    if safe.action == "off":
        return _off(chamber, safe)
    asked = _Asked(engine, chamber, safe)
    return _Making("chamber", safe.order, safe.timeout_s, asked.command, asked.reached)


def _unpowered(supply: Supply, safe: SupplySafe) -> _Making:
    def reached() -> str:
        if supply.is_on():
            raise _NotYet("its output still reads on")
        return "output off"

    return _Making("power supply", safe.order, safe.timeout_s, lambda: supply.switch(False), reached)


def _off(chamber: Chamber, safe: ChamberSafe) -> _Making:
    switch = cast(Switchable, chamber)

    def reached() -> str:
        if not switch.is_off():
            raise _NotYet("still on")
        return f"off, reads {chamber.temperature_degc():g} degC"

    return _Making("chamber", safe.order, safe.timeout_s, switch.off, reached)


@dataclass
class _Asked:
    """A chamber that is asked for a setpoint, and again if something else is read back."""

    engine: Engine
    chamber: Chamber
    safe: ChamberSafe
    setpoint_degc: float = 0.0

    def command(self) -> None:
        hold = self.safe.action == "hold"
        setpoint = self._present_degc() if hold else self.safe.temperature_degc
        self.chamber.set_ramp_degc_min(None if hold else self.safe.rate_degc_min)
        self.chamber.set_setpoint_degc(setpoint)
        self.setpoint_degc = setpoint
        self.engine.readbacks.chamber_setpoint_degc = setpoint

    def _present_degc(self) -> float:
        """The temperature to hold. Raises FogbenchError if what is read cannot be one."""
        reading = self.chamber.temperature_degc()
        limits = cast(ChamberEntry, self.engine.bench.file.chamber).limits.temperature
        held = min(max(round(reading, 1) + 0.0, limits.from_degc), limits.to_degc)
        if abs(held - reading) > HOLD_MARGIN_K:
            raise FogbenchError(f"it reads {reading:g} degC, outside its limits, which cannot be held")
        return held

    def reached(self) -> str:
        setpoint = self.chamber.setpoint_degc()
        if abs(setpoint - self.setpoint_degc) > SETPOINT_TOLERANCE_K:
            self.command()
            raise _NotYet(f"its setpoint reads {setpoint:g} degC, {self.setpoint_degc:g} degC was asked for")
        return f"setpoint {setpoint:g} degC ({self.safe.action}), reads {self.chamber.temperature_degc():g} degC"
