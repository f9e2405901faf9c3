"""A simulated CAN adapter on a serial line: the Lawicel (slcan) text protocol, as spoken by CANUSB, CANable and others.

Source: Lawicel CANUSB manual, version 1.0D, and the client in python-can (`can.interfaces.slcan`). Every command ends
with CR; it is answered with CR, with data and CR, or with BEL if it is refused. The channel delivers messages from Open
to Close, whoever is at the serial end, and only at the bit rate of its bus.
"""

import re
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.dbc import EXTENDED

_OK, _REFUSED = b"\r", b"\a"
# Setup codes S0 to S8; S9 is python-can's.
_BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000, 83_300)
_LONGEST_COMMAND = 32
_FRAME = re.compile("(?:t[0-9A-Fa-f]{3}|T[0-9A-Fa-f]{8})([0-8])([0-9A-Fa-f]*)")


class BatchBus(Protocol):
    """The bus that the adapter sits on."""

    def recv_batch(self) -> tuple[NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint8]]: ...
    def discard(self) -> None: ...
    def shutdown(self) -> None: ...


def encode_messages(ids: NDArray[np.uint32], payload: NDArray[np.uint8], lengths: NDArray[np.uint8]) -> bytes:
    """Messages as text: identifiers uint32[n] (bit 31: 29-bit), payload uint8[n, 8], lengths uint8[n].

    >>> encode_messages(np.array([0x1A0], np.uint32), np.arange(8, dtype=np.uint8)[None], np.array([2], np.uint8))
    b't1A020001\\r'
    """
    digits = payload.tobytes().hex().upper()
    lines = []
    for row, (number, length) in enumerate(zip(ids.tolist(), lengths.tolist(), strict=True)):
        head = f"T{number & ~EXTENDED:08X}" if number & EXTENDED else f"t{number:03X}"
        lines.append(f"{head}{length}{digits[16 * row : 16 * row + 2 * length]}\r")
    return "".join(lines).encode("ascii")


class SlcanAdapter:
    """The adapter between a serial client and a simulated bus of `bitrate` bit/s."""

    def __init__(self, bus: BatchBus, bitrate: int) -> None:
        self._bus, self._bus_bitrate = bus, bitrate
        self._bitrate: int | None = None
        self._open = False
        self._typed = b""
        self._replies = b""

    def give(self, data: bytes) -> None:
        """Take bytes of the client and carry out every whole command."""
        *commands, self._typed = (self._typed + data.replace(b"\n", b"")).split(b"\r")
        # What has no end is no command; the adapter's own buffer is no longer than this either.
        self._typed = self._typed[-_LONGEST_COMMAND:]
        self._replies += b"".join(self._answer(command.decode("ascii", "replace")) for command in commands)

    def take(self) -> bytes:
        """Replies, and everything the bus has carried since the last call if the channel is open."""
        replies, self._replies = self._replies, b""
        if not self._open or self._bitrate != self._bus_bitrate:
            self._bus.discard()
            return replies
        return replies + encode_messages(*self._bus.recv_batch())

    def discard(self) -> None:
        """Nobody is at the serial end: what would go there is lost. The channel stays as it is."""
        self._replies = b""
        self._bus.discard()

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def _answer(self, command: str) -> bytes:
        match command[:1]:
            case "":
                return _OK
            case "V":
                return b"V1010\r"
            case "N":
                return b"NFSIM\r"
            case "F" if self._open:
                return b"F00\r"
            case "S" if not self._open and command[1:].isdigit() and len(command) == 2:
                self._bitrate = _BITRATES[int(command[1])]
                return _OK
            case "O" | "L" if not self._open and self._bitrate and len(command) == 1:
                self._open = True
                self._bus.discard()
                return _OK
            case "C" if self._open and len(command) == 1:
                self._open = False
                return _OK
            case "t" | "T" if self._open:
                return self._sent(command)
        return _REFUSED

    def _sent(self, command: str) -> bytes:
        """A frame of the client is acknowledged by the bus; these gyros take no orders."""
        found = _FRAME.fullmatch(command)
        if not found or len(found[2]) != 2 * int(found[1]):
            return _REFUSED
        return (b"z" if command[0] == "t" else b"Z") + _OK
