"""CAN buses: opening one and draining it. No clock of its own.

Identifiers in arrays carry bit 31 for the 29-bit kind, as in SocketCAN and DBC files.
"""

import struct
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import PortError
from drivers.ports import PORT_FAILURES

if TYPE_CHECKING:
    import can

# 64 MiB in records of 16 bytes: over an hour of 1000 messages a second that nobody takes.
BUFFER_BYTES = 64 << 20

_EXTENDED = 1 << 31
_LONGEST_STANDARD_ID = 0x7FF
_RECORD = struct.Struct("<IB3x8s")
_RECORD_TYPE = np.dtype(
    {"names": ["id", "length", "payload"], "formats": ["<u4", "u1", ("u1", 8)], "offsets": [0, 4, 8], "itemsize": 16}
)
# How long the reader waits for a message before it looks whether it should stop.
_WAIT_S = 0.1

Messages = tuple[NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint8], float]


class CanSource(Protocol):
    """Every message a bus has delivered, as it comes."""

    @property
    def name(self) -> str:
        """Bus it comes from."""
        ...

    def take(self) -> Messages:
        """Identifiers uint32[n], payloads uint8[n, 8], lengths uint8[n] since the last call, and the time of this one.

        Raises PortError when the bus is gone.
        """
        ...

    def discard(self) -> None:
        """Throw away everything received so far."""
        ...

    def close(self) -> None:
        """Let go of the bus."""
        ...


class BatchBus(Protocol):
    """A bus that hands over what it received in arrays (interface fogsim does)."""

    channel_info: str

    def recv_batch(self) -> tuple[NDArray[np.uint32], NDArray[np.uint8], NDArray[np.uint8]]: ...
    def discard(self) -> None: ...
    def shutdown(self) -> None: ...


def open_can(interface: str, channel: str, bitrate: int | None, can_id: int | None = None) -> "can.BusABC":
    """Open a python-can bus that lets one identifier through (None: all).

    can_id above 7FF is a 29-bit one. Raises PortError saying which bus, why, and what to check.
    """
    import can

    filters: list[Any] | None = None
    if can_id is not None:
        number = can_id & ~_EXTENDED
        filters = [{"can_id": number, "can_mask": 0x1FFFFFFF, "extended": can_id > _LONGEST_STANDARD_ID}]
    options: dict[str, Any] = {} if bitrate is None else {"bitrate": bitrate}
    try:
        return can.Bus(channel, interface, can_filters=filters, ignore_config=True, **options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
        raise PortError(f"{interface}:{channel}", f"does not open: {error}. {_way_out(interface, channel)}") from error


def _way_out(interface: str, channel: str) -> str:
    import can

    if interface not in can.VALID_INTERFACES:
        return f"Interfaces known here: {', '.join(sorted(can.VALID_INTERFACES))}"
    if interface == "socketcan":
        return f"Is the adapter plugged in? 'ip link set {channel} up type can bitrate ...' brings it up"
    if interface == "fogsim":
        return "fogsim buses exist while a virtual bench is open; check the channel in the bench file"
    return "Check adapter, its driver, channel and bitrate, and that no other program holds it"


def _failures() -> tuple[type[Exception], ...]:
    """What a bus that went away raises."""
    import can

    return (can.CanError, ValueError, TypeError, *PORT_FAILURES)


class BatchCanSource:
    """For a bus that buffers without limit by itself and hands over whole batches."""

    def __init__(self, bus: BatchBus, now: Callable[[], float]) -> None:
        self._bus, self._now = bus, now

    @property
    def name(self) -> str:
        """Bus it comes from."""
        return self._bus.channel_info

    def take(self) -> Messages:
        """Everything since the last call, as in `CanSource.take`."""
        return *self._bus.recv_batch(), self._now()

    def discard(self) -> None:
        """Throw away everything received so far."""
        self._bus.discard()

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


class ThreadedCanSource:
    """For a real bus: a daemon thread drains it, whatever the main thread is doing.

    The buffer holds `limit_bytes` in records of 16; when it overflows, everything is dropped and `take` raises
    PortError until `discard` starts afresh. Error frames and remote frames carry no data and are passed over.
    """

    def __init__(self, bus: "can.BusABC", now: Callable[[], float], limit_bytes: int = BUFFER_BYTES) -> None:
        self._bus, self._now, self._limit = bus, now, limit_bytes
        self._lock = threading.Lock()
        self._records = bytearray()
        self._overflowed = self._closing = False
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._drain, name=f"reader of {bus.channel_info}", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """Bus it comes from."""
        return str(self._bus.channel_info)

    def take(self) -> Messages:
        """Everything since the last call, as in `CanSource.take`. Raises PortError."""
        with self._lock:
            if self._failure is not None:
                why = (
                    f"went away while reading: {self._failure}. Check adapter, termination and power, then start again"
                )
                raise PortError(self.name, why) from self._failure
            if self._overflowed:
                why = f"more than {self._limit // _RECORD.size} messages came in and nobody took them. Take more often"
                raise PortError(self.name, why)
            records, stamp = self._records, self._now()
            self._records = bytearray()
        fields = np.frombuffer(records, _RECORD_TYPE)
        return fields["id"].copy(), fields["payload"].copy(), fields["length"].copy(), stamp

    def discard(self) -> None:
        """Throw away everything received so far."""
        with self._lock:
            self._records = bytearray()
            self._overflowed = False

    def close(self) -> None:
        """Stop the reader and close the bus. Raises PortError for an adapter that is gone."""
        self._closing = True
        self._thread.join()
        try:
            self._bus.shutdown()
        except _failures() as error:
            # slcan says goodbye before it closes; a port kept open would come back under another name.
            if port := getattr(self._bus, "serialPortOrig", None):
                port.close()
            raise PortError(self.name, f"did not close: {error}. Check adapter and power") from error

    def _drain(self) -> None:
        try:
            while not self._closing:
                message = self._bus.recv(_WAIT_S)
                if message is not None and not message.is_error_frame and not message.is_remote_frame:
                    self._hold(message)
        except _failures() as error:
            self._failure = error

    def _hold(self, message: "can.Message") -> None:
        number = message.arbitration_id | (_EXTENDED if message.is_extended_id else 0)
        record = _RECORD.pack(number, min(message.dlc, 8), bytes(message.data[:8]))
        with self._lock:
            if len(self._records) + len(record) > self._limit:
                self._records = bytearray()
                self._overflowed = True
            if not self._overflowed:
                self._records += record


def open_can_source(bus: Any, now: Callable[[], float]) -> CanSource:
    """The right source for a bus: in batches where it has `recv_batch`, else with a reader thread."""
    return BatchCanSource(bus, now) if hasattr(bus, "recv_batch") else ThreadedCanSource(bus, now)
