"""Ports: opening, what can go wrong with it, and the reader thread proven over a pty."""

import errno
import os
import socket
import threading
import tty

import pytest
import serial
import simpy

from drivers.errors import PortError
from drivers.ports import DirectSerialSource, ThreadedSerialSource, open_byte_source, open_serial
from simulated_hw.wire import switchboard
from simulated_hw.wire.serial_port import SimulatedSerial


class Pty:
    """A serial port of this machine whose far end is `master`; `seen` is set for every read of its reader."""

    def __init__(self):
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = open_serial(os.ttyname(self._slave), 921600, 0.05)
        os.close(self._slave)
        self.open = True

    def send(self, data):
        while data:
            data = data[os.write(self.master, data) :]

    def hang_up(self):
        if self.open:
            os.close(self.master)
            self.open = False


@pytest.fixture
def pty():
    made = Pty()
    yield made
    made.hang_up()
    made.port.close()


def gather(source, size):
    """Take until `size` bytes are there, at most some seconds of wall time (a wait on a condition nobody signals)."""
    data, pause = b"", threading.Event()
    for _ in range(1000):
        data += source.take()[0]
        if len(data) >= size:
            break
        pause.wait(0.005)
    return data


@pytest.mark.wall
def test_a_burst_over_tcp_is_not_read_byte_by_byte():
    sent = os.urandom(200_000)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = open_serial(f"socket://127.0.0.1:{server.getsockname()[1]}", 921600, 0.05)
        far, _ = server.accept()
    reads, read = [], port.read
    port.read = lambda size=1: reads.append(size) or read(size)
    source = open_byte_source(port, now=lambda: 1.0)
    with far:
        far.sendall(sent)
        assert gather(source, len(sent)) == sent
        assert len(reads) < 1000
    for _ in range(1000):  # the far end hung up
        try:
            source.take()
        except PortError as error:
            assert "went away" in str(error)
            break
        threading.Event().wait(0.005)
    else:
        pytest.fail("the hang-up was not noticed")
    source.close()


@pytest.mark.wall
def test_a_burst_larger_than_the_tty_buffer_arrives_whole(pty):
    source = ThreadedSerialSource(pty.port, now=lambda: 12.5)
    sent = os.urandom(200_000)
    pty.send(sent)
    assert gather(source, len(sent)) == sent
    assert source.take() == (b"", 12.5)
    pty.send(b"x" * 5000)
    assert gather(source, 5000) == b"x" * 5000
    source.close()
    assert not pty.port.is_open


@pytest.mark.wall
def test_discard_throws_away_what_came_before(pty):
    source = ThreadedSerialSource(pty.port, now=lambda: 0.0)
    pty.send(b"old")
    wait_until(lambda: len(source._held) == 3)
    source.discard()
    pty.send(b"new")
    assert gather(source, 3) == b"new"
    source.close()


@pytest.mark.wall
def test_a_port_that_goes_away_is_an_error_on_the_next_take(pty):
    source = ThreadedSerialSource(pty.port, now=lambda: 0.0)
    pty.send(b"last words")
    wait_until(lambda: len(source._held) == 10)
    pty.hang_up()
    source._thread.join(5)
    for _ in range(2):
        with pytest.raises(PortError, match=r"went away while reading.*start again"):
            source.take()
    source.close()


@pytest.mark.wall
def test_an_overflow_is_an_error_until_discarded(pty):
    source = ThreadedSerialSource(pty.port, now=lambda: 0.0, limit_bytes=10_000)
    pty.send(bytes(10_001))
    wait_until(lambda: source._overflowed)
    with pytest.raises(PortError, match="more than 10000 bytes"):
        source.take()
    assert not source._held
    wait_until(lambda: pty.port.in_waiting == 0)
    source.discard()
    pty.send(b"fresh")
    assert gather(source, 5)[-5:] == b"fresh"
    source.close()


def wait_until(condition):
    pause = threading.Event()
    for _ in range(1000):
        if condition():
            return
        pause.wait(0.005)
    pytest.fail("the reader thread did not get there")


def test_a_port_that_does_not_exist():
    with pytest.raises(PortError, match=r"/dev/no-such-port: does not open.*plugged in.*list_ports"):
        open_serial("/dev/no-such-port", 9600, 1.0)


def test_an_unknown_kind_of_port():
    with pytest.raises(PortError, match=r"nonsense://x: does not open.*bench file"):
        open_serial("nonsense://x", 9600, 1.0)


@pytest.mark.wall
def test_a_port_in_use(pty):
    with pytest.raises(PortError, match="Another program holds it"):
        open_serial(pty.port.name, 9600, 1.0)


@pytest.mark.parametrize(
    ("code", "advice"),
    [(errno.EACCES, "add the user"), (errno.EBUSY, "Another program"), (None, "Check the address")],
)
def test_what_to_do_about_a_port(monkeypatch, code, advice):
    def refuse(*args, **kwargs):
        raise serial.SerialException(code, "no") if code else serial.SerialException("no")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(PortError, match=advice):
        open_serial("/dev/ttyX", 9600, 1.0)


class Talker:
    """A stream of the byte 7, one a second; `gone` makes its port fail."""

    baud = 9600

    def __init__(self, env):
        self.env, self.at_s, self.gone = env, 0.0, False

    def bytes_until(self, now_s):
        if self.gone:
            raise serial.SerialException("unplugged")
        count, self.at_s = int(now_s - self.at_s), now_s
        return b"\x07" * count

    def skip_until(self, now_s):
        self.at_s = now_s


@pytest.fixture
def talker():
    made = Talker(simpy.Environment())
    switchboard.attach("sim://test-talker", made)
    yield made
    switchboard.detach("sim://test-talker")


def test_a_simulated_port_is_its_own_reader(monkeypatch, talker):
    monkeypatch.setattr(serial, "protocol_handler_packages", ["simulated_hw.wire"])
    port = open_serial("sim://test-talker", 9600, 1.0)
    assert isinstance(port, SimulatedSerial)
    source = open_byte_source(port, now=lambda: talker.env.now)
    assert isinstance(source, DirectSerialSource)
    assert source.name == "sim://test-talker"
    talker.env.run(until=5.0)
    assert source.take() == (b"\x07" * 5, 5.0)
    talker.env.run(until=9.0)
    source.discard()
    assert source.take() == (b"", 9.0)
    talker.gone = True
    with pytest.raises(PortError, match=r"sim://test-talker.*unplugged"):
        source.take()
    source.close()
    assert not port.is_open


def test_a_simulated_port_of_no_world(monkeypatch):
    monkeypatch.setattr(serial, "protocol_handler_packages", ["simulated_hw.wire"])
    with pytest.raises(PortError, match="this world has none: no virtual bench is open"):
        open_serial("sim://chamber", 9600, 1.0)
