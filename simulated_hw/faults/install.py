"""Puts the faults of a bench file into a world: under its simulated instruments, over them, and into its time."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, cast, runtime_checkable

import simpy

from simulated_hw.faults.frames import StreamFaults
from simulated_hw.faults.instrument_kinds import (
    Alarm,
    DoorOpen,
    EncoderError,
    EStop,
    OverSpeed,
    SensorBreak,
    TableFault,
    WeakCooling,
)
from simulated_hw.faults.kinds import FaultSpec
from simulated_hw.faults.log import FaultLog, begun
from simulated_hw.faults.plants import FaultyChamber, FaultyTable
from simulated_hw.faults.replies import BadlyAnswering
from simulated_hw.faults.rules import Rule
from simulated_hw.faults.script import Windows, follow
from simulated_hw.faults.values import LyingGyro
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.supply import SupplyPlant
from simulated_hw.wire import switchboard

Plant = ChamberPlant | TablePlant | SupplyPlant | GyroUnit
Seen = Plant | FaultyChamber | FaultyTable | LyingGyro
Needed = TypeVar("Needed")

_REPLIES = ("no_reply", "late_reply", "garbled_reply")
# These are logged when they begin and end; the others frame by frame or reply by reply.
_LASTING = ("late", "power_reset")
_TRIPS = (TableFault, EStop, OverSpeed)


@runtime_checkable
class Streaming(Protocol):
    """A simulated gyro that lets its frames suffer on their way."""

    faults: StreamFaults | None


@runtime_checkable
class Tripping(Protocol):
    """A simulated table controller that can trip."""

    def trip(self, reason: str, held: bool = False) -> None: ...
    def let_reset(self) -> None: ...


@runtime_checkable
class Alarming(Protocol):
    """A simulated chamber controller that can report an alarm."""

    def show_alarm(self, alarm: Literal[1, 2], state: Literal["high", "low"] | None) -> None: ...


@runtime_checkable
class Doored(Protocol):
    """A simulated chamber controller that the door's switch is wired to."""

    def show_door(self, opened: bool) -> None: ...


