"""Rate table with an Acutronic ACUTROL controller, one axis, command language ACL over a serial or TCP port.

Source: protocol notes, rate tables, section 1 (three open clients; checked against client code, not on hardware).
Nothing on this link stops an axis in Rate mode when the PC dies: whoever energises the table stops it on every exit.
"""

from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from drivers.codecs.acl import AclError, Answer, AnswerParser, Command, encode_commands, spell
from drivers.errors import BadReply, NoReply, Refused
from drivers.ports import PORT_FAILURES, SerialPort, failed

_MODES = {"o": "off", "p": "position", "r": "rate", "s": "synthesis"}
# More than any answer; a talking instrument on the wrong port is cut off here.
_LONGEST_ANSWER = 512


@dataclass(frozen=True)
class AcutronicAclSettings:
    """Line, axis and what differs between installations.

    Fields:
        acceleration_dps2: demanded when energised; None leaves the table's own.
        terminator: TCP clients send CR LF, GPIB adapters want LF.
        answers_commands: False where only queries are answered (GPIB).
        identity: text that the answer to *IDN? must hold.
        lockout: keep other operators out while energised.
    """

    baud: int = 9600
    axis: int = 1
    reply_timeout_s: float = 1.0
    tries: int = 3
    acceleration_dps2: float | None = None
    terminator: Literal["lf", "crlf"] = "crlf"
    answers_commands: bool = True
    identity: str = "Acutronic"
    lockout: bool = False

    def __post_init__(self) -> None:
        if self.baud <= 0:
            raise ValueError(f"baud: {self.baud}; it must be above 0")
        if not 1 <= self.axis <= 9:
            raise ValueError(f"axis: {self.axis}; allowed are 1..9, axes count from 1")
        if not 0 < self.reply_timeout_s <= 60:
            raise ValueError(f"reply_timeout: {self.reply_timeout_s:g} s; it must be above 0 s and at most 60 s")
        if not 1 <= self.tries <= 10:
            raise ValueError(f"tries: {self.tries}; allowed are 1..10")
        if self.terminator not in ("lf", "crlf"):
            raise ValueError(f"terminator: '{self.terminator}'; allowed are lf and crlf")
        if self.acceleration_dps2 is not None and not 0 < self.acceleration_dps2 < 1e6:
            raise ValueError(f"acceleration: {self.acceleration_dps2:g} deg/s2; it must be above 0")


class AcutronicAcl:
    """Driver of one axis. The port is open, at `settings.baud`; its time-out is set here.

    Every method raises NoReply, BadReply, Refused or PortError (drivers.errors). A command that is acknowledged is not
    yet motion: read back.
    """

    Settings = AcutronicAclSettings

    def __init__(self, port: SerialPort, settings: AcutronicAclSettings) -> None:
        self._link = _Link(port, settings)
        self._settings = settings
        self._axis = str(settings.axis)
        # None: not known, so that the next motion sends its mode again.
        self._mode: str | None = None
        self._energised = False

    def identify(self) -> str:
        """The controller's own name. Raises BadReply when it is not the one in the settings."""
        request = Command(("*IDN",), query=True)
        text = self._link.query(request)
        if self._settings.identity.lower() not in text.lower():
            raise self._link.bad(request, f"it does not hold '{self._settings.identity}' (setting: identity)")
        return text

    def energise(self) -> None:
        """Reset old faults, close the interlock and hold the axis at zero rate in Rate mode."""
        if self._settings.lockout:
            self._link.command(Command(("Utility", "Lockout"), ("ON",)))
        self._link.command(Command(("Interlock", "Reset")))
        if self._settings.acceleration_dps2 is not None:
            self.set_acceleration_dps2(self._settings.acceleration_dps2)
        # Not repeated without an answer: if it was executed and tripped at once, a person has to look first.
        self._link.command(Command(("Interlock", "Close"), (self._axis,)), tries=1)
        self._energised, self._mode = True, None
        self.set_rate_dps(0.0)

    def release(self) -> None:
        """Mode off, interlock open: the axis is free. Stop it and see it at rest before."""
        self._energised, self._mode = False, None
        # An axis that a fault has already opened may refuse the mode; it is to be opened all the same.
        with suppress(Refused):
            self._link.command(Command(("Mode", "Off"), (self._axis,)))
        self._link.command(Command(("Interlock", "Open"), (self._axis,)))
        if self._settings.lockout:
            self._link.command(Command(("Utility", "Lockout"), ("OFF",)))

    def set_rate_dps(self, rate_dps: float) -> None:
        """Turn at this rate from now on. Raises ValueError for a value that is no number."""
        self._demand("Rate", rate_dps)
        self._enter("rate")

    def go_to_deg(self, position_deg: float) -> None:
        """Go to this position; a continuous axis takes the shortest way."""
        self._demand("Position", position_deg)
        self._enter("position")

    def set_acceleration_dps2(self, acceleration_dps2: float) -> None:
        """Acceleration of every later change of rate. Raises ValueError for one that is not above 0."""
        if not acceleration_dps2 > 0:
            raise ValueError(f"acceleration: {acceleration_dps2} deg/s2; it must be above 0")
        self._demand("Acceleration", acceleration_dps2)

    def stop(self) -> None:
        """Rate zero, whatever the mode. On an axis that is not energised there is nothing to stop, and no error."""
        try:
            self._mode = None
            self.set_rate_dps(0.0)
        except Refused:
            if "close" in self._interlock().lower():
                raise

    def rate_dps(self) -> float:
        """Rate read back from the table's own encoder."""
        return self._read("Rate")

    def position_deg(self) -> float:
        """Position read back from the table's own encoder."""
        return self._read("Position")

    def fault(self) -> str | None:
        """The interlock's words when it is in fault, or open although this driver closed it; else None."""
        text = self._interlock()
        opened = self._energised and "close" not in text.lower()
        return f"interlock: {text}" if "fault" in text.lower() or opened else None

    def mode(self) -> str:
        """'off', 'position', 'rate' or 'synthesis'; the controller may answer a word or its first letter."""
        request = Command(("Mode",), (self._axis,), query=True)
        text = self._link.query(request)
        if text[:1].lower() not in _MODES:
            raise self._link.bad(request, f"'{text}' is no mode; known are {', '.join(_MODES.values())}")
        return _MODES[text[:1].lower()]

    def _demand(self, what: str, value: float) -> None:
        if not isfinite(value):
            raise ValueError(f"{what.lower()}: {value}; it must be a number")
        # Fixed point: how the controller takes exponents is not known.
        self._link.command(Command(("Demand", what), (self._axis, f"{value + 0.0:.6f}")))

    def _enter(self, mode: str) -> None:
        # The demand is set before the mode: the change of mode moves to it.
        if self._mode != mode:
            self._mode = None
            self._link.command(Command(("Mode", mode.capitalize()), (self._axis,)))
            self._mode = mode

    def _interlock(self) -> str:
        request = Command(("Interlock",), (self._axis,), query=True)
        text = self._link.query(request)
        if not any(word in text.lower() for word in ("open", "close", "fault")):
            raise self._link.bad(request, f"'{text}' says neither Open nor Close nor Fault")
        return text

    def _read(self, what: str) -> float:
        request = Command(("Read", what), (self._axis,), query=True)
        text = self._link.query(request)
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise self._link.bad(request, f"'{text}' is no number")
        return value


