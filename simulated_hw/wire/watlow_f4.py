"""Simulated Watlow F4: Modbus RTU on one side, a chamber plant on the other.

Register map and behaviour: protocol notes, chambers, section 3. Values are signed words with the decimals of register
606 in the unit of register 901; both can be written, and every temperature register follows.
"""

from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol, TypeVar

import simpy

from drivers.codecs import modbus_rtu
from drivers.codecs.modbus_rtu import (
    BROADCAST,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ExceptionReply,
    FrameParser,
    ModbusError,
    OtherRequest,
    Read,
    Registers,
    Reply,
    Request,
    WriteMany,
    WriteOne,
    Written,
)

# Typical of the controller family: clients were found to need 30 ms between sending and reading.
_LATENCY_S = 0.025
# A frame that stops for longer is dropped; far above 3.5 characters, which no USB adapter keeps.
_FRAME_GAP_S = 0.1
_MODEL = 5270
_EVENTS = range(2000, 2080, 10)
_ALARM_STATES = {"high": 1, "low": 2}

_Getter = Callable[[float], int]
_Setter = Callable[[int, float], None]
_Access = TypeVar("_Access")


class ChamberPlant(Protocol):
    """What the controller needs of the chamber it sits on."""

    @property
    def final_setpoint_degc(self) -> float: ...
    @property
    def limits_degc(self) -> tuple[float, float]: ...
    def command(self, now_s: float, setpoint_degc: float, ramp_degc_min: float | None) -> None: ...
    def probe_degc(self, now_s: float) -> float: ...
    def power_percent(self, now_s: float) -> float: ...
    def switch(self, now_s: float, on: bool) -> None: ...


