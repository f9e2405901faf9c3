"""Power supply of the DUTs that speaks SCPI over a serial or TCP port: one output, switched and measured.

Source: SCPI-99 (see `drivers.codecs.scpi`): OUTPut, MEASure, SOURce:VOLTage, SOURce:CURRent and SYSTem:ERRor are
spelled alike by the makers of laboratory supplies. Nothing on this link switches the output off when the PC dies.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from drivers.codecs import scpi
from drivers.codecs.scpi import ScpiError, encode_message
from drivers.errors import BadReply, NoReply, Refused
from drivers.ports import PORT_FAILURES, SerialPort, failed

Value = TypeVar("Value")

# More than any answer; a talking instrument on the wrong port is cut off here.
_LONGEST_ANSWER = 512
# Entries of the error queue that are read at once; a supply keeps some ten.
_QUEUE = 32


@dataclass(frozen=True)
class ScpiSupplySettings:
    """Line, and what the output is set to when it is switched on.

    Fields:
        voltage_v, current_limit_a: sent before the output is switched on; None leaves what the supply is set to.
    """

    baud: int = 9600
    reply_timeout_s: float = 1.0
    tries: int = 3
    voltage_v: float | None = None
    current_limit_a: float | None = None

    def __post_init__(self) -> None:
        if self.baud <= 0:
            raise ValueError(f"baud: {self.baud}; it must be above 0")
        if not 0 < self.reply_timeout_s <= 60:
            raise ValueError(f"reply_timeout: {self.reply_timeout_s:g} s; it must be above 0 s and at most 60 s")
        if not 1 <= self.tries <= 10:
            raise ValueError(f"tries: {self.tries}; allowed are 1..10")
        for name, value, example in (
            ("voltage", self.voltage_v, "28 V"),
            ("current_limit", self.current_limit_a, "2 A"),
        ):
            if value is not None and not 0 < value < 1e4:
                raise ValueError(f"{name}: {value:g} {example[-1]}; it must be above 0, like {example}")


class ScpiSupply:
    """Driver of one output. The port is open, at `settings.baud`; its time-out is set here.

    Every method raises NoReply, BadReply, Refused or PortError (drivers.errors).
    """

    Settings: ClassVar[type[ScpiSupplySettings]] = ScpiSupplySettings

    def __init__(self, port: SerialPort, settings: ScpiSupplySettings) -> None:
        self._port, self._settings = port, settings
        self._where = f"SCPI power supply at {port.name}"
        self._received = b""
        # A question was left without an answer: one may still come, and nothing in it says to which question.
        self._owed = False
        port.timeout = settings.reply_timeout_s

    def identify(self) -> str:
        """The supply's own name."""
        text = self._query("*IDN", str)
        # What somebody else left in the queue is no answer to what comes now.
        self._errors()
        return text

    def switch(self, on: bool) -> None:
        """Output on, with voltage and current limit of the settings, or off. Read back whether it is."""
        s = self._settings
        if on and s.current_limit_a is not None:
            self._command("CURR", f"{s.current_limit_a:.6g}")
        if on and s.voltage_v is not None:
            self._command("VOLT", f"{s.voltage_v:.6g}")
        self._command("OUTP", "ON" if on else "OFF")

    def is_on(self) -> bool:
        """Whether the output is on, as the supply says."""
        return self._query("OUTP", scpi.boolean)

    def voltage_v(self) -> float:
        """Measured at the output."""
        return self._query("MEAS:VOLT", scpi.number)

    def current_a(self) -> float:
        """Measured at the output."""
        return self._query("MEAS:CURR", scpi.number)

    def fault(self) -> str | None:
        """What stands in the supply's error queue, which is emptied by reading it; None if nothing does."""
        return "; ".join(f"{text} ({code})" for code, text in self._errors()) or None

    def _errors(self) -> list[tuple[int, str]]:
        errors: list[tuple[int, str]] = []
        while len(errors) < _QUEUE:
            code, text = self._query("SYST:ERR", scpi.error_of)
            if code == scpi.NO_ERROR:
                break
            errors.append((code, text))
        return errors

    def _command(self, header: str, argument: str) -> None:
        """Send a command, and ask the error queue whether it was taken: commands are not answered."""
        try:
            self._port.write(encode_message(header, argument))
        except PORT_FAILURES as error:
            raise failed(self._port, error) from error
        if errors := self._errors():
            code, text = errors[0]
            raise Refused(self._where, f"{header} {argument}", code, f"{text}. See the supply's limits")

    def _query(self, header: str, read: Callable[[str], Value]) -> Value:
        """The answer to a question, as `read` understands it."""
        text = self._ask(header)
        try:
            return read(text)
        except ScpiError as error:
            raise self._bad(f"{header}?", str(error)) from None

    def _bad(self, request: str, why: str) -> BadReply:
        self._owed = True
        return BadReply(self._where, request, self._received, why)

    def _ask(self, header: str) -> str:
        request = f"{header}?"
        tries = self._settings.tries
        try:
            if self._owed:
                self._port.read(_LONGEST_ANSWER)
            self._owed = False
            for _ in range(tries):
                self._port.reset_input_buffer()
                self._port.write(encode_message(header, query=True))
                line = self._line()
                if line:
                    return line
                self._owed = True
        except PORT_FAILURES as error:
            raise failed(self._port, error) from error
        if self._received:
            raise self._bad(request, "it is no line of text")
        raise NoReply(self._where, request, self._settings.reply_timeout_s, tries)

    def _line(self) -> str:
        """The next line; empty when none comes, or bytes that are no text."""
        self._received = b""
        while b"\n" not in self._received and len(self._received) < _LONGEST_ANSWER:
            data = self._port.read(self._port.in_waiting or 1)
            if not data:
                return ""
            self._received += data
        line, end, _ = self._received.partition(b"\n")
        text = line.strip(b"\r ")
        return text.decode("ascii") if end and text.isascii() and text.decode("ascii").isprintable() else ""
