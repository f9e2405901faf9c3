"""Temperature chamber with a Watlow Series F4 controller (F4S, F4D, F4P) on Modbus RTU.

Source: protocol notes, chambers, section 3 (Watlow F4P User's Manual 0600-0032-0013 Rev E, chapter 9, and two open
clients). Register numbers are wire addresses. Values are signed words with as many decimals as register 606 says, in
the unit of register 901. Register 25 writes the EEPROM, which wears out; this driver never writes it.
"""

from dataclasses import dataclass
from math import isfinite

from drivers.chambers.modbus_unit import ModbusUnit
from drivers.codecs import modbus_rtu
from drivers.codecs.modbus_rtu import ModbusError
from drivers.ports import SerialPort

MODEL, INPUT_1, ALARM_1, ALARM_2, SETPOINT_1 = 0, 100, 102, 106, 300
LIMIT_LOW, DECIMALS, UNIT_KIND, UNIT = 602, 606, 608, 901
EVENT_1, EVENT_STEP, EVENTS = 2000, 10, 8
RAMP_MODE = 1100

_NEVER, _ON_CHANGE = 0, 2
_PER_MINUTE, _PER_HOUR = 0, 1
_ALARM_TEXTS = {1: "high", 2: "low"}
_ADVICE = {
    modbus_rtu.ILLEGAL_ADDRESS: "This controller has no such register. Is it an F4 (and no F4T)?",
    modbus_rtu.ILLEGAL_VALUE: "Keep inside the controller's own set-point limits (registers 602 and 603)",
}


@dataclass(frozen=True)
class WatlowF4Settings:
    """Line and address. The F4P leaves the factory with 19200 baud, 8N1, address 1.

    Fields:
        conditioning_event: event output (1..8) that switches the chamber's conditioning on; the maker's choice. Without
            it the chamber is taken to be on, and cannot be switched off.
        door_register, door_open_word: the register that tells of the chamber's door, and what it holds when that is
            open. The maker's choice as well: a digital input, or the switch raises an alarm of the controller (register
            102 or 106; 1 is high), which then is no alarm to us. Without it nothing is known of the door.
    """

    baud: int = 19200
    address: int = 1
    reply_timeout_s: float = 1.0
    tries: int = 3
    conditioning_event: int | None = None
    door_register: int | None = None
    door_open_word: int = 1

    @property
    def can_switch_off(self) -> bool:
        """Whether the driver knows what switches this chamber."""
        return self.conditioning_event is not None

    @property
    def tells_of_door(self) -> bool:
        """Whether the driver knows what tells of the chamber's door."""
        return self.door_register is not None

    def __post_init__(self) -> None:
        if self.conditioning_event is not None and not 1 <= self.conditioning_event <= EVENTS:
            raise ValueError(f"conditioning_event: {self.conditioning_event}; allowed are 1..{EVENTS}")
        if self.baud <= 0:
            raise ValueError(f"baud: {self.baud}; it must be above 0. The F4 speaks 9600 or 19200")
        if not 1 <= self.address <= modbus_rtu.MAX_UNIT:
            raise ValueError(f"address: {self.address}; allowed are 1..{modbus_rtu.MAX_UNIT}")
        if not 0 < self.reply_timeout_s <= 60:
            raise ValueError(f"reply_timeout: {self.reply_timeout_s:g} s; it must be above 0 s and at most 60 s")
        if not 1 <= self.tries <= 10:
            raise ValueError(f"tries: {self.tries}; allowed are 1..10")
        if self.door_register is not None and not 0 <= self.door_register <= 0xFFFF:
            raise ValueError(f"door_register: {self.door_register}; a register has a number from 0 to 65535")
        if not 0 <= self.door_open_word <= 0xFFFF:
            raise ValueError(f"door_open_word: {self.door_open_word}; a register holds 0 to 65535")


@dataclass(frozen=True)
class _Scale:
    """How register values mean temperatures."""

    decimals: int
    fahrenheit: bool

    def degc(self, word: int) -> float:
        value = modbus_rtu.to_signed(word) / 10.0**self.decimals
        return (value - 32.0) / 1.8 if self.fahrenheit else value

    def value(self, temperature_degc: float) -> int:
        unit = temperature_degc * 1.8 + 32.0 if self.fahrenheit else temperature_degc
        return round(unit * 10.0**self.decimals)

    def per_degc(self) -> float:
        """Register steps per degree Celsius of difference."""
        return (1.8 if self.fahrenheit else 1.0) * 10.0**self.decimals


