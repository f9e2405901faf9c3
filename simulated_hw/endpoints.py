"""Where a client of a live simulator connects: a pty, or a TCP port of this machine. Bytes only; nothing here waits.

An end outlives its clients. While nobody is connected, what an instrument says is lost, as on an open cable.
"""

import contextlib
import errno
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

_LOOPBACK = "127.0.0.1"
_READ_BYTES = 4096
# What a TCP connection holds for a client that is behind, as a pty holds 64 kB: old frames are worse than lost ones.
_SENT_BYTES = 1 << 14
_GONE = (errno.EIO, errno.ENXIO)


class End(Protocol):
    """One client at a time on the far side; `lost` counts bytes that a connected client was too slow for."""

    lost: int

    @property
    def address(self) -> str:
        """What a client opens, as pyserial understands it."""
        ...

    def receive(self) -> bytes | None:
        """What the client has sent since the last call; None if there is no client."""
        ...

    def send(self, data: bytes) -> None:
        """Give the client these bytes, now or as soon as it takes them."""
        ...

    def unplug(self) -> None:
        """Take the end away, as pulling a USB adapter does; harmless twice."""
        ...

    def plug(self) -> None:
        """Put it in again, under the same address where that is possible."""
        ...


class _Outbox:
    """The rest of a burst that did not fit any more: it goes first, and until it is gone whole bursts are lost."""

    def __init__(self) -> None:
        self._kept = b""

    def push(self, data: bytes, write: Callable[[bytes], int]) -> int:
        """Write a burst as far as it goes; bytes of it that are lost."""
        self._kept = _unwritten(self._kept, write)
        if self._kept:
            return len(data)
        self._kept = _unwritten(data, write)
        return 0

    def clear(self) -> None:
        self._kept = b""


def _unwritten(data: bytes, write: Callable[[bytes], int]) -> bytes:
    with contextlib.suppress(BlockingIOError):
        while data:
            data = data[write(data) :]
    return data


class PtyEnd:
    """A pseudo-terminal; `link` is a symbolic link that keeps its name when the pty does not."""

    def __init__(self, link: Path | None = None) -> None:
        """Raises OSError if the system has no ptys or the link cannot be made."""
        self.lost = 0
        self._link = link
        self._outbox = _Outbox()
        self._master: int | None = None
        self._name = ""
        self.plug()

    @property
    def address(self) -> str:
        """The device file."""
        return str(self._link) if self._link else self._name

    def plug(self) -> None:
        """Make the pty and its link."""
        import tty

        if self._master is not None:
            return
        if not hasattr(os, "openpty"):
            raise OSError("this system has no pseudo-terminals; use TCP ports (--tcp)")
        self._master, slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(slave)
        self._name = os.ttyname(slave)
        # With no slave open the master reports it (EIO): that is how a client's going is seen.
        os.close(slave)
        if self._link:
            # A link that a killed simulator left is replaced; a file is not.
            if self._link.is_symlink():
                self._link.unlink()
            self._link.symlink_to(self._name)

    def unplug(self) -> None:
        """Close the pty; its client sees a port that is gone."""
        if self._master is not None:
            os.close(self._master)
            self._master = None
            if self._link and self._link.is_symlink() and str(self._link.readlink()) == self._name:
                self._link.unlink()

    def receive(self) -> bytes | None:
        """See End."""
        if self._master is None:
            return None
        try:
            return os.read(self._master, _READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno not in _GONE:
                raise
            self._outbox.clear()
            return None

    def send(self, data: bytes) -> None:
        """See End."""
        master = self._master
        if master is None:
            return
        try:
            self.lost += self._outbox.push(data, lambda kept: os.write(master, kept))
        except OSError as error:
            # The client went between two looks; the next `receive` sees it.
            if error.errno not in _GONE:
                raise


class TcpEnd:
    """A TCP port on the loopback interface, for one client at a time, as a serial device server has it."""

    def __init__(self) -> None:
        """Raises OSError if no port can be had."""
        self.lost = 0
        self._outbox = _Outbox()
        self._port = 0
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self.plug()

    @property
    def address(self) -> str:
        """A URL of pyserial."""
        return f"socket://{_LOOPBACK}:{self._port}"

    def plug(self) -> None:
        """Listen, on the same port as before."""
        if self._listener is None:
            self._listener = socket.create_server((_LOOPBACK, self._port), backlog=1)
            self._listener.setblocking(False)
            self._port = self._listener.getsockname()[1]

    def unplug(self) -> None:
        """Hang up and stop listening."""
        self._hang_up()
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def receive(self) -> bytes | None:
        """See End."""
        data = self._heard()
        if data is None:
            self._hang_up()
        # After hearing of the old one's end: who reconnects at once is not turned away.
        self._accept()
        return None if self._client is None else data or b""

    def _heard(self) -> bytes | None:
        """What has come in; None if there is no client, or no more."""
        if self._client is None:
            return None
        try:
            return self._client.recv(_READ_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def send(self, data: bytes) -> None:
        """See End."""
        if self._client is None:
            return
        try:
            self.lost += self._outbox.push(data, self._client.send)
        except OSError:
            self._hang_up()

    def _accept(self) -> None:
        """Take a waiting client, or turn it away while there is one."""
        if self._listener is None:
            return
        try:
            client, _ = self._listener.accept()
        except OSError:
            return
        if self._client is not None:
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SENT_BYTES)
        self._client = client

    def _hang_up(self) -> None:
        self._outbox.clear()
        if self._client is not None:
            self._client.close()
            self._client = None
