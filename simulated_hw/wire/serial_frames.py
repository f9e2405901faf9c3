"""A gyro that sends declared frames over a serial line: the far end of `drivers.gyros.serial_frames`."""

from collections.abc import Mapping
from typing import Any

import simpy

from drivers.codecs.batch import Raw
from drivers.codecs.counters import counter_values
from drivers.codecs.frame_spec import FrameSpec
from drivers.codecs.frames import encode
from simulated_hw.faults.frames import StreamFaults
from simulated_hw.wire.gyro_physics import SLICE_FRAMES, GyroPhysics, channels_of

_BAUD = 921_600


class SimulatedSerialGyro:
    """Frames of a gyro as bytes. Fields that no physics stands behind (other axes, accelerometers) are zero."""

    def __init__(self, env: simpy.Environment, gyro: GyroPhysics, settings: Mapping[str, Any]) -> None:
        """settings: those of the driver (frame, baud, data_rate_hz). Raises FrameSpecError."""
        self.env = env
        self.baud = int(settings.get("baud", _BAUD))
        self._gyro = gyro
        self._spec = FrameSpec.load(settings.get("frame", "kvh_36"))
        self._meaning = self._spec.meaning(float(settings.get("data_rate_hz", gyro.data_rate_hz)))
        self._kinds = {role: field.raw_type for role, field in self._spec.columns.items()}
        self._next = 0
        # What happens to the frames on their way; None on a healthy bench.
        self.faults: StreamFaults | None = None

    def bytes_until(self, now_s: float) -> bytes:
        """All frames sent since the last call, up to `now_s`."""
        end = self._arrived_until(now_s)
        parts = []
        while self._next < end:
            stop = min(end, self._next + SLICE_FRAMES)
            parts.append(self._encoded(self._next, stop))
            self._next = stop
        return b"".join(parts)

    def skip_until(self, now_s: float) -> None:
        """Everything sent up to `now_s` is never made."""
        end = max(self._next, self._arrived_until(now_s))
        if self.faults:
            self.faults.discarded(self._next, end, now_s)
        self._next = end

    def _arrived_until(self, now_s: float) -> int:
        return self.faults.arrived_until(now_s) if self.faults else self._gyro.frames_until(now_s)

    def _encoded(self, first: int, end: int) -> bytes:
        block = self._gyro.block(first, end)
        values = block.rate_dps, block.temperature_degc, block.good
        raw = self._meaning.raw_columns(*values, self._kinds, channels_of(block))
        columns: dict[str, Raw | int | float] = {self._spec.columns[role].name: raw[role] for role in raw}
        if counter := self._spec.counter:
            if self.faults:
                counts = self.faults.counters(first, end, counter.modulo, counter.step)
            else:
                counts = counter_values(first, end - first, counter.modulo, counter.step)
            columns[counter.field.name] = counts.astype(counter.field.raw_type.dtype, copy=False)
        rows = encode(self._spec, columns, end - first)
        return self.faults.sent_bytes(first, rows, self._spec) if self.faults else rows.tobytes()