class _RefusedError(Exception):
    """What the controller answers with an exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(modbus_rtu.EXCEPTION_TEXTS[code])
        self.code = code


class SimulatedWatlowF4:
    """The controller at the end of a serial line; settings are the driver's (`baud`, `address`).

    eeprom_writes: how often a client wrote register 25, which on a real controller wears the memory out.
    """

    def __init__(self, env: simpy.Environment, chamber: ChamberPlant, settings: Mapping[str, Any]) -> None:
        self.env = env
        self.baud = int(settings.get("baud", 19200))
        self.eeprom_writes = 0
        self._address = int(settings.get("address", 1))
        self._parser = FrameParser(modbus_rtu.request_length)
        self._heard_s = env.now
        self._panel = _Panel(chamber)
        self._read, self._write = self._panel.register_map()
        self._write[25] = self._save
        self._door_open = False
        if (register := settings.get("door_register")) is not None:
            self._wire_door(int(register), int(settings.get("door_open_word", 1)))
        if (event := settings.get("conditioning_event")) is not None:
            self._wire_conditioning(chamber, _EVENTS[int(event) - 1])

    def _wire_conditioning(self, chamber: ChamberPlant, register: int) -> None:
        """Let an event output switch the chamber, off at power-on, as makers of chambers do."""
        keep = self._write[register]

        def write(value: int, now_s: float) -> None:
            keep(value, now_s)
            chamber.switch(now_s, value == 1)

        self._write[register] = write
        chamber.switch(self.env.now, False)

    def show_alarm(self, alarm: Literal[1, 2], state: Literal["high", "low"] | None) -> None:
        """Report an alarm (register 102 or 106) whatever the temperature; None: report what there is."""
        self._panel.shown_alarms[alarm] = 0 if state is None else _ALARM_STATES[state]

    def show_door(self, opened: bool) -> None:
        """Let the door's switch open or close."""
        self._door_open = opened

    def _wire_door(self, register: int, open_word: int) -> None:
        """Show the door's switch in a register as the chamber maker may have wired it: over what it showed before, or
        in one that this controller would not have otherwise."""
        shut: _Getter = self._read.get(register) or (lambda now_s: int(open_word == 0))
        self._read[register] = lambda now_s: open_word if self._door_open else shut(now_s)

    def receive(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Answer every whole request to this address; stay silent on damaged ones, other addresses and broadcasts."""
        if now_s - self._heard_s > _FRAME_GAP_S:
            self._parser.clear()
        self._heard_s = now_s
        replies = []
        for frame in self._parser.feed(data):
            if frame[0] in (self._address, BROADCAST):
                reply = self._answer(frame, now_s)
                if frame[0] != BROADCAST:
                    replies.append((_LATENCY_S, modbus_rtu.encode_reply(reply)))
        return replies

    def _answer(self, frame: bytes, now_s: float) -> Reply:
        unit, function = frame[0], frame[1] & 0x7F
        try:
            return self._execute(modbus_rtu.decode_request(frame), now_s)
        except ModbusError:
            return ExceptionReply(unit, function, ILLEGAL_VALUE)
        except _RefusedError as refusal:
            return ExceptionReply(unit, function, refusal.code)

    def _execute(self, request: Request, now_s: float) -> Reply:
        match request:
            case Read(unit, register, count, function):
                if not 1 <= count <= modbus_rtu.MAX_READ:
                    raise _RefusedError(ILLEGAL_VALUE)
                getters = _registers(self._read, register, count)
                return Registers(unit, tuple(get(now_s) & 0xFFFF for get in getters), function)
            case WriteOne(unit, register, value):
                _registers(self._write, register, 1)[0](modbus_rtu.to_signed(value), now_s)
                return Written(unit, modbus_rtu.WRITE_ONE, register, value)
            case WriteMany(unit, register, values):
                for write, value in zip(_registers(self._write, register, len(values)), values, strict=True):
                    write(modbus_rtu.to_signed(value), now_s)
                return Written(unit, modbus_rtu.WRITE_MANY, register, len(values))
            case OtherRequest():
                raise _RefusedError(ILLEGAL_FUNCTION)

    def _save(self, value: int, now_s: float) -> None:
        if value != 0:
            raise _RefusedError(ILLEGAL_VALUE)
        self.eeprom_writes += 1


def _registers(known: Mapping[int, _Access], first: int, count: int) -> list[_Access]:
    try:
        return [known[register] for register in range(first, first + count)]
    except KeyError:
        raise _RefusedError(ILLEGAL_ADDRESS) from None


class _Panel:
    """The controller's registers as getters and setters; temperatures are kept in degrees Celsius inside."""

    def __init__(self, chamber: ChamberPlant) -> None:
        self._chamber = chamber
        self._limits_degc = list(chamber.limits_degc)
        self._alarm_degc = list(chamber.limits_degc)
        self.shown_alarms = {1: 0, 2: 0}
        # Configuration words: decimals, unit kind, unit (1 = °C), ramp mode, ramp rate, ramp scale, events.
        self._words = {606: 1, 608: 0, 901: 1, 1100: 0, 1101: 0, 1102: 0} | dict.fromkeys(_EVENTS, 0)

    def register_map(self) -> tuple[dict[int, _Getter], dict[int, _Setter]]:
        """Readable and writable registers."""
        chamber = self._chamber
        read = {at: self._word_getter(at) for at in self._words}
        read |= {
            0: lambda now_s: _MODEL,
            100: lambda now_s: self._word(chamber.probe_degc(now_s)),
            101: lambda now_s: 0,
            102: self._alarm,
            103: lambda now_s: round(max(chamber.power_percent(now_s), 0.0) * 100),
            106: lambda now_s: self.shown_alarms[2],
            107: lambda now_s: round(min(chamber.power_percent(now_s), 0.0) * 100),
            200: lambda now_s: 0,
            300: lambda now_s: self._word(chamber.final_setpoint_degc),
            302: lambda now_s: self._word(self._alarm_degc[0]),
            303: lambda now_s: self._word(self._alarm_degc[1]),
            602: lambda now_s: self._word(self._limits_degc[0]),
            603: lambda now_s: self._word(self._limits_degc[1]),
        }
        allowed = {606: range(4), 608: range(1), 901: range(2), 1100: range(3), 1101: range(0x8000), 1102: range(2)}
        allowed |= dict.fromkeys(_EVENTS, range(2))
        write = {at: self._word_setter(at, values) for at, values in allowed.items()}
        write |= {300: self._set_setpoint}
        write |= {302 + side: self._bound_setter(self._alarm_degc, side) for side in (0, 1)}
        write |= {602 + side: self._bound_setter(self._limits_degc, side) for side in (0, 1)}
        return read, write

    def _word(self, temperature_degc: float) -> int:
        unit = temperature_degc if self._words[901] else temperature_degc * 9 / 5 + 32
        # A value beyond the register shows as its end, as on the controller's display.
        return min(max(round(unit * 10.0 ** self._words[606]), -0x8000), 0x7FFF)

    def _degc(self, value: int) -> float:
        unit = value / 10.0 ** self._words[606]
        return unit if self._words[901] else (unit - 32) * 5 / 9

    def _alarm(self, now_s: float) -> int:
        probe = self._chamber.probe_degc(now_s)
        low, high = self._alarm_degc
        return self.shown_alarms[1] or (1 if probe > high else 2 if probe < low else 0)

    def _ramp_degc_min(self) -> float | None:
        # Mode 1 ramps at power-on only, mode 2 at every change as well; without a rate there is no ramp.
        if self._words[1100] != 2 or self._words[1101] == 0:
            return None
        per_degc = 10.0 ** self._words[606] * (1.0 if self._words[901] else 1.8)
        return self._words[1101] / per_degc / (60.0 if self._words[1102] else 1.0)

    def _set_setpoint(self, value: int, now_s: float) -> None:
        if not self._word(self._limits_degc[0]) <= value <= self._word(self._limits_degc[1]):
            raise _RefusedError(ILLEGAL_VALUE)
        self._chamber.command(now_s, self._degc(value), self._ramp_degc_min())

    def _word_getter(self, register: int) -> _Getter:
        return lambda now_s: self._words[register]

    def _word_setter(self, register: int, allowed: range) -> _Setter:
        def write(value: int, now_s: float) -> None:
            if value not in allowed:
                raise _RefusedError(ILLEGAL_VALUE)
            self._words[register] = value

        return write

    def _bound_setter(self, bounds: list[float], side: int) -> _Setter:
        def write(value: int, now_s: float) -> None:
            wanted = list(bounds)
            wanted[side] = self._degc(value)
            low, high = self._chamber.limits_degc
            if not low <= wanted[0] <= wanted[1] <= high:
                raise _RefusedError(ILLEGAL_VALUE)
            bounds[side] = wanted[side]

        return write
