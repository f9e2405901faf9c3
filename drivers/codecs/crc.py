"""Checksums of single messages and of whole batches of frames.

A CRC is linear over XOR: the CRC of a row is the CRC of any other row of the same length, XOR one table look-up for
each 16-bit word in which the two differ. So a batch costs one pass per word *that varies*, never a loop over its bytes;
header, reserved fields and slow quantities cost one scalar CRC for the whole batch. Sums are handled the same way.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Bytes2D = NDArray[np.uint8]
Words = NDArray[np.uint32]


class Checksum(Protocol):
    """A checksum: `size` bytes on the wire, of one message or of every row of a batch."""

    @property
    def size(self) -> int:
        """Bytes it takes on the wire; 0 = no checksum."""
        ...

    def of(self, data: bytes) -> int:
        """Checksum of one message."""
        ...

    def of_rows(self, rows: Bytes2D, varying: Iterable[int] | None = None, padding: int = 0) -> Words:
        """Checksum of every row.

        rows: uint8[n, m], contiguous along m. varying: the columns that are not the same in all rows (None: look).
        padding: zero bytes appended to each row for the computation (STIM300 pads to a multiple of four).
        Returns uint32[n].
        """
        ...


@dataclass(frozen=True)
class Crc:
    """A CRC in the Rocksoft parameters; the polynomial without its top bit, `reflected` for both ends."""

    width: int
    polynomial: int
    start: int = 0
    reflected: bool = False
    final_xor: int = 0

    def __post_init__(self) -> None:
        if self.width not in (8, 16, 24, 32):
            raise ValueError(f"CRC width {self.width}: allowed are 8, 16, 24 and 32 bits")
        for name in ("polynomial", "start", "final_xor"):
            value = getattr(self, name)
            if not 0 <= value < 1 << self.width:
                raise ValueError(f"CRC {name} {value:#x} does not fit in {self.width} bits")

    @property
    def size(self) -> int:
        """Bytes it takes on the wire."""
        return self.width // 8

    def of(self, data: bytes) -> int:
        """CRC of one message.

        >>> hex(CRCS["crc32-mpeg2"].of(b"123456789"))
        '0x376e6e7'
        """
        table = _step_table(self)
        crc = _reflect(self.start, self.width) if self.reflected else self.start
        if self.reflected:
            for byte in data:
                crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
        else:
            top, mask = self.width - 8, (1 << self.width) - 1
            for byte in data:
                crc = crc << 8 & mask ^ table[crc >> top ^ byte]
        return crc ^ self.final_xor

    def of_rows(self, rows: Bytes2D, varying: Iterable[int] | None = None, padding: int = 0) -> Words:
        """CRC of every row of uint8[n, m], as uint32[n]; see `Checksum.of_rows`."""
        count, length = rows.shape
        if count == 0:
            return np.empty(0, np.uint32)
        first = rows[0].tobytes()
        constant = self.of(first + bytes(padding))
        total: Words | None = None
        columns = varying_columns(rows) if varying is None else varying
        for at in sorted({column & ~1 for column in columns}):
            distance = length + padding - 1 - at
            if at + 1 < length:
                table, words = _word_table(self, distance), _column(rows, at, "<u2")
                constant ^= int(table[first[at] | first[at + 1] << 8])
            else:
                table, words = _byte_table(self, distance), rows[:, at]
                constant ^= int(table[first[at]])
            part = table.take(words)
            total = part if total is None else np.bitwise_xor(total, part, out=total)
        if total is None:
            return np.full(count, constant, np.uint32)
        return np.bitwise_xor(total, np.uint32(constant), out=total)


@dataclass(frozen=True)
class Sum:
    """Sum of the unsigned words of a message (`word` bytes each, little-endian), modulo `modulo`."""

    size: int
    modulo: int
    word: int = 1

    def of(self, data: bytes) -> int:
        """Sum of one message; an incomplete last word counts as if padded with zero."""
        words = (data[at : at + self.word] for at in range(0, len(data), self.word))
        return sum(int.from_bytes(word, "little") for word in words) % self.modulo

    def of_rows(self, rows: Bytes2D, varying: Iterable[int] | None = None, padding: int = 0) -> Words:
        """Sum of every row of uint8[n, m], as uint32[n]; see `Checksum.of_rows`. Padding adds nothing."""
        columns = sorted(set(varying_columns(rows) if varying is None else varying))
        constant = rows[:1].copy()
        constant[:, columns] = 0
        total = np.full(len(rows), self.of(constant.tobytes()), np.uint32)
        for at in columns:
            np.add(total, np.multiply(rows[:, at], 256 ** (at % self.word), dtype=np.uint32), out=total)
        return np.remainder(total, np.uint32(self.modulo), out=total)


@dataclass(frozen=True)
class Xor:
    """XOR of all bytes of a message."""

    size: int = 1

    def of(self, data: bytes) -> int:
        """XOR of one message."""
        total = 0
        for byte in data:
            total ^= byte
        return total

    def of_rows(self, rows: Bytes2D, varying: Iterable[int] | None = None, padding: int = 0) -> Words:
        """XOR of every row of uint8[n, m], as uint32[n]; see `Checksum.of_rows`. Padding changes nothing."""
        columns = sorted(set(varying_columns(rows) if varying is None else varying))
        constant = rows[:1].copy()
        constant[:, columns] = 0
        total = np.full(len(rows), self.of(constant.tobytes()), np.uint8)
        for at in columns:
            np.bitwise_xor(total, rows[:, at], out=total)
        return total.astype(np.uint32)


@dataclass(frozen=True)
class NoChecksum:
    """The frame has none: every candidate passes."""

    size: int = 0

    def of(self, data: bytes) -> int:
        """Always 0."""
        return 0

    def of_rows(self, rows: Bytes2D, varying: Iterable[int] | None = None, padding: int = 0) -> Words:
        """Zeros, uint32[n]."""
        return np.zeros(len(rows), np.uint32)


CRCS: Mapping[str, Crc] = MappingProxyType(
    {
        # KVH 36-byte frame and STIM300; check value of "123456789" 0376E6E7.
        "crc32-mpeg2": Crc(32, 0x04C11DB7, 0xFFFFFFFF),
        # Modbus over serial line 1.02, 6.2.2; check value 4B37; goes out low byte first.
        "crc16-modbus": Crc(16, 0x8005, 0xFFFF, reflected=True),
        # What most instrument manuals mean by "CCITT" (catalogue name CRC-16/IBM-3740); check value 29B1.
        "crc16-ccitt": Crc(16, 0x1021, 0xFFFF),
        # CRC-8/SMBUS, check value F4.
        "crc8": Crc(8, 0x07),
        # STIM210 data frames and STIM300 utility mode; check value FB.
        "crc8-ff": Crc(8, 0x07, 0xFF),
    }
)
CHECKSUMS: Mapping[str, Checksum] = MappingProxyType(
    {
        **CRCS,
        "sum8": Sum(1, 1 << 8),
        "sum16": Sum(2, 1 << 16),
        # Honeywell HG4930: sum of the preceding little-endian 16-bit words.
        "sum16-words": Sum(2, 1 << 16, word=2),
        # Fg333 and other FOGs of the "EB 90" family: modulo 255, not 256.
        "sum-mod-255": Sum(1, 255),
        "xor8": Xor(),
        "none": NoChecksum(),
    }
)


def varying_columns(rows: Bytes2D) -> list[int]:
    """Columns of uint8[n, m] that do not hold the same value in every row."""
    count = len(rows)
    if count < 2:
        return []
    difference = rows[1:] ^ rows[:-1]
    # Folding in halves keeps every operation on long contiguous memory; a reduction along axis 0 costs a call per row.
    while (count := len(difference)) > 8:
        half = count // 2
        np.bitwise_or(difference[:half], difference[count - half :], out=difference[:half])
        difference = difference[: count - half]
    return [int(column) for column in np.flatnonzero(np.bitwise_or.reduce(difference, axis=0))]


def _column(rows: Bytes2D, at: int, kind: str) -> NDArray[Any]:
    return rows[:, at : at + np.dtype(kind).itemsize].view(kind)[:, 0]


def _reflect(value: int, width: int) -> int:
    return int(f"{value:0{width}b}"[::-1], 2)


@lru_cache(maxsize=64)
def _step_table(crc: Crc) -> tuple[int, ...]:
    """The classical 256 entries: what one byte does to a zero register."""
    top, mask = 1 << crc.width - 1, (1 << crc.width) - 1
    polynomial = _reflect(crc.polynomial, crc.width)
    entries = []
    for byte in range(256):
        register = byte if crc.reflected else byte << crc.width - 8
        for _ in range(8):
            if crc.reflected:
                register = register >> 1 ^ (polynomial if register & 1 else 0)
            else:
                register = (register << 1 ^ (crc.polynomial if register & top else 0)) & mask
        entries.append(register)
    return tuple(entries)


@lru_cache(maxsize=4096)
def _byte_table(crc: Crc, distance: int) -> Words:
    """uint32[256]: what a byte does to a zero register when `distance` further (zero) bytes follow it."""
    step = np.array(_step_table(crc), np.uint32)
    if distance == 0:
        return step
    register = _byte_table(crc, distance - 1)
    if crc.reflected:
        shifted, leaving = register >> np.uint32(8), register & np.uint32(0xFF)
    else:
        shifted = register << np.uint32(8) & np.uint32((1 << crc.width) - 1)
        leaving = register >> np.uint32(crc.width - 8)
    table: Words = np.bitwise_xor(shifted, step[leaving])
    return table


@lru_cache(maxsize=256)
def _word_table(crc: Crc, distance: int) -> Words:
    """uint32[65536]: the same for two neighbouring bytes, the first (low half of the index) `distance` from the end."""
    first, second = _byte_table(crc, distance), _byte_table(crc, distance - 1)
    return (second[:, None] ^ first[None, :]).ravel()