class _Link:
    """Command lines and their answers; repeats what got none."""

    def __init__(self, port: SerialPort, settings: AcutronicAclSettings) -> None:
        self._port, self._settings = port, settings
        self._where = f"Acutronic ACL table at {port.name}"
        self._received = b""
        # A question was left without a good answer: one may still come, and nothing in it says to which question.
        self._owed = False
        port.timeout = settings.reply_timeout_s

    def query(self, request: Command) -> str:
        """The text a query is answered with."""
        text = self._ask(request, self._settings.tries).text
        if not text:
            raise self.bad(request, "it is empty")
        return text

    def command(self, request: Command, tries: int | None = None) -> None:
        """Send a command and take its acknowledgement: 'OK' or an empty line."""
        if not self._settings.answers_commands:
            try:
                self._send(request)
            except PORT_FAILURES as error:
                raise failed(self._port, error) from error
        elif (text := self._ask(request, tries or self._settings.tries).text).lower() not in ("", "ok"):
            raise self.bad(request, f"'{text}' is no acknowledgement")

    def bad(self, request: Command, why: str) -> BadReply:
        """The error for an answer that arrived well but makes no sense."""
        return BadReply(self._where, spell(request), self._received, why)

    def _send(self, request: Command) -> None:
        self._port.reset_input_buffer()
        self._port.write(encode_commands([request], self._settings.terminator))

    def _ask(self, request: Command, tries: int) -> Answer:
        seen, why = b"", ""
        try:
            if self._owed:
                self._port.read(_LONGEST_ANSWER)
            self._owed = False
            for _ in range(tries):
                self._send(request)
                try:
                    return self._accepted(self._answer(), request)
                except AclError as error:
                    self._owed = True
                    seen, why = (self._received, str(error)) if self._received else (seen, why)
        except PORT_FAILURES as error:
            raise failed(self._port, error) from error
        if seen:
            raise BadReply(self._where, spell(request), seen, why)
        raise NoReply(self._where, spell(request), self._settings.reply_timeout_s, tries)

    def _answer(self) -> Answer:
        """The next answer on the line. Raises AclError when none comes or it is none."""
        parser, self._received = AnswerParser(), b""
        while len(self._received) < _LONGEST_ANSWER:
            data = self._port.read(self._port.in_waiting or 1)
            if not data:
                raise AclError("it stops before the end of a line")
            self._received += data
            if answers := parser.feed(data):
                return answers[0]
        raise AclError(f"it has no end within {_LONGEST_ANSWER} bytes")

    def _accepted(self, answer: Answer, request: Command) -> Answer:
        if answer.error:
            raise Refused(self._where, spell(request), answer.error, answer.text)
        # How an error answer reads is not public: one that begins so is taken as a refusal, not as a foreign protocol.
        if answer.text.lower().startswith(("err", "?")):
            raise Refused(self._where, spell(request), answer.text)
        return answer
