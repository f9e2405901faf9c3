"""Questions to one Modbus unit over a serial port: write, read the reply at the length its function implies, repeat.

A damaged or missing reply is asked for again; a late one, which tells nothing of its question, is waited out.
"""

from collections.abc import Mapping
from functools import lru_cache

from drivers.codecs import modbus_rtu
from drivers.codecs.modbus_rtu import ModbusError, Read, WriteMany, WriteOne
from drivers.errors import BadReply, NoReply, Refused
from drivers.ports import PORT_FAILURES, SerialPort, failed

# An exception reply, the shortest there is.
_SHORTEST_REPLY = 5
# Bytes of a foreign reply that are enough to recognise it: more than one frame of any gyro we know.
_LOOK_AT = 64

_encoded = lru_cache(maxsize=256)(modbus_rtu.encode_request)


class ModbusUnit:
    """The registers of one unit. Every method raises NoReply, BadReply, Refused or PortError (drivers.errors).

    `what` is what messages call the instrument; `advice` what they add, by the code of an exception reply.
    """

    def __init__(
        self,
        port: SerialPort,
        what: str,
        address: int,
        reply_timeout_s: float,
        tries: int,
        advice: Mapping[int, str],
    ) -> None:
        self._port, self._address, self._advice = port, address, advice
        self._reply_timeout_s, self._tries = reply_timeout_s, tries
        self._where = f"{what} at {port.name} (address {address})"
        self._received = b""
        # A question was left without a good answer: one may still come, and nothing in it says to which question.
        self._owed = False
        port.timeout = reply_timeout_s

    def read(self, register: int, allowed: tuple[int, ...] = ()) -> int:
        """One register, as the word on the wire."""
        (word,) = self.read_many(register, 1)
        if allowed and word not in allowed:
            why = f"the register holds {word}; this driver works with {' or '.join(map(str, allowed))}"
            raise BadReply(self._where, _read_text(register, 1), self._received, why)
        return word

    def read_many(self, register: int, count: int) -> tuple[int, ...]:
        """`count` registers from `register` on."""
        request = Read(self._address, register, count)
        reply = self._ask(request, _read_text(register, count))
        if not isinstance(reply, modbus_rtu.Registers) or len(reply.values) != count:
            why = f"it does not hold exactly {count} register{'s' if count > 1 else ''}"
            raise BadReply(self._where, _read_text(register, count), self._received, why)
        return reply.values

    def write(self, register: int, word: int) -> None:
        """One register (function 6), checked by its echo."""
        text = f"write {modbus_rtu.to_signed(word)} to register {register}"
        reply = self._ask(WriteOne(self._address, register, word), text)
        self._check_written(reply, text, register, word)

    def write_many(self, register: int, words: tuple[int, ...]) -> None:
        """Neighbouring registers in one go (function 16)."""
        text = f"write {', '.join(str(modbus_rtu.to_signed(word)) for word in words)} from register {register} on"
        reply = self._ask(WriteMany(self._address, register, words), text)
        self._check_written(reply, text, register, len(words))

    def _check_written(self, reply: modbus_rtu.Reply, text: str, register: int, value: int) -> None:
        if not isinstance(reply, modbus_rtu.Written) or (reply.register, reply.value) != (register, value):
            raise BadReply(self._where, text, self._received, "it confirms something else than what was written")

    def _ask(self, request: Read | WriteOne | WriteMany, text: str) -> modbus_rtu.Reply:
        frame, seen, why = _encoded(request), b"", ""
        try:
            self._wait_out_late_reply()
            for left in reversed(range(self._tries)):
                self._port.reset_input_buffer()
                self._port.write(frame)
                received = self._receive(frame)
                try:
                    return self._accepted(received, frame, text)
                except ModbusError as error:
                    self._owed = True
                    if received and not left:
                        # A damaged or foreign reply: look at more of it, so that the message can say what it is.
                        received += self._port.read(_LOOK_AT)
                    seen, why = (received, str(error)) if received else (seen, why)
        except PORT_FAILURES as error:
            raise failed(self._port, error) from error
        if seen:
            raise BadReply(self._where, text, seen, why)
        raise NoReply(self._where, text, self._reply_timeout_s, self._tries)

    def _wait_out_late_reply(self) -> None:
        if self._owed:
            self._port.read(_LOOK_AT)
            self._owed = False

    def _receive(self, request: bytes) -> bytes:
        received = self._port.read(_SHORTEST_REPLY)
        if len(received) == _SHORTEST_REPLY:
            if received[1] & 0x7F == request[1]:
                missing = (modbus_rtu.reply_length(received) or 0) - len(received)
            else:  # no reply to this: what else is there tells what it is
                missing = min(self._port.in_waiting, _LOOK_AT)
            received += self._port.read(missing) if missing > 0 else b""
        self._received = received
        return received

    def _accepted(self, received: bytes, request: bytes, text: str) -> modbus_rtu.Reply:
        """The reply in the bytes received. Raises ModbusError for anything else, Refused for an exception reply."""
        reply = modbus_rtu.decode_reply(received)
        if reply.unit != request[0] or reply.function != request[1]:
            raise ModbusError(f"it comes from address {reply.unit} and function {reply.function}")
        if isinstance(reply, modbus_rtu.ExceptionReply):
            meaning = modbus_rtu.EXCEPTION_TEXTS.get(reply.code, "not in the standard")
            raise Refused(self._where, text, f"exception {reply.code}, {meaning}", self._advice.get(reply.code, ""))
        return reply


def _read_text(register: int, count: int) -> str:
    return f"read register {register}" if count == 1 else f"read registers {register} to {register + count - 1}"
