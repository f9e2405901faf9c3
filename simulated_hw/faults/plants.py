"""Table and chamber as their controllers see them while something is wrong with the machine or its sensors.

Each stands between a plant and its controller. What the gyros feel is the plant, which knows nothing of this.
"""

from collections.abc import Callable, Generator
from dataclasses import replace
from math import radians, sin
from typing import Any

import simpy

from simulated_hw.faults.instrument_kinds import DoorOpen, EncoderError, WeakCooling
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.rate_table import TablePlant

# How closely a runaway is watched; a table of 500 deg/s² gets 5 deg/s faster in it.
_WATCH_S = 0.01
# How far beyond its trip rate a runaway servo wants to go.
_RUNAWAY = 1.2


class FaultyTable:
    """A table whose axis may be stuck or run away, and whose encoder may err."""

    def __init__(self, env: simpy.Environment, plant: TablePlant) -> None:
        self._env, self._plant = env, plant
        self._errors: list[EncoderError] = []
        self._stuck = 0
        self._running_away = False
        # The newest demand that was acknowledged and not followed.
        self._waiting: Callable[[float], None] | None = None

    @property
    def acceleration_dps2(self) -> float:
        """The acceleration limit set."""
        return self._plant.acceleration_dps2

    @property
    def max_rate_dps(self) -> float:
        """Fastest rate the axis is made for."""
        return self._plant.max_rate_dps

    @property
    def max_acceleration_dps2(self) -> float:
        """Highest acceleration limit that can be set."""
        return self._plant.max_acceleration_dps2

    def energise(self, now_s: float) -> None:
        """Close the servo."""
        self._plant.energise(now_s)

    def release(self, now_s: float) -> None:
        """Open the servo, which frees it of its demands and ends a runaway."""
        self._running_away, self._waiting = False, None
        self._plant.release(now_s)

    def command_rate(self, now_s: float, rate_dps: float) -> None:
        """Follow this rate, if the axis obeys."""
        self._demand(now_s, lambda when_s: self._plant.command_rate(when_s, rate_dps))

    def command_position(self, now_s: float, position_deg: float) -> None:
        """Move to this angle, if the axis obeys."""
        self._demand(now_s, lambda when_s: self._plant.command_position(when_s, position_deg))

    def _demand(self, now_s: float, follow: Callable[[float], None]) -> None:
        if self._stuck or self._running_away:
            self._waiting = follow
        else:
            follow(now_s)

    def set_acceleration(self, acceleration_dps2: float) -> None:
        """Set the acceleration limit of later demands."""
        self._plant.set_acceleration(acceleration_dps2)

    def rate_dps(self, now_s: float) -> float:
        """The rate as the encoder has it."""
        rate = self._plant.rate_dps(now_s)
        for error in self._errors:
            turn = radians(self._plant.position_deg(now_s)) if error.rate_ripple_dps else 0.0
            rate += error.rate_offset_dps + error.rate_ripple_dps * sin(turn)
        return rate

    def position_deg(self, now_s: float) -> float:
        """The angle as the encoder has it."""
        return (self._plant.position_deg(now_s) + sum(error.position_offset_deg for error in self._errors)) % 360.0

    def err(self, error: EncoderError, on: bool) -> None:
        """Begin or end an error of the encoder."""
        if on:
            self._errors.append(error)
        else:
            self._errors.remove(error)

    def jam(self, on: bool) -> None:
        """Stop the axis and hold it, or let it go."""
        self._stuck += 1 if on else -1
        now = self._env.now
        if on and self._plant.energised:
            self._plant.run_away(now, 0.0)
        elif not self._stuck and self._waiting is not None and self._plant.energised:
            waiting, self._waiting = self._waiting, None
            waiting(now)

    def run_away(self, trip_dps: float, trip: Callable[[], None]) -> None:
        """Let the axis run away in the sense it turns, and call `trip` at this rate; a released axis cannot."""
        if self._plant.energised:
            self._running_away = True
            now = self._env.now
            sense = -1.0 if self._plant.true_rate_dps(now) < 0.0 else 1.0
            self._plant.run_away(now, sense * trip_dps * _RUNAWAY)
            self._env.process(self._watch(trip_dps, trip))

    def _watch(self, trip_dps: float, trip: Callable[[], None]) -> Generator[simpy.Event, Any, None]:
        while self._running_away:
            if abs(self._plant.true_rate_dps(self._env.now)) >= trip_dps:
                trip()
                return
            yield self._env.timeout(_WATCH_S)


class FaultyChamber:
    """A chamber whose sensor may be broken, its door open, its compressor weak."""

    def __init__(self, env: simpy.Environment, plant: ChamberPlant) -> None:
        self._env, self._plant = env, plant
        self._broken: list[float] = []
        self._altered: list[DoorOpen | WeakCooling] = []

    @property
    def final_setpoint_degc(self) -> float:
        """The setpoint last commanded."""
        return self._plant.final_setpoint_degc

    @property
    def limits_degc(self) -> tuple[float, float]:
        """Lowest and highest setpoint accepted."""
        return self._plant.limits_degc

    def command(self, now_s: float, setpoint_degc: float, ramp_degc_min: float | None) -> None:
        """Move the setpoint."""
        self._plant.command(now_s, setpoint_degc, ramp_degc_min)

    def switch(self, now_s: float, on: bool) -> None:
        """Switch conditioning."""
        self._plant.switch(now_s, on)

    def probe_degc(self, now_s: float) -> float:
        """What the controller shows."""
        return self._broken[-1] if self._broken else self._plant.probe_degc(now_s)

    def power_percent(self, now_s: float) -> float:
        """Controller output."""
        return self._plant.power_percent(now_s)

    def break_sensor(self, reading_degc: float, on: bool) -> None:
        """Show this reading instead of the probe's, or no longer."""
        if on:
            self._broken.append(reading_degc)
        else:
            self._broken.remove(reading_degc)

    @property
    def doors_open(self) -> int:
        """How many faults hold the door open."""
        return sum(isinstance(fault, DoorOpen) for fault in self._altered)

    def alter(self, fault: DoorOpen | WeakCooling, on: bool) -> None:
        """Begin or end what changes the machine itself; several at a time multiply."""
        if on:
            self._altered.append(fault)
        else:
            self._altered.remove(fault)
        p = self._plant.parameters
        for each in self._altered:
            if isinstance(each, DoorOpen):
                p = replace(p, wall_to_room_w_k=p.wall_to_room_w_k * each.leak)
            else:
                power, slope = p.cooling_power_w * each.remaining, p.cooling_slope_w_k * each.remaining
                p = replace(p, cooling_power_w=power, cooling_slope_w_k=slope)
        self._plant.alter(self._env.now, p)
