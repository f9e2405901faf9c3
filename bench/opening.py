"""Opening a bench: every port, and the first words with each instrument, before anything is commanded."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from bench.benchfile import Bench, CanPort, Instrument
from bench.clock import Clock
from bench.errors import BenchFailure
from bench.instruments import Chamber, RateTable, Supply
from bench.station import Station, switch_output
from drivers.can_ports import open_can, open_can_source
from drivers.errors import BadReply, DriverError
from drivers.ports import open_byte_source, open_serial

# Long enough for a driver to tell a gyro's pace from the declared one.
LISTENING_PERIODS = 5
LISTENING_PERIOD_S = 0.5
# Gyros begin to send within a minute after their power came.
START_UP_S = 60.0


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
                if instrument.role != "dut" or instrument.name not in may_be_absent:
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


def open_commanded(bench: Bench, clock: Clock, identities: Mapping[str, str]) -> tuple[Station, list[str]]:
    """Open what can be opened of chamber and table, and of a supply that is to be switched off, and is what it should
    be; and what failed. `identities`: what instruments said that they are when the run began."""
    station, failures = Station(identities=dict(identities)), []
    switched = bench.file.supply is not None and bench.file.supply.safe.action == "off"
    for instrument in (bench.rate_table, bench.chamber, bench.supply if switched else None):
        if instrument is not None:
            try:
                open_known(station, instrument, clock)
            except (DriverError, BenchFailure) as error:
                failures.append(str(error))
    return station, failures


def open_known(station: Station, instrument: Instrument, clock: Clock) -> Any:
    """Open the port of chamber, table or supply, anew if it was open, and make sure who is there; its driver.

    Raises DriverError if nobody answers, and BenchFailure if it is not who the bench file or `station.identities` says,
    for a port may by now lead to something else; the port is shut then and nothing was commanded.
    """
    station.shut(instrument.name)
    driver, station.closers[instrument.name] = open_instrument(instrument, clock)
    try:
        recognise(station, instrument, driver)
    except (DriverError, BenchFailure):
        station.shut(instrument.name)
        raise
    station.put(instrument.role, driver)
    return driver


def recognise(station: Station, instrument: Instrument, driver: Chamber | RateTable | Supply) -> None:
    """Make sure that an instrument is who it was. Raises DriverError, and BenchFailure if it is another.

    One that seems to be another is asked again, for a late answer to an older question may come first; one that then
    says something else is on a bad line.
    """
    first = driver.identify()
    try:
        station.compare(instrument, _expected(first, instrument))
    except BenchFailure:
        second = driver.identify()
        try:
            station.compare(instrument, _expected(second, instrument))
        except BenchFailure:
            if second != first:
                why = f"asked twice who it is, it said '{first}' and '{second}'"
                raise BadReply(instrument.where, "identify", second.encode(), why) from None
            raise


def identify(driver: Chamber | RateTable | Supply, instrument: Instrument) -> str:
    """Who an instrument says that it is. Raises DriverError, or BenchFailure if it is not who it should be."""
    return _expected(driver.identify(), instrument)


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


def _expected(found: str, instrument: Instrument) -> str:
    if not instrument.is_it(found):
        raise BenchFailure(
            f"{instrument.where}: '{found}' answers, the bench file expects '{instrument.identity}'. Connect the right "
            "instrument, or correct its 'identity:' in the bench file; it was not commanded."
        )
    return found


def _identify(station: Station, bench: Bench) -> None:
    if station.chamber and bench.chamber:
        station.identities[bench.chamber.name] = identify(station.chamber, bench.chamber)
    if station.table and bench.rate_table:
        station.identities[bench.rate_table.name] = identify(station.table, bench.rate_table)
    if station.supply and bench.supply:
        station.identities[bench.supply.name] = identify(station.supply, bench.supply)


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
