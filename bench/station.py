"""The opened bench: drivers on their ports, and the first words with each instrument."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

from bench.benchfile import Bench, CanPort, Instrument, Role
from bench.clock import Clock
from bench.errors import BenchFailure
from bench.procedure.language import RampTemperature, SetTemperature
from bench.procedure.plan import PlannedStep
from drivers.can_ports import open_can, open_can_source
from drivers.codecs.batch import FrameBatch, Meaning
from drivers.codecs.counters import Losses
from drivers.errors import DriverError, Refused
from drivers.ports import open_byte_source, open_serial

# Long enough for a driver to tell a gyro's pace from the declared one.
LISTENING_PERIODS = 5
LISTENING_PERIOD_S = 0.5
ENERGISE_TRIES = 4
ENERGISE_WAIT_S = 0.5
# A supply's output follows within some 100 ms; gyros begin to send within a minute of it.
OUTPUT_LOOK_S, OUTPUT_S, START_UP_S = 0.25, 10.0, 60.0


class Chamber(Protocol):
    """What the engine asks of a temperature chamber."""

    def identify(self) -> str: ...
    def temperature_degc(self) -> float: ...
    def setpoint_degc(self) -> float: ...
    def set_setpoint_degc(self, value: float) -> None: ...
    def set_ramp_degc_min(self, rate: float | None) -> None: ...
    def limits_degc(self) -> tuple[float, float]: ...
    def alarm(self) -> str | None: ...


class RateTable(Protocol):
    """What the engine asks of a rate table."""

    def identify(self) -> str: ...
    def energise(self) -> None: ...
    def release(self) -> None: ...
    def set_rate_dps(self, value: float) -> None: ...
    def rate_dps(self) -> float: ...
    def go_to_deg(self, value: float) -> None: ...
    def position_deg(self) -> float: ...
    def stop(self) -> None: ...
    def fault(self) -> str | None: ...


class Supply(Protocol):
    """What the engine asks of the DUTs' power supply."""

    def identify(self) -> str: ...
    def switch(self, on: bool) -> None: ...
    def is_on(self) -> bool: ...
    def fault(self) -> str | None: ...


class Gyro(Protocol):
    """What the engine asks of a DUT: a stream of frames."""

    data_rate_hz: float

    @property
    def losses(self) -> Losses: ...

    def take(self) -> FrameBatch: ...
    def discard(self) -> None: ...
    def describe(self) -> str: ...
    def complaint(self) -> str | None: ...

    @property
    def meaning(self) -> Meaning: ...


# Where the station keeps the drivers of instruments that are commanded.
_PLACES: dict[Role, str] = {"chamber": "chamber", "rate_table": "table", "supply": "supply"}


@dataclass
class Station:
    """Opened drivers by role; `close` gives the ports back.

    gyros: the DUTs that are listened to. off: those that were switched off, which nobody misses. absent: those that are
    lost for now. unheard: those that were allowed to be absent from the beginning, and why they are. switched_on: the
    supply's output was off. closers: by the instrument's name.
    """

    chamber: Chamber | None = None
    table: RateTable | None = None
    supply: Supply | None = None
    gyros: dict[str, Gyro] = field(default_factory=dict)
    off: dict[str, Gyro] = field(default_factory=dict)
    absent: dict[str, Gyro] = field(default_factory=dict)
    unheard: dict[str, str] = field(default_factory=dict)
    identities: dict[str, str] = field(default_factory=dict)
    switched_on: bool = False
    closers: dict[str, Callable[[], None]] = field(default_factory=dict)

    def commanded(self, role: Role) -> Any:
        """The driver of chamber, rate table or supply; None if there is none."""
        return getattr(self, _PLACES[role])

    def put(self, role: Role, driver: Any) -> None:
        """Have another driver, or none, for chamber, rate table or supply."""
        setattr(self, _PLACES[role], driver)

    def drop(self, name: str) -> None:
        """Go on without a DUT for good."""
        for among in (self.gyros, self.off, self.absent):
            among.pop(name, None)

    def close(self) -> None:
        """Close every port; one that fails does not keep the others open."""
        for name in list(self.closers):
            self.shut(name)

    def shut(self, name: str) -> None:
        """Give back the port of one instrument; no error if it is gone or was never open."""
        with suppress(OSError, DriverError):
            self.closers.pop(name, lambda: None)()


