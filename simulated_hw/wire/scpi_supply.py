"""A simulated SCPI power supply: the far end of `drivers.power_supplies.scpi_supply`.

It knows the commands that laboratory supplies have in common; every other one, and what it cannot do, goes into its
error queue, as SCPI has it, and nothing is answered.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import simpy

from drivers.codecs import scpi
from drivers.codecs.acl import LineParser
from drivers.codecs.scpi import Message, ScpiError, decode_messages, encode_answer, is_header

_IDENTITY = "fogbench,simulated power supply,0,1.0"
# A supply's interpreter answers within some ten milliseconds; a measurement takes longer, and here is none.
_LATENCY_S = 0.02
_QUEUE = 16
_TEXTS = {
    scpi.UNDEFINED_HEADER: "Undefined header",
    scpi.DATA_OUT_OF_RANGE: "Data out of range",
    scpi.MISSING_PARAMETER: "Missing parameter",
    scpi.DATA_TYPE_ERROR: "Data type error",
    scpi.NO_ERROR: "No error",
}


class Supply(Protocol):
    """What the interpreter needs of the output behind it."""

    on: bool
    voltage_v: float
    current_limit_a: float

    def switch(self, now_s: float, on: bool) -> None: ...
    def set_voltage(self, now_s: float, voltage_v: float) -> None: ...
    def set_current_limit(self, now_s: float, current_a: float) -> None: ...
    def output_v(self, now_s: float) -> float: ...
    def output_a(self, now_s: float) -> float: ...


class SimulatedScpiSupply:
    """The supply at the end of a serial line; settings are the driver's (`baud`)."""

    def __init__(self, env: simpy.Environment, supply: Supply, settings: Mapping[str, Any]) -> None:
        self.env = env
        self.baud = int(settings.get("baud", 9600))
        self._supply = supply
        self._lines = LineParser()
        self._errors: deque[int] = deque(maxlen=_QUEUE)

    def receive(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Execute every whole line; answer its queries."""
        replies = []
        for line in self._lines.feed(data):
            texts = [text for message in decode_messages(line) if (text := self._answered(message, now_s)) is not None]
            if texts:
                replies.append((_LATENCY_S, encode_answer(texts)))
        return replies

    def _answered(self, message: Message, now_s: float) -> str | None:
        """The answer to one message; what is wrong with it goes into the queue."""
        try:
            if message.query:
                return self._query(message, now_s)
            self._command(message, now_s)
        except _Refused as refused:
            self._errors.append(refused.code)
        return None

    def _query(self, message: Message, now_s: float) -> str:
        supply = self._supply
        known: dict[str, Callable[[], str]] = {
            "*IDN": lambda: _IDENTITY,
            "SYSTem:ERRor[:NEXT]": self._next_error,
            "OUTPut[:STATe]": lambda: str(int(supply.on)),
            "MEASure[:SCALar]:VOLTage[:DC]": lambda: f"{supply.output_v(now_s):.4f}",
            "MEASure[:SCALar]:CURRent[:DC]": lambda: f"{supply.output_a(now_s):.4f}",
            "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]": lambda: f"{supply.voltage_v:.4f}",
            "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]": lambda: f"{supply.current_limit_a:.4f}",
        }
        text: str = _chosen(message, known)()
        return text

    def _command(self, message: Message, now_s: float) -> None:
        supply = self._supply
        known: dict[str, Callable[[], None]] = {
            "*CLS": self._errors.clear,
            "OUTPut[:STATe]": lambda: supply.switch(now_s, scpi.boolean(_argument(message))),
            "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]": lambda: supply.set_voltage(
                now_s, scpi.number(_argument(message))
            ),
            "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]": lambda: supply.set_current_limit(
                now_s, scpi.number(_argument(message))
            ),
        }
        try:
            _chosen(message, known)()
        except ScpiError:
            raise _Refused(scpi.DATA_TYPE_ERROR) from None
        except ValueError:
            raise _Refused(scpi.DATA_OUT_OF_RANGE) from None

    def _next_error(self) -> str:
        code = self._errors.popleft() if self._errors else scpi.NO_ERROR
        return f'{code},"{_TEXTS[code]}"'


class _Refused(Exception):
    """A message that is not executed, and the number of the error that it makes."""

    def __init__(self, code: int) -> None:
        super().__init__(_TEXTS[code])
        self.code = code


def _chosen(message: Message, known: Mapping[str, Callable[[], Any]]) -> Callable[[], Any]:
    for form, action in known.items():
        if is_header(message.header, form):
            return action
    raise _Refused(scpi.UNDEFINED_HEADER)


def _argument(message: Message) -> str:
    if not message.arguments:
        raise _Refused(scpi.MISSING_PARAMETER)
    return message.arguments[0]
