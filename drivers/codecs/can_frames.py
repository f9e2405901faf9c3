"""Received CAN messages of a gyro to batches of frames."""

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.batch import FrameBatch
from drivers.codecs.can_spec import CanSpec
from drivers.codecs.counters import Losses, Sequence
from drivers.codecs.dbc import Payload


class CanDecoder:
    """Received CAN messages to batches of frames; messages of other identifiers are passed over.

    data_rate_hz: frames per second the gyro sends: needed for increments, and to resolve long outages.
    """

    def __init__(self, spec: CanSpec, data_rate_hz: float) -> None:
        self.spec, self.data_rate_hz = spec, data_rate_hz
        self._meaning = spec.meaning(data_rate_hz)
        self._sequence = Sequence(spec.counter_modulo, data_rate_hz=data_rate_hz)
        self._frames = self._skipped_bytes = self._bad_status = 0

    @property
    def losses(self) -> Losses:
        """Everything counted so far. A message shorter than its DBC says is counted in skipped_bytes."""
        return Losses(
            frames=self._frames,
            lost=self._sequence.lost,
            duplicates=self._sequence.duplicates,
            skipped_bytes=self._skipped_bytes,
            bad_status=self._bad_status,
        )

    def reset(self) -> None:
        """What comes next does not follow what came before; what is missing between is not counted as lost."""
        self._sequence.reanchor()

    def feed(
        self, ids: NDArray[np.uint32], payload: Payload, lengths: NDArray[np.uint8], elapsed_s: float | None = None
    ) -> FrameBatch:
        """Decode what came in.

        ids: uint32[n] with bit 31 set for 29-bit ones; payload: uint8[n, 8], contiguous, unused bytes zero; lengths:
        uint8[n]. elapsed_s: time since the last call (or reset), if known: resolves outages longer than the counter.
        """
        payload = self._own(ids, payload, lengths)
        signals = self.spec.signals
        counter = signals["counter"].read(payload) if "counter" in signals else None
        keep, index = self._sequence.admit(payload, counter, elapsed_s)
        if keep is not None:
            payload = payload[keep]
        batch = self._meaning.batch({role: signal.read(payload) for role, signal in signals.items()}, index)
        self._frames += len(batch)
        self._bad_status += len(batch) - int(np.count_nonzero(batch.good))
        return batch

    def _own(self, ids: NDArray[np.uint32], payload: Payload, lengths: NDArray[np.uint8]) -> Payload:
        """Payloads of this gyro's complete messages."""
        mine = ids == np.uint32(self.spec.can_id)
        complete = lengths >= self.spec.message.length
        wanted = mine & complete
        if wanted.all():
            return payload
        self._skipped_bytes += int(lengths[mine & ~complete].sum())
        owned: Payload = payload[wanted]
        return owned
