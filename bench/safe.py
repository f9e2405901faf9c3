"""Leaving the bench safe (law 8): table to rest, chamber and supply as their safe states say, read back and logged.

Runs on every exit: success, failure, Ctrl-C, SIGTERM. Instruments come in the order that their `safe:` blocks declare.
All of one order are commanded first and then waited for, each until its own deadline; a command or a readback that
fails is tried again until then, over a port that is opened anew if need be. What fails is logged, stops nothing else,
and never hides the first error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Protocol, cast

from bench.bench_entries import ChamberEntry, ChamberSafe, SupplySafe, TableSafe
from bench.benchfile import Instrument
from bench.engine import Engine
from bench.errors import FogbenchError
from bench.instruments import Chamber, RateTable, Supply
from bench.opening import open_known
from drivers.errors import DriverError, PortError, Refused

NOT_SAFE = "NOT SAFE"
AT_REST_DPS = 0.05
# A controller set to whole degrees, of whichever unit, rounds a setpoint by up to half of one.
SETPOINT_TOLERANCE_K = 0.51
# A reading this far outside the chamber's limits is noise at their edge; farther out it is no temperature to hold.
HOLD_MARGIN_K = 2.0
POLL_S = 0.25
# Looks in a row without a good answer after which a port is opened anew; one that says that it is gone is at once.
UNANSWERED = 2


class Switchable(Protocol):
    """A chamber that can be switched off; the settings of its driver say so by `can_switch_off`."""

    def off(self) -> None: ...
    def is_off(self) -> bool: ...
    def temperature_degc(self) -> float: ...


class _NotYet(Exception):
    """What is read back is not the safe state yet; the message says what it is."""


class _Way(Protocol):
    """How one kind of instrument is made safe: `command` sends it there, `reached` says in words what was read back, or
    raises _NotYet."""

    def command(self, driver: Any) -> None: ...
    def reached(self, driver: Any) -> str: ...


@dataclass
class _Making:
    """One instrument on its way to its safe state."""

    engine: Engine
    instrument: Instrument
    safe: TableSafe | ChamberSafe | SupplySafe
    way: _Way
    driver: Any
    commanded: bool = False
    unanswered: int = 0
    why: str = ""

    def advance(self) -> str | None:
        """Command what is not commanded yet, then look; what was read back once the state is reached."""
        try:
            return self._look()
        except (Refused, _NotYet, FogbenchError, OSError, ValueError) as error:
            self.why, self.unanswered = str(error), 0
        except DriverError as error:
            self.why, self.unanswered = str(error), self.unanswered + 1
            if isinstance(error, PortError) or self.unanswered >= UNANSWERED:
                return self._look_again()
        return None

    def _look(self) -> str:
        if not self.commanded:
            self.way.command(self.driver)
            self.commanded = True
        text = self.way.reached(self.driver)
        self.unanswered = 0
        return text

    def _look_again(self) -> str | None:
        """Over a port that is opened anew: the instrument may have been off, what it had heard is commanded again."""
        try:
            self.driver = open_known(self.engine.station, self.instrument, self.engine.clock)
            self.commanded, self.unanswered = False, 0
            return self._look()
        except (_NotYet, DriverError, FogbenchError, OSError, ValueError) as error:
            self.why = f"{self.why}. Its port was opened anew: {error}"
            return None


def make_safe(engine: Engine) -> list[str]:
    """Bring table, chamber and supply to their safe states. Returns what did not work, in words.

    After a second request to stop (`hurried`) a real bench is commanded as ever but not waited for: what is not there
    at the first look is told as not safe, and the guardian sees to it.
    """
    failures: list[str] = []
    states = sorted(_states(engine), key=_order)
    for _, together in groupby(states, key=_order):
        _bring(engine, list(together), failures)
    try:
        engine.log.commit()
    except OSError as error:
        failures.append(f"journal: {error}")
    return failures


def _states(engine: Engine) -> Iterator[_Making]:
    file = engine.bench.file
    if file.rate_table:
        yield from _making(engine, engine.bench.rate_table, file.rate_table.safe, _Rest(engine, file.rate_table.safe))
    if file.chamber:
        safe = file.chamber.safe
        yield from _making(engine, engine.bench.chamber, safe, _Off() if safe.action == "off" else _Asked(engine, safe))
    # A DUT must not be cycled by accident: a supply that is to be kept as it is hears nothing.
    if file.supply and file.supply.safe.action == "off":
        yield from _making(engine, engine.bench.supply, file.supply.safe, _Unpowered())


def _order(state: _Making) -> int:
    return state.safe.order


def _making(
    engine: Engine, item: Instrument | None, safe: TableSafe | ChamberSafe | SupplySafe, way: _Way
) -> Iterator[_Making]:
    driver = engine.station.commanded(item.role) if item else None
    if item is not None and driver is not None:
        yield _Making(engine, item, safe, way, driver)


def _bring(engine: Engine, states: Sequence[_Making], failures: list[str]) -> None:
    """Command all of `states`, then wait for each until its deadline."""
    clock = engine.clock
    began_s, waiting = clock.now(), list(states)
    while True:
        for state in list(waiting):
            text = state.advance()
            spent_s = clock.now() - began_s
            hurried = clock.stop.hurried and not clock.virtual
            if text is None and spent_s <= state.safe.timeout_s and not hurried:
                continue
            waiting.remove(state)
            if text is None:
                in_time = f"{spent_s:.1f} s after it was commanded, allowed are {state.safe.timeout_s:g} s"
                advice = "It was not waited for, as asked" if hurried else "Use the E-stop or its panel"
                text = f"{NOT_SAFE}: {state.instrument.name}: {state.why} ({in_time}). {advice}."
                failures.append(text)
            engine.log.append(
                "safe", clock.now(), instrument=state.instrument.name, text=text, took_s=round(spent_s, 2)
            )
        if not waiting:
            return
        clock.wait(POLL_S)


@dataclass
class _Rest:
    """To rest at the table's own deceleration, under power; the drive is released at rest and never before."""

    engine: Engine
    safe: TableSafe

    def command(self, table: RateTable) -> None:
        self.engine.readbacks.rate_setpoint_dps = 0.0
        table.stop()

    def reached(self, table: RateTable) -> str:
        rate = table.rate_dps()
        if abs(rate) > AT_REST_DPS:
            raise _NotYet(f"still turning at {rate:g} deg/s")
        if self.safe.release:
            table.release()
        return f"at rest, reads {rate:+.4f} deg/s{', drive released' if self.safe.release else ''}"