class Faults:
    """All faults of one world. A fault that an instrument's simulator cannot show raises ValueError."""

    def __init__(
        self,
        specs: Sequence[FaultSpec],
        seed: int,
        env: simpy.Environment,
        chamber: ChamberPlant,
        table: TablePlant,
        truth_dir: Path | None,
        earlier: Sequence[Path] = (),
    ) -> None:
        """earlier: where earlier worlds of the run left their logs. Raises OSError if the log cannot be written."""
        self.env, self._table = env, table
        came_s = begun(earlier)
        self.log = FaultLog(truth_dir)
        self._streams: list[StreamFaults] = []
        self._rules = []
        for number, spec in enumerate(specs):
            windows = Windows(spec.fault, chamber, table, env.now, came_s.get((number, spec.on, spec.name)))
            self._rules.append(Rule.of(number, spec, windows, seed))

    def _of(self, on: str, *names: str) -> list[Rule]:
        return [rule for rule in self._rules if rule.spec.on == on and (not names or rule.spec.name in names)]

    def under(self, on: str, plant: Plant) -> Seen:
        """The plant as the simulator of this instrument is to see it."""
        if not self._of(on) or isinstance(plant, SupplyPlant):
            return plant
        if isinstance(plant, GyroUnit):
            return LyingGyro(plant, self._of(on, "frozen", "spike", "power_reset"), self.log)
        return FaultyChamber(self.env, plant) if isinstance(plant, ChamberPlant) else FaultyTable(self.env, plant)

    def over(self, on: str, simulator: switchboard.Instrument, plant: Plant, seen: Seen) -> switchboard.Instrument:
        """What is to stand at the instrument's address; starts what happens by time or place."""
        for rule in self._of(on):
            self._schedule(rule, simulator, seen)
        if isinstance(plant, GyroUnit):
            if rules := self._of(on):
                gyro = _able(simulator, Streaming, rules[0])
                gyro.faults = StreamFaults(on, plant, rules, self.log)
                self._streams.append(gyro.faults)
            return simulator
        if rules := self._of(on, *_REPLIES):
            return BadlyAnswering(_able(simulator, switchboard.Device, rules[0]), rules, self.log)
        return simulator

    def _schedule(self, rule: Rule, simulator: switchboard.Instrument, seen: Seen) -> None:
        switch = self._switch(rule, simulator, seen)
        if switch is None:
            if isinstance(rule.windows, Windows):
                rule.windows.on_begin = partial(self._began, rule)
            return

        def turn(on: bool) -> None:
            switch(on)
            about: dict[str, Any] = {"state": "begins" if on else "ends"}
            if rule.spec.name == "power_reset" and isinstance(seen, LyingGyro):
                about["turn_on_bias_dph"] = seen.turn_on_bias_dph(rule)
            self.log.add(self.env.now, rule.spec.on, rule.spec.name, rule.number, **about)

        instant = isinstance(rule.spec.fault, _TRIPS)
        self.env.process(follow(self.env, rule.windows, partial(turn, True), partial(turn, False), instant))

    def _began(self, rule: Rule, begin_s: float) -> None:
        self.log.add(begin_s, rule.spec.on, rule.spec.name, rule.number, state="begins")

    def _switch(self, rule: Rule, simulator: switchboard.Instrument, seen: Seen) -> Callable[[bool], None] | None:
        """What turns a fault on and off; None if it acts on single frames or replies."""
        fault = rule.spec.fault
        if isinstance(seen, FaultyTable):
            return self._table_switch(rule, simulator, seen)
        if isinstance(seen, FaultyChamber):
            if isinstance(fault, Alarm):
                panel = _able(simulator, Alarming, rule)
                return lambda on: panel.show_alarm(fault.alarm, fault.state if on else None)
            if isinstance(fault, SensorBreak):
                return partial(seen.break_sensor, fault.reading_degc)
            if isinstance(fault, DoorOpen):
                return partial(_open_door, seen, fault, simulator)
            return partial(seen.alter, fault) if isinstance(fault, WeakCooling) else None
        return (lambda on: None) if rule.spec.name in _LASTING else None

    def _table_switch(
        self, rule: Rule, simulator: switchboard.Instrument, seen: FaultyTable
    ) -> Callable[[bool], None] | None:
        fault = rule.spec.fault
        if isinstance(fault, EncoderError):
            return partial(seen.err, fault)
        if rule.spec.name == "stuck":
            return seen.jam
        if not isinstance(fault, _TRIPS):
            return None
        controller, held = _able(simulator, Tripping, rule), fault.for_s is not None or fault.when is not None

        def trip(on: bool) -> None:
            if not on:
                controller.let_reset()
            elif isinstance(fault, OverSpeed):
                stop = partial(controller.trip, "over-speed")
                trip_dps = fault.trip * self._table.max_rate_dps
                seen.run_away(trip_dps, lambda: stop(held and rule.windows.active(self.env.now)))
            elif isinstance(fault, EStop):
                controller.trip("emergency stop", held)
                self._table.brake(self.env.now)
            else:
                controller.trip(fault.reason, held)

        return trip

    def close(self) -> None:
        """Finish the log; closing twice is harmless."""
        for rule in self._rules:
            # What came once and was not looked at has come all the same.
            rule.windows.until(self.env.now)
        for stream in self._streams:
            stream.close(self.env.now)
        self.log.close()


def _open_door(chamber: FaultyChamber, fault: DoorOpen, simulator: switchboard.Instrument, on: bool) -> None:
    chamber.alter(fault, on)
    if isinstance(simulator, Doored):
        simulator.show_door(chamber.doors_open > 0)


def _able(simulator: switchboard.Instrument, needed: Callable[..., Needed], rule: Rule) -> Needed:
    """The simulator, if it can show this fault."""
    kind = cast(type[Needed], needed)
    if not isinstance(simulator, kind):
        raise ValueError(
            f"{type(simulator).__name__} on {rule.spec.on} cannot show the fault '{rule.spec.name}': it is no "
            f"simulated_hw.faults.install.{kind.__name__}"
        )
    return simulator
