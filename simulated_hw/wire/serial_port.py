"""A serial port whose far end is a simulated instrument and whose time-outs pass in virtual time.

It stands where a pyserial port stands, so the drivers above it are the ones used on real hardware (law: simulated
hardware is swapped in below the drivers). The world moves only while somebody waits here: a read whose bytes are all
there does not move it; any other read runs the simpy environment until they are, or until the time-out.
Bytes sent at another line speed or format than the instrument's arrive garbled, in both directions.
"""

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Any, Protocol

import serial
import simpy

from simulated_hw.wire import switchboard

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

# Which wrong bytes a wrong line speed yields depends on the UART; the complement is never a valid message by chance.
_GARBLED = bytes(255 - byte for byte in range(256))
# The USB serial latency timer's finest setting: a reader waiting for a stream is not woken more often.
_FINEST_WAKE_S = 1e-3


class _Inbox:
    """Received bytes not read yet; taking everything at once copies nothing."""

    def __init__(self) -> None:
        self._bytes, self._at = b"", 0

    def __len__(self) -> int:
        return len(self._bytes) - self._at

    def put(self, data: bytes) -> None:
        self._bytes, self._at = (self._bytes[self._at :] + data if len(self) else data), 0

    def take(self, size: int) -> bytes:
        if self._at == 0 and size >= len(self._bytes):
            taken, self._bytes = self._bytes, b""
            return taken
        taken = self._bytes[self._at : self._at + size]
        self._at += len(taken)
        return taken

    def clear(self) -> None:
        self._bytes, self._at = b"", 0


class _Line(Protocol):
    """One end of the cable."""

    env: simpy.Environment
    inbox: _Inbox

    def configure(self, byte_s: float, clear: bool) -> None: ...
    def send(self, data: bytes) -> None: ...
    def unsent(self) -> int: ...
    def cancel(self) -> None: ...
    def collect(self) -> int: ...
    def advance(self, deadline_s: float, missing: int) -> None: ...
    def discard(self) -> None: ...


class _DeviceLine:
    """To a command/reply instrument. A request arrives after its transmission time; so does the reply."""

    def __init__(self, device: switchboard.Device) -> None:
        self.inbox = _Inbox()
        self._device, self.env = device, device.env
        self._byte_s, self._clear = 0.0, True
        self._sent: deque[tuple[float, simpy.Event, bytes]] = deque()
        self._replies: deque[tuple[float, bytes]] = deque()
        self._out_free_s = self._in_free_s = -inf

    def configure(self, byte_s: float, clear: bool) -> None:
        self._byte_s, self._clear = byte_s, clear

    def send(self, data: bytes) -> None:
        now = self.env.now
        self._out_free_s = max(now, self._out_free_s) + len(data) * self._byte_s
        arrival = self.env.timeout(self._out_free_s - now)
        self._sent.append((self._out_free_s, arrival, data if self._clear else data.translate(_GARBLED)))
        arrival.callbacks.append(self._deliver)

    def _deliver(self, arrival: simpy.Event) -> None:
        if not self._sent or self._sent[0][1] is not arrival:
            return  # cancelled by reset_output_buffer
        now = self.env.now
        for delay_s, reply in self._device.receive(self._sent.popleft()[2], now):
            self._in_free_s = max(now + delay_s, self._in_free_s) + len(reply) * self._byte_s
            self._replies.append((self._in_free_s, reply if self._clear else reply.translate(_GARBLED)))

    def unsent(self) -> int:
        return sum(len(data) for _, _, data in self._sent)

    def cancel(self) -> None:
        self._sent.clear()
        self._out_free_s = -inf

    def collect(self) -> int:
        """Move every reply that has arrived by now into the inbox; bytes in it."""
        while self._replies and self._replies[0][0] <= self.env.now:
            self.inbox.put(self._replies.popleft()[1])
        return len(self.inbox)

    def advance(self, deadline_s: float, missing: int) -> None:
        """Run the world to the next instant that can bring bytes, or to the deadline."""
        until = min(self._replies[0][0] if self._replies else inf, deadline_s)
        if self._sent and self._sent[0][0] <= until:
            first = self._sent[0]
            while self._sent and self._sent[0] is first:
                self.env.step()
            return
        if until == inf:
            raise serial.SerialException("a read without time-out would wait for ever: nothing is on its way here")
        self.env.run(until=until)

    def discard(self) -> None:
        self.collect()
        self.inbox.clear()