class WatlowF4:
    """Driver of a Watlow F4. The port is open, at `settings.baud`; its time-out is set here.

    Every method raises NoReply, BadReply, Refused or PortError (drivers.errors).
    """

    Settings = WatlowF4Settings

    def __init__(self, port: SerialPort, settings: WatlowF4Settings) -> None:
        self._link = ModbusUnit(port, "Watlow F4", settings.address, settings.reply_timeout_s, settings.tries, _ADVICE)
        self._door = settings.door_register, settings.door_open_word
        self._scale: _Scale | None = None
        event = settings.conditioning_event
        self._event = None if event is None else EVENT_1 + EVENT_STEP * (event - 1)

    def identify(self) -> str:
        """'Watlow F4, model 5270'; reads decimals and unit afresh.

        A controller set to °F is converted; one whose input 1 is no temperature raises BadReply.
        """
        model = self._link.read(MODEL)
        self._scale = scale = self._read_scale()
        return f"Watlow F4, model {model}" + (", set to degF (converted)" if scale.fahrenheit else "")

    def temperature_degc(self) -> float:
        """Actual temperature at input 1 (register 100)."""
        return self._known_scale().degc(self._link.read(INPUT_1))

    def setpoint_degc(self) -> float:
        """Set point 1 (register 300): where a ramp ends, not where it is."""
        return self._known_scale().degc(self._link.read(SETPOINT_1))

    def set_setpoint_degc(self, temperature_degc: float) -> None:
        """Set set point 1, to the nearest step the controller knows; kept in RAM only. Switches conditioning on.

        Raises ValueError for a value that is no number or does not fit the register, and Refused outside the
        controller's own limits.
        """
        word = self._word("setpoint", temperature_degc)
        if self._event is not None:
            self._link.write(self._event, 1)
        self._link.write(SETPOINT_1, word)

    def off(self) -> None:
        """Switch conditioning off; the next set point switches it on again.

        An F4 has no register that does so: chamber makers wire it to one of its event outputs (notes, section 3).
        Raises ValueError if the settings do not say which.
        """
        self._link.write(self._switch(), 0)

    def is_off(self) -> bool:
        """Whether conditioning is switched off. Raises ValueError as `off`."""
        return self._link.read(self._switch(), allowed=(0, 1)) == 0

    def _switch(self) -> int:
        if self._event is None:
            raise ValueError("conditioning_event: not set, so this chamber cannot be switched off")
        return self._event

    def set_ramp_degc_min(self, rate_degc_min: float | None) -> None:
        """How fast later set-point changes are approached (registers 1100-1102); None = as fast as it can.

        The rate goes out per minute or per hour, whichever holds it more exactly, with the decimals of register 606
        (read so from the notes; the manual states decimals for values in general). Raises ValueError for a rate <= 0 or
        one the register cannot hold.
        """
        if rate_degc_min is None:
            self._link.write(RAMP_MODE, _NEVER)
            return
        if not (isfinite(rate_degc_min) and rate_degc_min > 0):
            raise ValueError(
                f"ramp: {rate_degc_min} degC/min; it must be above 0. Leave it out for as fast as possible"
            )
        steps_min = rate_degc_min * self._known_scale().per_degc()
        choices = [
            (round(steps), scale, steps) for scale, steps in ((_PER_MINUTE, steps_min), (_PER_HOUR, steps_min * 60.0))
        ]
        choices = [choice for choice in choices if 1 <= choice[0] <= 0x7FFF]
        if not choices:
            raise ValueError(f"ramp: {rate_degc_min:g} degC/min; this controller cannot hold that rate in its register")
        rate, scale, _ = min(choices, key=lambda choice: abs(choice[0] / choice[2] - 1.0))
        self._link.write_many(RAMP_MODE, (_ON_CHANGE, rate, scale))

    def limits_degc(self) -> tuple[float, float]:
        """Set-point limits, low and high (registers 602, 603)."""
        scale = self._known_scale()
        low, high = self._link.read_many(LIMIT_LOW, 2)
        return scale.degc(low), scale.degc(high)

    def alarm(self) -> str | None:
        """What alarms are on ('alarm 1 high'), or None (registers 102, 106)."""
        registers = [(number, at) for number, at in ((1, ALARM_1), (2, ALARM_2)) if at != self._door[0]]
        states = ((number, self._link.read(register)) for number, register in registers)
        texts = [f"alarm {number} {_ALARM_TEXTS.get(state, f'in state {state}')}" for number, state in states if state]
        return ", ".join(texts) or None

    def door_open(self) -> bool | None:
        """Whether the chamber's door is open; None if no register is known to tell."""
        register, opened = self._door
        return None if register is None else self._link.read(register) == opened

    def _known_scale(self) -> _Scale:
        if self._scale is None:
            self._scale = self._read_scale()
        return self._scale

    def _read_scale(self) -> _Scale:
        link = self._link
        decimals = link.read(DECIMALS, allowed=(0, 1, 2, 3))
        link.read(UNIT_KIND, allowed=(0,))
        return _Scale(decimals, fahrenheit=link.read(UNIT, allowed=(0, 1)) == 0)

    def _word(self, name: str, temperature_degc: float) -> int:
        if not isfinite(temperature_degc):
            raise ValueError(f"{name}: {temperature_degc} degC; it must be a number")
        try:
            return modbus_rtu.to_word(self._known_scale().value(temperature_degc))
        except ModbusError as error:
            raise ValueError(
                f"{name}: {temperature_degc:g} degC is beyond the controller's register: {error}"
            ) from None
