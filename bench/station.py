"""The opened bench: drivers on their ports; how it is energised, and what it must be able to reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from bench.benchfile import Instrument, Role
from bench.clock import Clock
from bench.errors import BenchFailure
from bench.instruments import Chamber, Gyro, RateTable, Supply
from bench.procedure.language import RampTemperature, SetTemperature
from bench.procedure.plan import PlannedStep
from drivers.errors import DriverError, Refused

ENERGISE_TRIES = 4
ENERGISE_WAIT_S = 0.5
# A supply's output follows within some 100 ms.
OUTPUT_LOOK_S, OUTPUT_S = 0.25, 10.0
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

    def compare(self, instrument: Instrument, found: str) -> None:
        """Raise BenchFailure if an instrument does not say what it said when it was first asked."""
        before = self.identities.setdefault(instrument.name, found)
        if found != before:
            raise BenchFailure(
                f"{instrument.where}: where '{before}' was, '{found}' answers now; it was not commanded. Connect the "
                "right instrument."
            )

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
            was, now = ("off", "on") if on else ("on", "off")
            return f"the supply's output still reads {was} {timeout_s:g} s after it was switched {now}"
        clock.wait(OUTPUT_LOOK_S)
    return None