def open_station(
    bench: Bench,
    clock: Clock,
    duts: Collection[str] | None = None,
    may_be_absent: Collection[str] = (),
    may_be_off: bool = False,
) -> Station:
    """Open all ports of a bench and hear from every instrument. Raises BenchFailure; nothing stays open then.

    `duts`, if given, are the only ones opened; of those in `may_be_absent` it is only noted why they are not heard. A
    supply's output that is off is switched on, unless it `may_be_off`: then the DUTs it feeds are not listened to.
    """
    station = Station()
    wanted = [item for item in bench.instruments if item.role != "dut" or duts is None or item.name in duts]
    try:
        for instrument in wanted:
            try:
                _open(station, instrument, clock)
            except DriverError as error:
                if instrument.name not in may_be_absent:
                    raise
                station.unheard[instrument.name] = str(error)
        _identify(station, bench)
        _power_up(station, bench, clock, may_be_off)
        _hear_gyros(station, bench, clock, may_be_absent)
    except DriverError as error:
        station.close()
        raise BenchFailure(str(error)) from error
    except BaseException:
        station.close()
        raise
    return station


def energise(station: Station, clock: Clock) -> None:
    """Close the table's interlock and take its drive to rate mode at rest. Raises DriverError.

    A controller may refuse a mode for a moment after its interlock closed (working ACL clients wait 0.25-0.5 s there).
    """
    if station.table is None:
        return
    for _ in range(ENERGISE_TRIES - 1):
        try:
            station.table.energise()
            return
        except Refused:
            clock.wait(ENERGISE_WAIT_S)
    station.table.energise()


def check_reach(station: Station, plan: Sequence[PlannedStep]) -> None:
    """Refuse to begin if an instrument reports an alarm, or its own limits forbid a setpoint of the plan."""
    try:
        alarm = station.chamber.alarm() if station.chamber else None
        low, high = station.chamber.limits_degc() if station.chamber else (-math.inf, math.inf)
    except DriverError as error:
        raise BenchFailure(str(error)) from error
    if alarm:
        raise BenchFailure(f"the chamber reports: {alarm}. Clear it at the controller, then start again.")
    for step in plan:
        if isinstance(step.args, SetTemperature | RampTemperature) and not low <= step.args.to_degc <= high:
            raise BenchFailure(
                f"{step.mark}: {step.args.to_degc:g} degC is outside the set-point limits of the chamber's controller, "
                f"{low:g} to {high:g} degC. Change them at the controller, or the procedure; nothing was started."
            )


def open_instrument(instrument: Instrument, clock: Clock) -> tuple[Any, Callable[[], None]]:
    """The driver of an instrument on its port, and what gives the port back. Raises PortError."""
    settings, port = instrument.settings, instrument.port
    source: Any
    if instrument.role == "dut":
        if isinstance(port, CanPort):
            can_id = instrument.driver_class.can_id(settings)
            bus = open_can(port.interface, port.channel, port.bitrate, can_id)
            source = open_can_source(bus, clock.now)
        else:
            source = open_byte_source(open_serial(port, settings.baud, 0.0), clock.now)
        return instrument.driver_class(source, settings), source.close
    assert isinstance(port, str)
    opened = open_serial(port, settings.baud, settings.reply_timeout_s)
    return instrument.driver_class(opened, settings), opened.close


def _open(station: Station, instrument: Instrument, clock: Clock) -> None:
    driver, station.closers[instrument.name] = open_instrument(instrument, clock)
    if instrument.role == "dut":
        station.gyros[instrument.name] = driver
    else:
        station.put(instrument.role, driver)


def identify(driver: Chamber | RateTable | Supply, instrument: Instrument) -> str:
    """Who an instrument says that it is. Raises DriverError, or BenchFailure if it is not who it should be."""
    return _expected(driver.identify(), instrument)


