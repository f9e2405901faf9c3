"""SimulatedSerial: pyserial's behaviour, in virtual time."""

import importlib
import subprocess
import sys

import pytest
import serial
import simpy

from simulated_hw.wire import switchboard
from simulated_hw.wire.serial_port import SimulatedSerial

ECHO, CLOCK = "sim://test-echo", "sim://test-clock"


class Echo:
    """Answers every message with itself after 10 ms; keeps what it received and when."""

    baud = 9600

    def __init__(self, env):
        self.env, self.received = env, []

    def receive(self, data, now_s):
        self.received.append((now_s, data))
        return [(0.01, data)]


class Clock:
    """Sends the byte k at k seconds."""

    baud = 9600

    def __init__(self, env):
        self.env, self.sent, self.skipped = env, 0, 0

    def bytes_until(self, now_s):
        first, self.sent = self.sent, int(now_s + 1e-9) + 1
        return bytes(number & 0xFF for number in range(first, self.sent))

    def skip_until(self, now_s):
        before, self.sent = self.sent, int(now_s + 1e-9) + 1
        self.skipped += self.sent - before


@pytest.fixture
def env():
    return simpy.Environment(initial_time=100.5)


@pytest.fixture
def echo(env):
    device = Echo(env)
    switchboard.attach(ECHO, device)
    yield device
    switchboard.detach(ECHO)


@pytest.fixture
def clock(env):
    stream = Clock(env)
    switchboard.attach(CLOCK, stream)
    yield stream
    switchboard.detach(CLOCK)


@pytest.fixture
def port(echo):
    with SimulatedSerial(ECHO, baudrate=9600, timeout=1.0) as opened:
        yield opened


def test_the_handler_is_what_pyserial_looks_for(monkeypatch, echo):
    handler = importlib.import_module("simulated_hw.wire.protocol_sim")
    assert handler.serial_class_for_url("sim://x") == ("sim://x", SimulatedSerial)
    monkeypatch.setattr(serial, "protocol_handler_packages", ["serial.urlhandler", "simulated_hw.wire"])
    with serial.serial_for_url(ECHO, baudrate=9600, timeout=0.5) as port:
        assert isinstance(port, serial.SerialBase)
        assert (port.name, port.baudrate, port.timeout, port.is_open) == (ECHO, 9600, 0.5, True)
    assert not port.is_open


