"""DBC files: which bits of a CAN message hold which number, read and written for whole batches of messages.

Only what describes numbers is read: BO_, SG_ and SIG_VALTYPE_. Everything else in a DBC (nodes, comments, attributes,
value tables) is passed over. Classic CAN, at most 8 bytes.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.batch import Raw, RawType
from drivers.codecs.declared import FrameSpecError

Payload = NDArray[np.uint8]

# In DBC files, as in SocketCAN, bit 31 of an identifier marks the 29-bit kind.
EXTENDED = 1 << 31
PAYLOAD_BYTES = 8

_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_COMMENT = re.compile(r'^[ \t]*CM_ [^"]*"(?:\\.|[^"\\])*"\s*;', re.MULTILINE)
# Ten digits hold 32 bits; Python refuses to read numbers of thousands.
_MESSAGE = re.compile(r"BO_\s+(\d{1,10})\s+(\w+)\s*:\s*(\d{1,10})\s+\w+")
_SIGNAL = re.compile(
    r"SG_\s+(\w+)\s*(M|m\d+M?)?\s*:\s*(\d{1,10})\|(\d{1,10})@([01])([+-])"
    rf"\s*\({_NUMBER},{_NUMBER}\)\s*\[{_NUMBER}\|{_NUMBER}\]\s*\"([^\"]*)\""
)
_VALUE_TYPE = re.compile(r"SIG_VALTYPE_\s+(\d{1,10})\s+(\w+)\s*:?\s*([0-3])\s*;")


@dataclass(frozen=True)
class Signal:
    """A number in a message: value = raw * scale + offset, in `unit`. start and length are bits as DBC counts them."""

    name: str
    start: int
    length: int
    big_endian: bool
    raw_type: RawType
    scale: float
    offset: float
    unit: str
    multiplexed: bool = False

    @property
    def lowest_bit(self) -> int:
        """Its least significant bit, counted from the low end of the payload read as one number in its byte order."""
        if not self.big_endian:
            return self.start
        # Motorola: `start` names the most significant bit; bit 7 of a byte comes first.
        from_top = 8 * (self.start // 8) + 7 - self.start % 8
        return 64 - from_top - self.length

    @property
    def last_byte(self) -> int:
        """The last byte of the payload it touches."""
        return (63 - self.lowest_bit) // 8 if self.big_endian else (self.start + self.length - 1) // 8

    def read(self, payload: Payload) -> Raw:
        """Raw values of messages uint8[n, 8] (contiguous), as a new array of its raw type."""
        if self._fills_bytes:
            return self._bytes(payload).astype(self.raw_type.dtype)
        low = self.lowest_bit
        bits = np.left_shift(self._word(payload), np.uint64(64 - low - self.length), dtype=np.uint64)
        if self.raw_type.dtype.kind == "i":
            # bringing the number to the top and back down copies its sign into the bits above it
            return np.right_shift(bits.view(np.int64), 64 - self.length).astype(self.raw_type.dtype)
        bits >>= np.uint64(64 - self.length)
        if self.raw_type.dtype.kind == "f":
            return bits.astype(f"u{self.length // 8}").view(self.raw_type.dtype)
        return bits.astype(self.raw_type.dtype)

    def write(self, payload: Payload, values: Raw) -> None:
        """Put raw values of its raw type into messages uint8[n, 8] (contiguous) whose bits there are zero."""
        if self._fills_bytes:
            self._bytes(payload)[:] = values
            return
        if self.raw_type.dtype.kind == "f":
            values = values.astype(self.raw_type.dtype).view(f"u{self.length // 8}")
        bits = values.astype(np.int64).view(np.uint64) & np.uint64((1 << self.length) - 1)
        word = self._word(payload)
        np.bitwise_or(word, bits << np.uint64(self.lowest_bit), out=word)

    @property
    def _fills_bytes(self) -> bool:
        return self.length in (8, 16, 32, 64) and self.lowest_bit % 8 == 0

    def _bytes(self, payload: Payload) -> Raw:
        first = self.start // 8
        dtype = self.raw_type.dtype.newbyteorder(">" if self.big_endian else "<")
        return payload[:, first : first + self.length // 8].view(dtype)[:, 0]

    def _word(self, payload: Payload) -> NDArray[np.uint64]:
        word: NDArray[np.uint64] = payload.view(">u8" if self.big_endian else "<u8")[:, 0]
        return word


@dataclass(frozen=True)
class Message:
    """A CAN message: identifier (bit 31 set for a 29-bit one), length in bytes, signals by name."""

    name: str
    can_id: int
    length: int
    signals: Mapping[str, Signal]


def parse_dbc(text: str) -> dict[str, Message]:
    """All messages of a DBC, by name. Raises FrameSpecError with the line number."""
    text = _COMMENT.sub(lambda comment: "\n" * comment.group().count("\n"), text)
    messages: list[tuple[str, int, int, dict[str, Signal]]] = []
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if line.startswith("BO_ "):
            found = _match(_MESSAGE, line, number, "BO_ <id> <name>: <length> <sender>")
            messages.append((found[2], int(found[1]), int(found[3]), {}))
        elif line.startswith("SG_ "):
            found = _match(_SIGNAL, line, number, 'SG_ <name> : <start>|<length>@<0 or 1><+ or -> (a,b) [c|d] "unit" X')
            if not messages:
                raise FrameSpecError(f"line {number}: signal {found[1]} stands before any message (BO_)")
            messages[-1][3][found[1]] = _signal(found, number)
    if not messages:
        raise FrameSpecError("holds no message (BO_): is it a DBC file?")
    floats = {(int(m[1]), m[2]): int(m[3]) for m in _VALUE_TYPE.finditer(text)}
    return {name: _message(name, can_id, length, signals, floats) for name, can_id, length, signals in messages}


def encode_messages(message: Message, columns: Mapping[str, Raw | int], count: int) -> Payload:
    """Payloads uint8[count, 8] of raw values by signal name, [count] or one number for all; the rest is zero."""
    payload = np.zeros((count, PAYLOAD_BYTES), np.uint8)
    for name, values in columns.items():
        signal = message.signals[name]
        signal.write(payload, np.asarray(values, signal.raw_type.dtype))
    return payload


def _match(pattern: re.Pattern[str], line: str, number: int, form: str) -> re.Match[str]:
    found = pattern.match(line)
    if not found:
        raise FrameSpecError(f"line {number}: '{line[:80]}' is not of the form {form}")
    return found


def _signal(found: re.Match[str], number: int) -> Signal:
    name, start, length = found[1], int(found[3]), int(found[4])
    scale, offset = float(found[7]), float(found[8])
    if not 1 <= length <= 64:
        raise FrameSpecError(f"line {number}: signal {name} has {length} bits; allowed are 1 to 64")
    if scale == 0.0 or not math.isfinite(scale) or not math.isfinite(offset):
        raise FrameSpecError(f"line {number}: signal {name}: factor {scale:g}, offset {offset:g} cannot be used")
    kind = RawType.integer(length, signed=found[6] == "-")
    # '@1' is Intel, '@0' Motorola
    return Signal(
        name,
        start,
        length,
        found[5] == "0",
        kind,
        scale,
        offset,
        found[11],
        multiplexed=bool(found[2] and found[2] != "M"),
    )


def _message(
    name: str, can_id: int, length: int, signals: Mapping[str, Signal], floats: Mapping[tuple[int, str], Any]
) -> Message:
    typed = {}
    for signal in signals.values():
        kind = floats.get((can_id, signal.name), 0)
        if kind and signal.length != 32 * kind:
            raise FrameSpecError(f"{name}.{signal.name}: a float of {signal.length} bits; allowed are 32 and 64")
        typed[signal.name] = replace(signal, raw_type=RawType(np.dtype(f"f{4 * kind}"))) if kind else signal
    return Message(name, can_id, length, MappingProxyType(typed))
