"""A gyro that sends one CAN message of a DBC file: the far end of `drivers.gyros.can_dbc`."""

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
import simpy
from numpy.typing import NDArray

from drivers.codecs.can_spec import CanSpec
from drivers.codecs.counters import counter_values
from drivers.codecs.dbc import EXTENDED
from simulated_hw.faults.frames import StreamFaults
from simulated_hw.wire.gyro_physics import GyroPhysics, channels_of

Times = TypeVar("Times", float, NDArray[np.float64])

# A time by which any gyro has sent so many messages that its own clock can be read from their number.
_LONG_S = 1e9


class SimulatedCanGyro:
    """Frames of a gyro as CAN payloads; a bus (`simulated_hw.wire.can_bus`) reads them, any number of buses may.

    can_id: identifier of its messages, bit 31 set for a 29-bit one; length: their bytes.
    nodes: the gyros on its channel, itself first; `join` adds another.
    """

    def __init__(self, env: simpy.Environment, gyro: GyroPhysics, settings: Mapping[str, Any]) -> None:
        """settings: those of the driver (dbc, message, can_id, signal names, data_rate_hz). Raises FrameSpecError."""
        self.env = env
        self._gyro = gyro
        self._spec = CanSpec.from_settings(settings)
        self._meaning = self._spec.meaning(float(settings.get("data_rate_hz", gyro.data_rate_hz)))
        self._message_s = _LONG_S / gyro.frames_until(_LONG_S)
        self.can_id = self._spec.can_id
        self.length = self._spec.message.length
        self.nodes: tuple[SimulatedCanGyro, ...] = (self,)
        # What happens to the frames on their way; None on a healthy bench.
        self.faults: StreamFaults | None = None

    def join(self, other: "SimulatedCanGyro") -> None:
        """Put another gyro on the same channel. Raises ValueError if its identifier is taken there."""
        for node in self.nodes:
            if node.can_id == other.can_id:
                number = other.can_id & ~EXTENDED
                raise ValueError(f"two gyros send id {number:X} on one channel; give each its own (setting can_id)")
        self.nodes += (other,)

    def frames_until(self, now_s: float) -> int:
        """How many messages have been sent by then, and have arrived."""
        return self.faults.arrived_until(now_s) if self.faults else self._gyro.frames_until(now_s)

    def sent_s(self, numbers: Times) -> Times:
        """When messages of these numbers are sent, in seconds; right to a few microseconds."""
        return (numbers + 1) * self._message_s

    def due_s(self, number: int) -> float:
        """When a message reaches the bus."""
        return self.faults.due_s(number, self.env.now) if self.faults else self.sent_s(number)

    def numbers(self, first: int, end: int) -> NDArray[np.int64]:
        """The numbers of the messages that `payload` returns: all of them, if none is lost or doubled."""
        return self.faults.numbers(first, end) if self.faults else np.arange(first, end)

    def discarded(self, first: int, end: int) -> None:
        """Messages first ... end - 1 are thrown away unread, and never made."""
        if self.faults:
            self.faults.discarded(first, end, self.env.now)

    def payload(self, first: int, end: int) -> NDArray[np.uint8]:
        """What arrives of messages first ... end - 1, uint8[n, 8], unused bytes zero."""
        block = self._gyro.block(first, end)
        values = block.rate_dps, block.temperature_degc, block.good
        raw = self._meaning.raw_columns(*values, self._spec.raw_types, channels_of(block))
        if self._spec.counter_modulo:
            if self.faults:
                raw["counter"] = self.faults.counters(first, end, self._spec.counter_modulo)
            else:
                raw["counter"] = counter_values(first, end - first, self._spec.counter_modulo)
        rows = self._spec.encode(raw, end - first)
        return self.faults.messages(first, rows) if self.faults else rows
