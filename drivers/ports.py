"""Serial ports: opening one, asking it a question, and draining one that talks unasked. No clock of its own.

Opening happens by pyserial URL, so '/dev/ttyUSB0', 'COM3', 'socket://host:port' and 'sim://name' are all ports.
"""

import errno
import threading
from collections.abc import Callable
from typing import Protocol

import serial

from drivers.errors import PortError

_terminal_error: type[Exception]
try:
    import termios

    _terminal_error = termios.error
except ImportError:  # Windows has none
    _terminal_error = OSError

# What a port that went away raises; pyserial lets termios.error, which is no OSError, through.
PORT_FAILURES: tuple[type[Exception], ...] = (OSError, _terminal_error)
_OPEN_FAILURES: tuple[type[Exception], ...] = (*PORT_FAILURES, ValueError)
# pyserial raises TypeError when a port is closed under a blocked read.
_READ_FAILURES: tuple[type[Exception], ...] = (*PORT_FAILURES, TypeError)

# 64 MiB: half an hour of the fastest stream (36 bytes at 1 kHz) that nobody takes.
BUFFER_BYTES = 64 << 20
# What a reader takes at once from a port that does not say how much is waiting.
_BLOCK_BYTES = 4096
# How long the reader thread waits at a silent port before it looks whether it is to stop.
_READER_WAIT_S = 0.2


class SerialPort(Protocol):
    """The part of pyserial's port that drivers use; `timeout` and `baudrate` can be set."""

    name: str | None
    is_open: bool

    @property
    def timeout(self) -> float | None: ...
    @timeout.setter
    def timeout(self, timeout: float | None) -> None: ...
    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def write(self, b: bytes, /) -> int | None: ...
    def reset_input_buffer(self) -> None: ...
    def close(self) -> None: ...


class ByteSource(Protocol):
    """Everything a talking instrument has sent, as it comes."""

    @property
    def name(self) -> str:
        """Port it comes from."""
        ...

    def take(self) -> tuple[bytes, float]:
        """All bytes since the last call, and the time of this call. Raises PortError when the port is gone."""
        ...

    def discard(self) -> None:
        """Throw away everything received so far."""
        ...

    def close(self) -> None:
        """Let go of the port."""
        ...


def open_serial(url: str, baud: int, timeout_s: float) -> SerialPort:
    """Open a port for this process alone (8N1). Raises PortError saying which port, why, and what to check."""
    try:
        return serial.serial_for_url(url, baudrate=baud, timeout=timeout_s, exclusive=True)
    except _OPEN_FAILURES as error:
        raise PortError(url, f"does not open: {error}. {_way_out(url, error)}") from error


def _way_out(url: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if url.lower().startswith("sim://"):
        return "sim:// ports exist while a virtual bench is open; check the name in the bench file"
    if code == errno.ENOENT or isinstance(error, FileNotFoundError):
        return "Is the adapter plugged in? 'python -m serial.tools.list_ports' lists what this machine has"
    if code in (errno.EACCES, errno.EPERM):
        return "This user may not use it; on Linux add the user to the port's group (often 'dialout') and log in again"
    if code in (errno.EBUSY, errno.EAGAIN):
        return "Another program holds it; close that program"
    return "Check the address in the bench file, the cable and that no other program holds the port"


def failed(port: SerialPort, error: Exception) -> PortError:
    """The error for an open port that raised one of PORT_FAILURES."""
    return PortError(port.name or "?", f"failed while in use: {error}. Check cable, adapter and power")


class DirectSerialSource:
    """For a port that buffers without limit by itself (sim://): takes what is waiting there."""

    def __init__(self, port: SerialPort, now: Callable[[], float]) -> None:
        self._port, self._now = port, now

    @property
    def name(self) -> str:
        """Port it comes from."""
        return self._port.name or "?"

    def take(self) -> tuple[bytes, float]:
        """All bytes since the last call, and the time of this call in seconds. Raises PortError."""
        try:
            data = self._port.read(waiting) if (waiting := self._port.in_waiting) else b""
        except PORT_FAILURES as error:
            raise failed(self._port, error) from error
        return data, self._now()

    def discard(self) -> None:
        """Throw away everything received so far. Raises PortError."""
        try:
            self._port.reset_input_buffer()
        except PORT_FAILURES as error:
            raise failed(self._port, error) from error

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class ThreadedSerialSource:
    """For a real port: a daemon thread drains it, whatever the main thread is doing.

    A Linux tty holds 4 kB, 44 ms at 921 600 baud; the buffer here holds `limit_bytes`. When it overflows, everything is
    dropped and `take` raises PortError until `discard` starts afresh.
    """

    def __init__(self, port: SerialPort, now: Callable[[], float], limit_bytes: int = BUFFER_BYTES) -> None:
        self._port, self._now, self._limit = port, now, limit_bytes
        self._lock = threading.Lock()
        self._held = bytearray()
        self._overflowed = self._closing = False
        self._failure: Exception | None = None
        port.timeout = _READER_WAIT_S
        self._thread = threading.Thread(target=self._drain, name=f"reader of {port.name}", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """Port it comes from."""
        return self._port.name or "?"

    def take(self) -> tuple[bytes, float]:
        """All bytes since the last call, and the time of this call in seconds. Raises PortError."""
        with self._lock:
            if self._failure is not None:
                why = f"went away while reading: {self._failure}. Check cable, adapter and power, then start again"
                raise PortError(self.name, why) from self._failure
            if self._overflowed:
                why = f"more than {self._limit} bytes came in and nobody took them. Take or discard more often"
                raise PortError(self.name, why)
            held, self._held, stamp = self._held, bytearray(), self._now()
        return bytes(held), stamp

    def discard(self) -> None:
        """Throw away everything received so far."""
        with self._lock:
            self._held.clear()
            self._overflowed = False

    def close(self) -> None:
        """Stop the reader and close the port."""
        self._closing = True
        if cancel := getattr(self._port, "cancel_read", None):
            cancel()
        self._thread.join(5 * _READER_WAIT_S)
        self._port.close()

    def _drain(self) -> None:
        try:
            while not self._closing:
                self._hold(self._read())
        except _READ_FAILURES as error:
            self._failure = error

    def _read(self) -> bytes:
        """What is there; waits for the first byte of it."""
        if not self.name.startswith("socket://"):
            return self._port.read(self._port.in_waiting or 1)
        # There pyserial's in_waiting is 0 or 1, whatever came in: byte by byte no reader keeps up with a 1 kHz stream.
        first = self._port.read(1)
        self._port.timeout = 0
        try:
            return first + (self._port.read(_BLOCK_BYTES) if first else b"")
        finally:
            self._port.timeout = _READER_WAIT_S

    def _hold(self, data: bytes) -> None:
        with self._lock:
            if len(self._held) + len(data) > self._limit:
                self._held.clear()
                self._overflowed = True
            elif not self._overflowed:
                self._held += data


def open_byte_source(port: SerialPort, now: Callable[[], float]) -> ByteSource:
    """The right source for a port: direct where the port drains itself (sim://), else with a reader thread."""
    return DirectSerialSource(port, now) if getattr(port, "drains_itself", False) else ThreadedSerialSource(port, now)