def _expected(found: str, instrument: Instrument) -> str:
    if not instrument.is_it(found):
        raise BenchFailure(
            f"{instrument.where}: '{found}' answers, the bench file expects '{instrument.identity}'. Connect the right "
            "instrument, or correct its 'identity:' in the bench file; it was not commanded."
        )
    return found


def open_commanded(bench: Bench, clock: Clock) -> tuple[Station, list[str]]:
    """Open what can be opened of chamber and table, and of a supply that is to be switched off, and is what it should
    be; and what failed.

    Each is asked who it is before it is commanded: a port may by now lead to something else.
    """
    station, failures = Station(), []
    switched = bench.file.supply is not None and bench.file.supply.safe.action == "off"
    for instrument in (bench.rate_table, bench.chamber, bench.supply if switched else None):
        if instrument is not None:
            try:
                _open(station, instrument, clock)
                identify(station.commanded(instrument.role), instrument)
            except (DriverError, BenchFailure) as error:
                failures.append(str(error))
                station.put(instrument.role, None)
    return station, failures


def _identify(station: Station, bench: Bench) -> None:
    if station.chamber and bench.chamber:
        station.identities[bench.chamber.name] = identify(station.chamber, bench.chamber)
    if station.table and bench.rate_table:
        station.identities[bench.rate_table.name] = identify(station.table, bench.rate_table)
    if station.supply and bench.supply:
        station.identities[bench.supply.name] = identify(station.supply, bench.supply)


def switch_output(supply: Supply, on: bool, clock: Clock, timeout_s: float = OUTPUT_S) -> str | None:
    """Switch the output unless it is so already, and wait until it reads so; what is wrong if it does not.

    Raises DriverError.
    """
    if supply.is_on() == on:
        return None
    began_s = clock.now()
    supply.switch(on)
    while supply.is_on() != on:
        if clock.now() - began_s >= timeout_s:
            was = "off" if on else "on"
            return f"the supply's output still reads {was} {timeout_s:g} s after it was switched {'on' if on else 'off'}"
        clock.wait(OUTPUT_LOOK_S)
    return None


def _power_up(station: Station, bench: Bench, clock: Clock, may_be_off: bool) -> None:
    """Have the DUTs under power, and give them time to start."""
    if station.supply is None or station.supply.is_on():
        return
    fed = [name for name in bench.powered if name in station.gyros]
    if may_be_off:
        for name in fed:
            station.off[name] = station.gyros.pop(name)
            station.identities[name] = _expected(station.off[name].describe(), bench.duts[name])
        return
    if wrong := switch_output(station.supply, True, clock):
        raise BenchFailure(f"{bench.supply.where if bench.supply else ''}: {wrong}. Does its current limit hold it?")
    station.switched_on = True
    began_s, silent = clock.now(), set(fed)
    while silent and clock.now() - began_s < START_UP_S:
        clock.wait(LISTENING_PERIOD_S)
        silent -= {name for name in silent if len(station.gyros[name].take())}


def _hear_gyros(station: Station, bench: Bench, clock: Clock, may_be_absent: Collection[str]) -> None:
    """Listen to every DUT long enough to know that it sends valid frames at its declared rate."""
    for gyro in station.gyros.values():
        gyro.discard()
    frames = dict.fromkeys(station.gyros, 0)
    for _ in range(LISTENING_PERIODS):
        clock.wait(LISTENING_PERIOD_S)
        for name, gyro in station.gyros.items():
            frames[name] += len(gyro.take())
    for name, gyro in list(station.gyros.items()):
        heard = gyro.complaint() or ("" if frames[name] else "nothing valid was received")
        if heard:
            listened_s = LISTENING_PERIODS * LISTENING_PERIOD_S
            why = f"{name}: {gyro.describe()}: after {listened_s:g} s of listening: {heard}."
            if name not in may_be_absent:
                raise BenchFailure(why)
            station.unheard[name] = why
            del station.gyros[name]
            station.shut(name)
        else:
            station.identities[name] = _expected(gyro.describe(), bench.duts[name])
