"""A python-can bus on the virtual bench: interface 'fogsim', channel NAME for the instruments at 'can:NAME'.

`recv` is overridden, because BusABC.recv waits on the wall clock around _recv_internal; here time passes in the simpy
world, and only while somebody waits. Notifier and send_periodic are threads on the wall clock and have no place here.
"""

from collections import deque
from collections.abc import Iterable
from math import inf
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from drivers.codecs.dbc import EXTENDED, PAYLOAD_BYTES
from simulated_hw.wire import switchboard
from simulated_hw.wire.can_dbc import SimulatedCanGyro
from simulated_hw.wire.gyro_physics import SLICE_FRAMES

# Messages made ahead of a reader that takes them one by one.
_QUEUED = 1024
# If rounding puts a message just after the instant it was expected at, look again this much later.
_LOOK_AGAIN_S = 1e-5

Batch = tuple[NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint8]]


class SimulatedCanBus(can.BusABC):
    """Messages of the gyros on one channel, from the moment it is opened."""

    # it buffers without limit by itself: no reader thread is needed
    drains_itself = True

    def __init__(self, channel: str, can_filters: Any = None, **kwargs: object) -> None:
        """Raises can.CanInitializationError if there is no such channel."""
        try:
            instrument = switchboard.find(f"can:{channel}")
        except LookupError as error:
            raise can.CanInitializationError(str(error)) from None
        if not isinstance(instrument, SimulatedCanGyro):
            raise can.CanInitializationError(f"can:{channel} is no CAN instrument")
        self.channel_info = f"can:{channel}"
        self._env = instrument.env
        self._channel = instrument
        self._next: dict[SimulatedCanGyro, int] = {}
        self._queue: deque[can.Message] = deque()
        super().__init__(channel, can_filters, **kwargs)
        self.discard()

    def _apply_filters(self, filters: Any) -> None:
        """Called by BusABC whenever filters are set: only nodes that pass are listened to."""
        del filters
        nodes = [node for node in self._channel.nodes if self._matches_filters(_message(node, bytes(node.length), 0.0))]
        now = self._env.now
        self._next = {node: self._next.get(node, node.frames_until(now)) for node in nodes}

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next message; waits for it in virtual time for at most `timeout` (None: as long as it takes)."""
        deadline = inf if timeout is None else self._env.now + timeout
        while not self._queue:
            self._fill()
            if self._queue or self._env.now >= deadline:
                break
            if not self._next and deadline == inf:
                raise can.CanOperationError(
                    f"{self.channel_info}: nothing passes the filters, this would wait for ever"
                )
            expected = min((node.due_s(number) for node, number in self._next.items()), default=inf)
            self._env.run(until=min(max(expected, self._env.now + _LOOK_AGAIN_S), deadline))
        return self._queue.popleft() if self._queue else None

    def recv_batch(self) -> Batch:
        """Everything sent since the last read: identifiers uint32[n] (bit 31: 29-bit), payloads uint8[n, 8], lengths.

        Does not wait. Messages of several gyros are in the order they were sent.
        """
        now = self._env.now
        parts, times = [_queued(self._queue)], [np.full(len(self._queue), -inf)]
        self._queue.clear()
        for node, begin in self._next.items():
            end = node.frames_until(now)
            for first in range(begin, end, SLICE_FRAMES):
                stop = min(end, first + SLICE_FRAMES)
                payload = node.payload(first, stop)
                ids = np.full(len(payload), node.can_id, np.uint32)
                lengths = np.full(len(payload), node.length, np.uint8)
                parts.append((ids, payload, lengths))
            if len(self._next) > 1:
                times.append(node.sent_s(node.numbers(begin, end).astype(np.float64)))
            self._next[node] = end
        if len(parts) == 2 and not len(parts[0][0]):
            return parts[1]
        batch = _joined(parts)
        if len(self._next) > 1:
            order = np.argsort(np.concatenate(times), kind="stable")
            return batch[0][order], batch[1][order], batch[2][order]
        return batch

    def discard(self) -> None:
        """Everything sent up to now is never made."""
        self._queue.clear()
        now = self._env.now
        for node, first in self._next.items():
            self._next[node] = end = max(first, node.frames_until(now))
            node.discarded(first, end)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Acknowledged by the other nodes, as on a real bus; these gyros take no orders."""

    def _fill(self) -> None:
        """Queue the next messages sent by now, in order."""
        horizon = min([self._env.now, *(node.sent_s(first + _QUEUED) for node, first in self._next.items())])
        messages: list[can.Message] = []
        for node, first in self._next.items():
            stop = max(first, node.frames_until(horizon))
            if stop > first:
                payload = node.payload(first, stop).tobytes()
                rows = (payload[at : at + node.length] for at in range(0, len(payload), PAYLOAD_BYTES))
                numbers = node.numbers(first, stop).tolist()
                messages += (_message(node, row, node.sent_s(n)) for n, row in zip(numbers, rows, strict=True))
                self._next[node] = stop
        self._queue.extend(sorted(messages, key=lambda message: message.timestamp))


def _message(node: SimulatedCanGyro, data: bytes, timestamp_s: float) -> can.Message:
    extended = bool(node.can_id & EXTENDED)
    number = node.can_id & ~EXTENDED
    return can.Message(timestamp_s, number, is_extended_id=extended, data=data[: node.length], channel=None)


def _queued(queue: Iterable[can.Message]) -> Batch:
    ids = [message.arbitration_id | (EXTENDED if message.is_extended_id else 0) for message in queue]
    payload = b"".join(bytes(message.data).ljust(PAYLOAD_BYTES, b"\0") for message in queue)
    lengths = [message.dlc for message in queue]
    rows = np.frombuffer(bytearray(payload), np.uint8).reshape(-1, PAYLOAD_BYTES)
    return np.array(ids, np.uint32), rows, np.array(lengths, np.uint8)


def _joined(batches: list[Batch]) -> Batch:
    ids, payloads, lengths = zip(*batches, strict=True)
    return np.concatenate(ids), np.concatenate(payloads), np.concatenate(lengths)