def test_importing_registers_nothing():
    """In a process of its own: a world of another test may have registered the handler in this one."""
    code = (
        "import serial, simulated_hw.wire.protocol_sim; from simulated_hw.wire import switchboard; "
        "assert serial.protocol_handler_packages == ['serial.urlhandler'] and not switchboard._attached"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unknown_address_says_what_is_there(echo, clock):
    with pytest.raises(
        serial.SerialException, match=r"no simulated instrument at sim://x; this world has .*test-clock"
    ):
        SimulatedSerial("sim://x")


def test_an_address_can_be_taken_once(env, echo):
    with pytest.raises(ValueError, match="sim://test-echo is taken"):
        switchboard.attach(ECHO, Echo(env))
    switchboard.detach(ECHO)
    switchboard.detach(ECHO)
    switchboard.attach(ECHO, echo)


def test_something_that_is_no_serial_instrument(env):
    class Bus:
        pass

    bus = Bus()
    bus.env = env
    switchboard.attach("sim://test-bus", bus)
    try:
        with pytest.raises(serial.SerialException, match="no serial instrument but a Bus"):
            SimulatedSerial("sim://test-bus")
    finally:
        switchboard.detach("sim://test-bus")


def test_a_reply_takes_both_transmissions_and_the_delay(env, echo, port):
    port.write(bytes(96))
    assert env.now == 100.5
    assert port.read(96) == bytes(96)
    # 96 bytes of 10 bits at 9600 baud last 0.1 s.
    assert echo.received[0][0] == pytest.approx(100.6)
    assert env.now == pytest.approx(100.5 + 0.1 + 0.01 + 0.1)


def test_reading_what_is_there_does_not_move_time(env, port):
    port.write(b"abcdef")
    assert port.read(1) == b"a"
    now = env.now
    assert port.in_waiting == 5
    assert port.read(2) == b"bc"
    assert port.read_all() == b"def"
    assert port.in_waiting == 0
    assert env.now == now


def test_a_time_out_passes_in_virtual_time(env, port):
    port.write(b"abc")
    assert port.read(10) == b"abc"
    assert env.now == pytest.approx(101.5)
    assert port.read(1) == b""
    assert env.now == pytest.approx(102.5)
    port.timeout = 0
    assert port.read(1) == b""
    assert env.now == pytest.approx(102.5)


def test_a_late_reply_is_there_for_the_next_read(env, port):
    port.timeout = 0.005
    port.write(b"abc")
    assert port.read(3) == b""
    port.timeout = 1.0
    assert port.read(3) == b"abc"


def test_a_read_for_ever_of_nothing_is_refused(port):
    port.timeout = None
    port.write(b"a")
    assert port.read(1) == b"a"
    with pytest.raises(serial.SerialException, match="for ever"):
        port.read(1)


def test_writes_queue_on_the_line_and_replies_keep_their_order(env, echo, port):
    port.write(bytes(48))
    port.write(b"x")
    assert port.out_waiting == 49
    port.flush()
    assert port.out_waiting == 0
    assert [data for _, data in echo.received] == [bytes(48), b"x"]
    assert echo.received[1][0] == pytest.approx(100.5 + 49 / 960)
    assert port.read(49) == bytes(48) + b"x"


def test_the_first_of_two_replies_does_not_wait_for_the_second_request(env, port):
    port.write(b"a")
    port.write(bytes(96))
    assert port.read(1) == b"a"
    assert env.now == pytest.approx(100.5 + 1 / 960 + 0.01 + 1 / 960)
    assert port.read(96) == bytes(96)


def test_what_was_written_arrives_while_somebody_else_waits(env, echo, port):
    port.write(b"abc")
    env.run(until=101.0)
    assert echo.received == [(pytest.approx(100.503125), b"abc")]
    assert port.in_waiting == 3


def test_buffers_can_be_thrown_away(env, echo, port):
    port.write(b"abc")
    env.run(until=101.0)
    port.reset_input_buffer()
    assert port.in_waiting == 0
    port.write(b"def")
    port.reset_output_buffer()
    assert port.read(3) == b""
    assert len(echo.received) == 1


def test_what_was_written_before_closing_still_arrives(env, echo, port):
    port.write(b"abc")
    port.close()
    env.run(until=101.0)
    assert len(echo.received) == 1
    with pytest.raises(serial.PortNotOpenError):
        port.read(1)
    with pytest.raises(serial.PortNotOpenError):
        port.write(b"x")
    port.open()
    with pytest.raises(serial.SerialException, match="already open"):
        port.open()


@pytest.mark.parametrize("wrong", [{"baudrate": 19200}, {"parity": "E"}, {"bytesize": 7}, {"stopbits": 2}])
def test_another_line_speed_or_format_garbles(env, echo, clock, wrong):
    with SimulatedSerial(ECHO, **({"baudrate": 9600, "timeout": 1.0} | wrong)) as port:
        port.write(b"*IDN?\n")
        port.read(1)
        assert echo.received[0][1] != b"*IDN?\n"
        assert b"\n" not in echo.received[0][1]
    with SimulatedSerial(CLOCK, **({"baudrate": 9600} | wrong)) as port:
        env.run(until=env.now + 3)
        assert port.read(3) != bytes([102, 103, 104])


def test_a_line_speed_set_later_counts(echo, port):
    port.baudrate = 1200
    port.write(b"a")
    port.read(1)
    port.baudrate = 9600
    port.write(b"a")
    port.read(1)
    assert [data == b"a" for _, data in echo.received] == [False, True]
    with pytest.raises(ValueError, match="baud rate 0"):
        port.baudrate = 0


def test_a_stream_starts_when_the_port_opens(env, clock):
    with SimulatedSerial(CLOCK, baudrate=9600, timeout=10.0) as port:
        assert port.drains_itself
        assert clock.skipped == 101
        assert port.in_waiting == 0
        assert port.read(2) == bytes([101, 102])
        assert env.now == pytest.approx(102.0, abs=2e-3)
        env.run(until=110.0)
        assert port.in_waiting == 8
        assert port.read(3) == bytes([103, 104, 105])
        port.reset_input_buffer()
        env.run(until=112.5)
        assert port.read(port.in_waiting) == bytes([111, 112])


def test_a_stream_read_times_out_with_what_there_is(env, clock):
    with SimulatedSerial(CLOCK, baudrate=9600, timeout=2.0) as port:
        assert port.read(100) == bytes([101, 102])
        assert env.now == pytest.approx(102.5)
        assert port.write(b"quiet") == 5


def test_it_can_be_used_as_a_file(port):
    port.write(bytearray(b"line\nmore"))
    assert port.read_until(b"\n") == b"line\n"
    buffer = bytearray(4)
    assert port.readinto(buffer) == 4
    assert buffer == b"more"
    port.rts = port.dtr = False
