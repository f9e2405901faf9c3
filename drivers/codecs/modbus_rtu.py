"""Modbus RTU, both roles: functions 3 and 4 (read registers), 6 (write one), 16 (write many) and exception replies.

Source: MODBUS Application Protocol 1.1b3, sections 6.3, 6.4, 6.6, 6.12 and 7; MODBUS over Serial Line 1.02, 2.5.1 and
6.2.2 (CRC, low byte first). Frames are told apart by the length their function code implies, not by the 3.5-character
gap, which does not survive USB adapters and was found unreliable on Watlow controllers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from struct import Struct
from types import MappingProxyType

from drivers.codecs.crc import CRCS

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
EXCEPTION_TEXTS = MappingProxyType(
    {
        1: "illegal function",
        2: "illegal register",
        3: "illegal value",
        4: "device failure",
        5: "acknowledged, still busy",
        6: "busy",
        8: "memory parity error",
        10: "gateway path unavailable",
        11: "gateway target silent",
    }
)

BROADCAST = 0
MAX_UNIT = 247
# Largest frame on a serial line (Serial Line 1.02, 2.5.1) and the register counts that fit into it.
MAX_FRAME, MAX_READ, MAX_WRITE = 256, 125, 123

_FOUR = Struct(">BBHH")
_CRC = CRCS["crc16-modbus"]


class ModbusError(ValueError):
    """Bytes that are no Modbus RTU frame, or a message that does not fit into one."""


@dataclass(frozen=True, slots=True)
class Read:
    """Read `count` registers from `register` on (function 3, or 4 for input registers)."""

    unit: int
    register: int
    count: int = 1
    function: int = READ_HOLDING


@dataclass(frozen=True, slots=True)
class WriteOne:
    """Write one register (function 6); `value` is the word on the wire, 0..65535."""

    unit: int
    register: int
    value: int


@dataclass(frozen=True, slots=True)
class WriteMany:
    """Write registers from `register` on (function 16)."""

    unit: int
    register: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class OtherRequest:
    """A request with a function that is not spoken here; it deserves exception 1."""

    unit: int
    function: int


@dataclass(frozen=True, slots=True)
class Registers:
    """Answer to `Read`: the words as on the wire, 0..65535."""

    unit: int
    values: tuple[int, ...]
    function: int = READ_HOLDING


@dataclass(frozen=True, slots=True)
class Written:
    """Answer to a write: `value` is the word written (function 6) or the number of registers (function 16)."""

    unit: int
    function: int
    register: int
    value: int


@dataclass(frozen=True, slots=True)
class ExceptionReply:
    """The request was understood and refused; `code` as in `EXCEPTION_TEXTS`."""

    unit: int
    function: int
    code: int


Request = Read | WriteOne | WriteMany | OtherRequest
Reply = Registers | Written | ExceptionReply


def to_word(value: int) -> int:
    """A signed register value as the word on the wire (two's complement).

    >>> hex(to_word(-200))
    '0xff38'
    """
    if not -0x8000 <= value <= 0x7FFF:
        raise ModbusError(f"{value} does not fit in a signed 16-bit register (-32768..32767)")
    return value & 0xFFFF


def to_signed(word: int) -> int:
    """The signed value of a word from the wire."""
    return word - 0x10000 if word & 0x8000 else word


def encode_request(request: Read | WriteOne | WriteMany) -> bytes:
    """The frame of a request. Raises ModbusError for a unit, register, count or value out of range.

    >>> encode_request(WriteOne(1, 300, to_word(-200))).hex(" ").upper()
    '01 06 01 2C FF 38 09 DD'
    """
    _check("unit", request.unit, 0, MAX_UNIT)
    _check("register", request.register, 0, 0xFFFF)
    match request:
        case Read(unit, register, count, function):
            _check("count", count, 1, MAX_READ)
            _check_function(function, (READ_HOLDING, READ_INPUT))
            return _framed(_FOUR.pack(unit, function, register, count))
        case WriteOne(unit, register, value):
            _check("value", value, 0, 0xFFFF)
            return _framed(_FOUR.pack(unit, WRITE_ONE, register, value))
        case WriteMany(unit, register, values):
            _check("count", len(values), 1, MAX_WRITE)
            head = _FOUR.pack(unit, WRITE_MANY, register, len(values))
            return _framed(head + bytes([2 * len(values)]) + _words(values))


def encode_reply(reply: Reply) -> bytes:
    """The frame of a reply. Raises ModbusError for a unit, register, count or value out of range."""
    _check("unit", reply.unit, 0, MAX_UNIT)
    match reply:
        case Registers(unit, values, function):
            _check("count", len(values), 1, MAX_READ)
            _check_function(function, (READ_HOLDING, READ_INPUT))
            return _framed(bytes([unit, function, 2 * len(values)]) + _words(values))
        case Written(unit, function, register, value):
            _check("register", register, 0, 0xFFFF)
            _check("value", value, 0, 0xFFFF)
            _check_function(function, (WRITE_ONE, WRITE_MANY))
            return _framed(_FOUR.pack(unit, function, register, value))
        case ExceptionReply(unit, function, code):
            _check("function", function, 1, 0x7F)
            _check("code", code, 1, 0xFF)
            return _framed(bytes([unit, function | 0x80, code]))


def decode_request(frame: bytes) -> Request:
    """The request in one whole frame. Raises ModbusError saying what is wrong with it."""
    _check_frame(frame)
    unit, function = frame[0], frame[1]
    length = request_length(frame)
    if length == 0:
        return OtherRequest(unit, function)
    _check_length(frame, length)
    _, _, register, value = _FOUR.unpack_from(frame)
    if function == WRITE_ONE:
        return WriteOne(unit, register, value)
    if function == WRITE_MANY:
        if frame[6] != 2 * value or not 1 <= value <= MAX_WRITE:
            raise ModbusError(
                f"write of {value} registers with {frame[6]} bytes; allowed are 1..{MAX_WRITE} of 2 bytes"
            )
        return WriteMany(unit, register, _unpacked(frame[7:-2]))
    return Read(unit, register, value, function)


def decode_reply(frame: bytes) -> Reply:
    """The reply in one whole frame. Raises ModbusError saying what is wrong with it.

    >>> decode_reply(bytes.fromhex("01 03 02 FF 38 F8 66"))
    Registers(unit=1, values=(65336,), function=3)
    """
    _check_frame(frame)
    unit, function = frame[0], frame[1]
    length = reply_length(frame)
    if length == 0:
        raise ModbusError(f"reply with function {function}, which is not spoken here")
    _check_length(frame, length)
    if function & 0x80:
        return ExceptionReply(unit, function & 0x7F, frame[2])
    if function in (READ_HOLDING, READ_INPUT):
        if frame[2] % 2 or frame[2] == 0:
            raise ModbusError(f"reply with {frame[2]} bytes of registers; it must be an even number above 0")
        return Registers(unit, _unpacked(frame[3:-2]), function)
    _, _, register, value = _FOUR.unpack_from(frame)
    return Written(unit, function, register, value)


def request_length(start: bytes) -> int | None:
    """Length of the request that begins with these bytes; None = more bytes needed, 0 = not known from its function."""
    if len(start) < 2:
        return None
    function = start[1]
    if function == WRITE_MANY:
        return 9 + start[6] if len(start) > 6 else None
    return 8 if function in (READ_HOLDING, READ_INPUT, WRITE_ONE) else 0


def reply_length(start: bytes) -> int | None:
    """Length of the reply that begins with these bytes; None = more bytes needed, 0 = not known from its function."""
    if len(start) < 2:
        return None
    function = start[1]
    if function & 0x80:
        return 5
    if function in (READ_HOLDING, READ_INPUT):
        return 5 + start[2] if len(start) > 2 else None
    return 8 if function in (WRITE_ONE, WRITE_MANY) else 0


class FrameParser:
    """Frames out of a stream of bytes: `FrameParser(request_length)` or `FrameParser(reply_length)`.

    Junk before a frame is skipped. A frame whose length its function does not tell is taken when it ends with the bytes
    fed so far. `clear` after a silence on the line drops what is left of a broken frame.
    """

    def __init__(self, length_of: Callable[[bytes], int | None]) -> None:
        self._length_of = length_of
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """All frames with a right CRC that are complete by now, in order."""
        rest, frames = self._rest + data, []
        while (found := self._first_frame(rest)) is not None:
            start, end = found
            frames.append(rest[start:end])
            rest = rest[end:]
        self._rest = rest[-MAX_FRAME:]
        return frames

    def clear(self) -> None:
        """Forget an unfinished frame."""
        self._rest = b""

    def _first_frame(self, data: bytes) -> tuple[int, int] | None:
        for start in range(len(data) - 3):
            length = self._length_of(data[start : start + 8])
            if length and start + length <= len(data) and _CRC.of(data[start : start + length]) == 0:
                return start, start + length
        if 4 <= len(data) <= MAX_FRAME and self._length_of(data[:8]) == 0 and _CRC.of(data) == 0:
            return 0, len(data)
        return None


def _framed(body: bytes) -> bytes:
    return body + _CRC.of(body).to_bytes(2, "little")


def _words(values: Sequence[int]) -> bytes:
    for value in values:
        _check("value", value, 0, 0xFFFF)
    return b"".join(value.to_bytes(2, "big") for value in values)


def _unpacked(data: bytes) -> tuple[int, ...]:
    return tuple(data[at] << 8 | data[at + 1] for at in range(0, len(data), 2))


def _check(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise ModbusError(f"{name} {value} is out of range; allowed are {low}..{high}")


def _check_function(function: int, allowed: tuple[int, int]) -> None:
    if function not in allowed:
        raise ModbusError(f"function {function} does not fit this message; allowed are {allowed[0]} and {allowed[1]}")


def _check_frame(frame: bytes) -> None:
    if not 4 <= len(frame) <= MAX_FRAME:
        raise ModbusError(f"a frame of {len(frame)} bytes; a Modbus RTU frame has 4..{MAX_FRAME}")
    # The CRC over a message and its own CRC is zero.
    if _CRC.of(frame) != 0:
        raise ModbusError("the CRC does not match")


def _check_length(frame: bytes, length: int | None) -> None:
    if length != len(frame):
        expected = "more" if length is None else str(length)
        raise ModbusError(f"function {frame[1]} with {len(frame)} bytes; it takes {expected}")