class _Unpowered:
    """The supply's output off."""

    def command(self, supply: Supply) -> None:
        supply.switch(False)

    def reached(self, supply: Supply) -> str:
        if supply.is_on():
            raise _NotYet("its output still reads on")
        return "output off"


class _Off:
    """The chamber switched off."""

    def command(self, chamber: Switchable) -> None:
        chamber.off()

    def reached(self, chamber: Switchable) -> str:
        if not chamber.is_off():
            raise _NotYet("still on")
        return f"off, reads {chamber.temperature_degc():g} degC"


@dataclass
class _Asked:
    """A chamber that is asked for a setpoint, and again if something else is read back."""

    engine: Engine
    safe: ChamberSafe
    setpoint_degc: float = 0.0

    def command(self, chamber: Chamber) -> None:
        hold = self.safe.action == "hold"
        setpoint = self._present_degc(chamber) if hold else self.safe.temperature_degc
        chamber.set_ramp_degc_min(None if hold else self.safe.rate_degc_min)
        chamber.set_setpoint_degc(setpoint)
        self.setpoint_degc = setpoint
        self.engine.readbacks.chamber_setpoint_degc = setpoint

    def _present_degc(self, chamber: Chamber) -> float:
        """The temperature to hold. Raises FogbenchError if what is read cannot be one."""
        reading = chamber.temperature_degc()
        limits = cast(ChamberEntry, self.engine.bench.file.chamber).limits.temperature
        held = min(max(round(reading, 1) + 0.0, limits.from_degc), limits.to_degc)
        if abs(held - reading) > HOLD_MARGIN_K:
            raise FogbenchError(f"it reads {reading:g} degC, outside its limits, which cannot be held")
        return held

    def reached(self, chamber: Chamber) -> str:
        setpoint = chamber.setpoint_degc()
        if abs(setpoint - self.setpoint_degc) > SETPOINT_TOLERANCE_K:
            self.command(chamber)
            raise _NotYet(f"its setpoint reads {setpoint:g} degC, {self.setpoint_degc:g} degC was asked for")
        return f"setpoint {setpoint:g} degC ({self.safe.action}), reads {chamber.temperature_degc():g} degC"
