"""Simulated Acutronic ACUTROL: ACL on one side, a rate-table plant on the other.

Command table and behaviour: protocol notes, rate tables, section 1. What the notes leave open is decided here and
nowhere claimed: the wording of errors, answers joined by ';' for queries only, the number format.
Interlock and mode: open -> Close -> closed with mode off -> Mode Rate or Position, which starts to follow the demand;
Mode Off and Open let go of the axis. A trip opens the interlock as a fault that stays until Reset.
"""

from collections.abc import Mapping, Sequence
from math import inf, isfinite, nan
from typing import Any, Protocol

import simpy

from drivers.codecs.acl import AclError, Answer, Command, LineParser, decode_commands, encode_answer, spell

_IDENTITY = "Acutronic USA, ACT3000, simulated"
# A controller that interprets text at its servo rate answers within a few milliseconds.
_LATENCY_S = 0.005
# Seen by a working client as 'interlock trouble'.
_STATUS_TROUBLE = 65
# Acceleration is read back as a difference of rates over this time.
_DIFFERENCE_S = 0.1


class TablePlant(Protocol):
    """What the controller needs of the table it drives."""

    acceleration_dps2: float

    @property
    def max_rate_dps(self) -> float: ...
    @property
    def max_acceleration_dps2(self) -> float: ...
    def energise(self, now_s: float) -> None: ...
    def release(self, now_s: float) -> None: ...
    def command_rate(self, now_s: float, rate_dps: float) -> None: ...
    def command_position(self, now_s: float, position_deg: float) -> None: ...
    def set_acceleration(self, acceleration_dps2: float) -> None: ...
    def rate_dps(self, now_s: float) -> float: ...
    def position_deg(self, now_s: float) -> float: ...


