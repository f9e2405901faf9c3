"""Ends: one client at a time, seen to come and go, never blocking whoever pumps."""

import os
import socket
import time
from pathlib import Path

import pytest
import serial

from simulated_hw.endpoints import PtyEnd, TcpEnd

pytestmark = pytest.mark.wall


@pytest.fixture(params=["pty", "tcp"])
def end(request):
    made = PtyEnd() if request.param == "pty" else TcpEnd()
    yield made
    made.unplug()


def client(end):
    port = serial.serial_for_url(end.address, timeout=5.0)
    seen(end, lambda data: data is not None)
    return port


def seen(end, right, seconds=5.0):
    """Look until what the end received is right."""
    deadline = time.monotonic() + seconds
    while not right(data := end.receive()):
        assert time.monotonic() < deadline, data
        time.sleep(0.001)
    return data


def test_bytes_go_both_ways_and_clients_come_and_go(end):
    assert end.receive() is None
    for _ in range(2):
        with client(end) as port:
            assert end.receive() == b""
            port.write(b"question")
            assert seen(end, bool) == b"question"
            end.send(b"answer")
            assert port.read(6) == b"answer"
        assert seen(end, lambda data: data is None) is None


def test_a_client_finds_nothing_of_what_was_said_before_it_came(end):
    with client(end):
        end.send(b"to the first")
    seen(end, lambda data: data is None)
    with client(end) as port:
        end.send(b"to the second")
        assert port.read(13) == b"to the second"


def test_a_client_that_does_not_read_loses_whole_bursts_and_nobody_waits(end):
    burst = bytes(range(256)) * 4
    with client(end) as port:
        for _ in range(10_000):
            end.send(burst)
        assert end.lost and end.lost % len(burst) == 0
        kept = 10_000 - end.lost // len(burst)
        read = b""
        while len(read) < kept * len(burst):
            end.send(b"")
            read += port.read(min(4096, kept * len(burst) - len(read)))
        assert read == burst * kept


def test_an_end_that_is_pulled_is_gone_for_its_client_and_can_be_put_in_again(end):
    port = client(end)
    end.unplug()
    end.unplug()
    assert end.receive() is None
    end.send(b"into the air")
    with pytest.raises((OSError, serial.SerialException)):
        for _ in range(3):
            port.read(1)
    port.close()
    end.plug()
    end.plug()
    with client(end) as port:
        port.write(b"back")
        assert seen(end, bool) == b"back"


def test_a_link_keeps_its_name(tmp_path: Path):
    end = PtyEnd(tmp_path / "chamber")
    assert end.address == str(tmp_path / "chamber") and Path(end.address).is_symlink()
    held = [os.openpty() for _ in range(2)]
    end.unplug()
    assert not Path(end.address).is_symlink()
    end.plug()
    with client(end) as port:
        port.write(b"?")
        assert seen(end, bool) == b"?"
    end.unplug()
    for pair in held:
        for number in pair:
            os.close(number)


def test_a_link_replaces_what_a_killed_simulator_left_and_nothing_else(tmp_path: Path):
    left, taken, file = tmp_path / "left", tmp_path / "taken", tmp_path / "file"
    left.symlink_to("/dev/pts/none")
    file.write_text("precious")
    first, second = PtyEnd(left), PtyEnd(taken)
    assert left.readlink() != Path("/dev/pts/none")
    third = PtyEnd(taken)
    second.unplug()
    assert taken.is_symlink()
    with pytest.raises(FileExistsError):
        PtyEnd(file)
    assert file.read_text() == "precious"
    for end in (first, third):
        end.unplug()
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_tcp_port_has_one_client_and_keeps_its_number():
    end = TcpEnd()
    address = end.address
    with client(end), socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as second:
        second.settimeout(5.0)
        seen(end, lambda data: data == b"")
        assert second.recv(1) == b""  # turned away
    end.unplug()
    end.plug()
    assert end.address == address
    end.unplug()
