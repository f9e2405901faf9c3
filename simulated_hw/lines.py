"""What carries bytes and messages between the simulated ports of a world and the ends that clients connect to."""

from typing import Protocol

import can
import serial

from drivers.codecs.dbc import EXTENDED
from simulated_hw.endpoints import End
from simulated_hw.wire import switchboard
from simulated_hw.wire.can_bus import SimulatedCanBus


class Near(Protocol):
    """The world's side of a serial line."""

    def give(self, data: bytes) -> None: ...
    def take(self) -> bytes: ...
    def discard(self) -> None: ...
    def close(self) -> None: ...


class Port:
    """A simulated serial port as the world's side of a line."""

    def __init__(self, address: str) -> None:
        baud = int(getattr(switchboard.find(address), "baud", 9600))
        self._port = serial.serial_for_url(address, baudrate=baud, timeout=0)

    def give(self, data: bytes) -> None:
        self._port.write(data)

    def take(self) -> bytes:
        return self._port.read(self._port.in_waiting)

    def discard(self) -> None:
        self._port.reset_input_buffer()

    def close(self) -> None:
        self._port.close()


class Line:
    """Carries bytes between an end and the world."""

    def __init__(self, end: End, near: Near) -> None:
        self.end, self._near = end, near

    @property
    def lost(self) -> str | None:
        """What a client was too slow for, in words."""
        return f"{self.end.lost} bytes" if self.end.lost else None

    def pump(self) -> None:
        """Carry what has come up since the last call, both ways."""
        data = self.end.receive()
        if data is None:
            self._near.discard()
            return
        if data:
            self._near.give(data)
        if reply := self._near.take():
            self.end.send(reply)

    def close(self) -> None:
        """Take the end away."""
        self.end.unplug()
        self._near.close()


class Bus:
    """Carries messages of one simulated channel to a python-can bus."""

    def __init__(self, near: SimulatedCanBus, far: can.BusABC) -> None:
        self._near, self._far = near, far
        self._lost = 0

    @property
    def lost(self) -> str | None:
        """What the far bus did not take, in words."""
        return f"{self._lost} messages" if self._lost else None

    def pump(self) -> None:
        """Carry what was sent since the last call."""
        for number, payload, length in zip(*self._near.recv_batch(), strict=True):
            message = can.Message(
                arbitration_id=int(number) & ~EXTENDED,
                is_extended_id=bool(int(number) & EXTENDED),
                data=payload[:length].tobytes(),
            )
            try:
                self._far.send(message)
            except can.CanError:
                self._lost += 1

    def close(self) -> None:
        """Leave both buses."""
        self._far.shutdown()
        self._near.shutdown()