class SimulatedAcutronicAcl:
    """The controller at the end of a serial line; settings are the driver's (`baud`, `axis`, `answers_commands`).

    prefixed: precede every answer with error word and length, as one TCP firmware does.
    """

    def __init__(
        self, env: simpy.Environment, table: TablePlant, settings: Mapping[str, Any], prefixed: bool = False
    ) -> None:
        self.env = env
        self.baud = int(settings.get("baud", 9600))
        self._answers_commands = bool(settings.get("answers_commands", True))
        self._prefixed = prefixed
        self._lines = LineParser()
        self._controller = _Controller(table, int(settings.get("axis", 1)))

    def trip(self, reason: str, held: bool = False) -> None:
        """The fault an emergency stop or an open door makes: the interlock opens and stays so until it is reset.

        held: resetting does not help until `let_reset` is called.
        """
        self._controller.trip(reason, self.env.now, held)

    def let_reset(self) -> None:
        """The cause of a trip is gone: it can be reset from now on."""
        self._controller.held = False

    def receive(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Execute every whole line; answer queries, errors and (unless told otherwise) commands."""
        replies = []
        for line in self._lines.feed(data):
            answer = self._answer(line, now_s)
            if answer is not None:
                replies.append((_LATENCY_S, encode_answer(answer, self._prefixed)))
        return replies

    def _answer(self, line: str, now_s: float) -> Answer | None:
        try:
            commands = decode_commands(line)
            texts = [text for command in commands if (text := self._controller.execute(command, now_s)) is not None]
        except (AclError, _RefusedError) as error:
            return Answer(f"ERROR {error}", error=1) if self._answers_commands or "?" in line else None
        if texts:
            return Answer(";".join(texts))
        return Answer("OK", error=0) if commands and self._answers_commands else None


class _RefusedError(Exception):
    """A command that is understood and not executed; its text goes out."""


class _Controller:
    """Interlock, mode and demands of one axis."""

    def __init__(self, table: TablePlant, axis: int) -> None:
        self._table, self._axis = table, axis
        self._interlock, self._mode = "Open", "Off"
        self.held = False
        self._limits = {"Rate": table.max_rate_dps, "Acceleration": table.max_acceleration_dps2}
        self._machine = dict(self._limits)
        self._demands = {"Rate": 0.0, "Position": 0.0, "Acceleration": table.acceleration_dps2}

    def execute(self, command: Command, now_s: float) -> str | None:
        """Carry out one command; the text of a query's answer, None for a command. Raises _RefusedError."""
        match command.path:
            case ("*IDN",) if command.query:
                return _IDENTITY
            case ("*STB",) if command.query:
                return str(_STATUS_TROUBLE if self._interlock.startswith("Fault") else 0)
            case ("Interlock", *action) if command.query != bool(action):
                return self._do_interlock(command, action, now_s)
            case ("Mode", *mode):
                return self._do_mode(command, mode, now_s)
            case ("Demand", "Oscillator"):
                raise _RefusedError("this table has no oscillator")
            case ("Demand", quantity):
                return self._do_demand(command, quantity, now_s)
            case ("Limit", quantity):
                return self._do_limit(command, quantity)
            case ("Read", quantity):
                return self._reading(command, quantity, now_s)
            case ("Utility", "Lockout") if command.arguments and command.arguments[0].upper() in ("ON", "OFF"):
                return None
        raise _RefusedError(f"{spell(command)} is no command of this table")

    def trip(self, reason: str, now_s: float, held: bool = False) -> None:
        """Open the interlock for a fault that stays until Reset, or until it is held no longer and then reset."""
        self.held = held
        self._interlock = f"Fault: {reason}"
        self._switch_off(now_s)

    def _switch_off(self, now_s: float) -> None:
        if self._mode != "Off":
            self._table.release(now_s)
        self._mode = "Off"

    def _do_interlock(self, command: Command, action: Sequence[str], now_s: float) -> str | None:
        if action == ["Reset"]:
            if self._interlock != "Close" and not self.held:
                self._interlock = "Open"
            return None
        self._check_axis(command)
        if not action:
            return self._interlock
        if action == ["Close"] and self._interlock.startswith("Fault"):
            raise _RefusedError(f"interlock in {self._interlock}; reset it first")
        if action == ["Open"]:
            self._switch_off(now_s)
        if not self._interlock.startswith("Fault"):
            self._interlock = action[0]
        return None

    def _do_mode(self, command: Command, mode: Sequence[str], now_s: float) -> str | None:
        self._check_axis(command)
        if command.query:
            return self._mode
        # `:Mode 1,Rate` says the same as `:Mode:Rate 1`.
        wanted = mode[0] if mode else _mode_named(command)
        if wanted == "Off":
            self._switch_off(now_s)
            return None
        if wanted == "Synthesis":
            raise _RefusedError("this table has no oscillator")
        if self._interlock != "Close":
            raise _RefusedError(f"interlock is not closed but {self._interlock}")
        if self._mode == "Off":
            self._table.energise(now_s)
        self._mode = wanted
        self._follow(wanted, now_s)
        return None

    def _follow(self, quantity: str, now_s: float) -> None:
        """Obey a demand that is in effect; one that is not waits for its mode."""
        value = self._demands[quantity]
        if quantity == "Acceleration":
            self._table.set_acceleration(value)
        elif quantity == self._mode == "Rate":
            self._table.command_rate(now_s, value)
        elif quantity == self._mode == "Position":
            self._table.command_position(now_s, value)

    def _do_demand(self, command: Command, quantity: str, now_s: float) -> str | None:
        self._check_axis(command)
        if command.query:
            return _shown(self._demands[quantity])
        value = _number(command)
        if abs(value) > self._limits.get(quantity, inf) or (quantity == "Acceleration" and value <= 0):
            raise _RefusedError(f"{spell(command)} is beyond the limit of {self._limits[quantity]:g}")
        self._demands[quantity] = value
        self._follow(quantity, now_s)
        return None

    def _do_limit(self, command: Command, quantity: str) -> str | None:
        self._check_axis(command)
        if command.query:
            return _shown(self._limits[quantity])
        value = _number(command)
        if not 0 < value <= self._machine[quantity]:
            raise _RefusedError(f"{spell(command)} is outside 0 to {self._machine[quantity]:g}")
        self._limits[quantity] = value
        return None

    def _reading(self, command: Command, quantity: str, now_s: float) -> str:
        self._check_axis(command)
        if quantity == "Position":
            return _shown(self._table.position_deg(now_s))
        rate_dps = self._table.rate_dps(now_s)
        if quantity == "Rate":
            return _shown(rate_dps)
        before_s = max(now_s - _DIFFERENCE_S, 0.0)
        moved_dps = rate_dps - self._table.rate_dps(before_s)
        return _shown(moved_dps / (now_s - before_s) if now_s > before_s else 0.0)

    def _check_axis(self, command: Command) -> None:
        if command.arguments[:1] != (str(self._axis),):
            raise _RefusedError(f"{spell(command)}: this table has axis {self._axis} only")


def _mode_named(command: Command) -> str:
    return decode_commands(f":Mode:{''.join(command.arguments[1:2])}")[0].path[1]


def _number(command: Command) -> float:
    try:
        value = float(command.arguments[1])
    except (IndexError, ValueError):
        value = nan
    if not isfinite(value):
        raise _RefusedError(f"{spell(command)} lacks a number")
    return value


def _shown(value: float) -> str:
    return f"{value:.6f}"
