"""The opened bench: drivers on their ports, and the first words with each instrument."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

from bench.benchfile import Bench, CanPort, Instrument
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


@dataclass
class Station:
    """Opened drivers by role; `close` gives the ports back.

    gyros: the DUTs that are listened to. absent: those that are lost for now. unheard: those that were allowed to be
    absent from the beginning, and why they are. closers: by the instrument's name.
    """

    chamber: Chamber | None = None
    table: RateTable | None = None
    gyros: dict[str, Gyro] = field(default_factory=dict)
    absent: dict[str, Gyro] = field(default_factory=dict)
    unheard: dict[str, str] = field(default_factory=dict)
    identities: dict[str, str] = field(default_factory=dict)
    closers: dict[str, Callable[[], None]] = field(default_factory=dict)

    def drop(self, name: str) -> None:
        """Go on without a DUT for good."""
        self.gyros.pop(name, None)
        self.absent.pop(name, None)

    def close(self) -> None:
        """Close every port; one that fails does not keep the others open."""
        for name in list(self.closers):
            self.shut(name)

    def shut(self, name: str) -> None:
        """Give back the port of one instrument; no error if it is gone or was never open."""
        with suppress(OSError, DriverError):
            self.closers.pop(name, lambda: None)()


def open_station(
    bench: Bench, clock: Clock, duts: Collection[str] | None = None, may_be_absent: Collection[str] = ()
) -> Station:
    """Open all ports of a bench and hear from every instrument. Raises BenchFailure; nothing stays open then.

    `duts`, if given, are the only ones opened; of those in `may_be_absent` it is only noted why they are not heard.
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
    elif instrument.role == "chamber":
        station.chamber = driver
    else:
        station.table = driver


def identify(driver: Chamber | RateTable, instrument: Instrument) -> str:
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
    """Open what can be opened of chamber and table and is what it should be; and what failed.

    Each is asked who it is before it is commanded: a port may by now lead to something else.
    """
    station, failures = Station(), []
    for instrument in (bench.rate_table, bench.chamber):
        if instrument is not None:
            try:
                _open(station, instrument, clock)
                driver = station.chamber if instrument.role == "chamber" else station.table
                assert driver is not None
                identify(driver, instrument)
            except (DriverError, BenchFailure) as error:
                failures.append(str(error))
                if instrument.role == "chamber":
                    station.chamber = None
                else:
                    station.table = None
    return station, failures


def _identify(station: Station, bench: Bench) -> None:
    if station.chamber and bench.chamber:
        station.identities[bench.chamber.name] = identify(station.chamber, bench.chamber)
    if station.table and bench.rate_table:
        station.identities[bench.rate_table.name] = identify(station.table, bench.rate_table)


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