class _StreamLine:
    """From an instrument that talks unasked; what is sent to it goes nowhere."""

    def __init__(self, stream: switchboard.Stream) -> None:
        self.inbox = _Inbox()
        self._stream, self.env = stream, stream.env
        self._byte_s, self._clear = 0.0, True
        stream.skip_until(self.env.now)

    def configure(self, byte_s: float, clear: bool) -> None:
        self._byte_s, self._clear = byte_s, clear

    def send(self, data: bytes) -> None:
        pass

    def unsent(self) -> int:
        return 0

    def cancel(self) -> None:
        pass

    def collect(self) -> int:
        """Move everything sent by now into the inbox; bytes in it."""
        if data := self._stream.bytes_until(self.env.now):
            self.inbox.put(data if self._clear else data.translate(_GARBLED))
        return len(self.inbox)

    def advance(self, deadline_s: float, missing: int) -> None:
        """Run the world for as long as the missing bytes take at least on the line."""
        soonest = self.env.now + max(missing * self._byte_s, _FINEST_WAKE_S)
        self.env.run(until=min(soonest, deadline_s))

    def discard(self) -> None:
        self.inbox.clear()
        self._stream.skip_until(self.env.now)


class SimulatedSerial(serial.SerialBase):
    """A pyserial port on the virtual bench; open it with `serial.serial_for_url('sim://NAME', ...)`.

    Raises serial.SerialException when no instrument sits at that address, and pyserial's own errors otherwise.
    """

    drains_itself = True

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._line: _Line | None = None
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        """Connect to the instrument attached at this address."""
        if self.is_open:
            raise serial.SerialException(f"{self.port} is already open")
        if self.port is None:
            raise serial.SerialException("a port needs an address, such as sim://chamber, before it can be opened")
        try:
            instrument = switchboard.find(self.port)
        except LookupError as error:
            raise serial.SerialException(str(error)) from None
        self._line = _connect(self.port, instrument)
        self._far_baud = int(getattr(instrument, "baud", 0))
        self._reconfigure_port()
        self.is_open = True

    def close(self) -> None:
        """Disconnect; requests already sent still reach the instrument."""
        self.is_open = False
        self._line = None

    def _reconfigure_port(self) -> None:
        if self.baudrate <= 0:
            raise ValueError(f"{self.port}: baud rate {self.baudrate}; it must be above 0")
        bits = 1 + self.bytesize + (self.parity != serial.PARITY_NONE) + self.stopbits
        same_format = (self.bytesize, self.parity, self.stopbits) == (8, "N", 1)
        self._connected().configure(bits / self.baudrate, same_format and self.baudrate == self._far_baud)

    def _connected(self) -> _Line:
        if self._line is None:
            raise serial.PortNotOpenError
        return self._line

    def read(self, size: int = 1, /) -> bytes:
        """Up to `size` bytes; waits in virtual time until they are all there or the time-out has passed."""
        line = self._connected()
        if line.collect() < size and self.timeout != 0:
            self._wait(line, size)
        return line.inbox.take(size)

    def _wait(self, line: _Line, size: int) -> None:
        env, timeout_s = line.env, self.timeout
        deadline = inf if timeout_s is None else env.now + timeout_s
        while env.now < deadline and (there := line.collect()) < size:
            line.advance(deadline, size - there)
        line.collect()

    def write(self, data: "ReadableBuffer", /) -> int:
        """Send bytes; returns at once, as a port with a transmit buffer does."""
        sent = bytes(data)
        if sent:
            self._connected().send(sent)
        return len(sent)

    @property
    def in_waiting(self) -> int:
        """Bytes received and not read yet."""
        return self._connected().collect()

    @property
    def out_waiting(self) -> int:
        """Bytes still on their way to the instrument."""
        return self._connected().unsent()

    def reset_input_buffer(self) -> None:
        """Throw away everything received so far."""
        self._connected().discard()

    def reset_output_buffer(self) -> None:
        """Throw away everything not transmitted yet."""
        self._connected().cancel()

    def flush(self) -> None:
        """Wait, in virtual time, until everything written has been transmitted."""
        line = self._connected()
        while line.unsent():
            line.env.step()

    def _update_rts_state(self) -> None: ...
    def _update_dtr_state(self) -> None: ...
    def _update_break_state(self) -> None: ...


def _connect(address: str, instrument: switchboard.Instrument) -> _Line:
    if isinstance(instrument, switchboard.Stream):
        return _StreamLine(instrument)
    if isinstance(instrument, switchboard.Device):
        return _DeviceLine(instrument)
    raise serial.SerialException(
        f"{address} is no serial instrument but a {type(instrument).__name__}; open it as such"
    )
