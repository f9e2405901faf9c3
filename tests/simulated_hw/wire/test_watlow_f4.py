"""The simulated Watlow F4: the notes' frames, its registers, and two third-party clients talking to it."""

import os
import threading
import tty

import pytest
import simpy
import watlow_f4
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client import ModbusSerialClient
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU

from drivers.codecs import modbus_rtu
from drivers.codecs.modbus_rtu import ExceptionReply, Read, Registers, WriteMany, WriteOne, to_signed, to_word
from simulated_hw.wire import switchboard
from simulated_hw.wire.serial_port import SimulatedSerial
from simulated_hw.wire.watlow_f4 import SimulatedWatlowF4


class FakeChamber:
    limits_degc = (-60.0, 90.0)

    def __init__(self, probe_degc=-20.0):
        self.probe, self.power, self.final_setpoint_degc = probe_degc, 12.5, 25.0
        self.commands = []

    def probe_degc(self, now_s):
        return self.probe

    def power_percent(self, now_s):
        return self.power

    def command(self, now_s, setpoint_degc, ramp_degc_min):
        self.commands.append((now_s, setpoint_degc, ramp_degc_min))
        self.final_setpoint_degc = setpoint_degc


@pytest.fixture
def chamber():
    return FakeChamber()


@pytest.fixture
def device(chamber):
    return SimulatedWatlowF4(simpy.Environment(), chamber, {"baud": 19200, "address": 1})


def ask(device, request, now_s=0.0):
    (reply,) = device.receive(modbus_rtu.encode_request(request), now_s)
    assert 0.02 <= reply[0] <= 0.03
    return modbus_rtu.decode_reply(reply[1])


def register(device, number):
    return to_signed(ask(device, Read(1, number)).values[0])


# Protocol notes, chambers, section 3: worked frames for -20.0 °C.
@pytest.mark.parametrize(
    ("request_frame", "reply_frame"),
    [
        ("01 06 01 2C FF 38 09 DD", "01 06 01 2C FF 38 09 DD"),
        ("01 10 01 2C 00 01 02 FF 38 F1 1E", "01 10 01 2C 00 01 C1 FC"),
        ("01 03 00 64 00 01 C5 D5", "01 03 02 FF 38 F8 66"),
    ],
)
def test_frames_of_the_notes(device, request_frame, reply_frame):
    assert [reply for _, reply in device.receive(bytes.fromhex(request_frame), 0.0)] == [bytes.fromhex(reply_frame)]


def test_illegal_address_frame_of_the_notes(device):
    ((_, reply),) = device.receive(modbus_rtu.encode_request(WriteOne(1, 299, 0)), 0.0)
    assert reply == bytes.fromhex("01 86 02 C3 A1")


def test_function_4_reads_like_3(device):
    assert ask(device, Read(1, 602, 2, function=4)) == Registers(1, (to_word(-600), 900), 4)


@pytest.mark.parametrize(("decimals", "value"), [(0, -12), (1, -123), (2, -1235), (3, -12346)])
def test_decimals_scale_by_powers_of_ten(device, chamber, decimals, value):
    chamber.probe = -12.3456
    ask(device, WriteOne(1, 606, decimals))
    assert register(device, 100) == value
    ask(device, WriteMany(1, 300, (to_word(-7 * 10**decimals),)))
    assert chamber.commands == [(0.0, -7.0, None)]
    assert register(device, 300) == -7 * 10**decimals


def test_a_value_beyond_the_register_shows_as_its_end(device, chamber):
    chamber.probe = 85.0
    ask(device, WriteOne(1, 606, 3))
    assert register(device, 100) == 32767


def test_fahrenheit(device, chamber):
    ask(device, WriteOne(1, 901, 0))
    assert register(device, 100) == -40
    ask(device, WriteOne(1, 300, to_word(140)))
    assert chamber.commands[-1][1] == pytest.approx(-10.0)
    ask(device, WriteMany(1, 1100, (2, 18, 0)))
    ask(device, WriteOne(1, 300, 500))
    assert chamber.commands[-1][1:] == (pytest.approx(10.0), pytest.approx(1.0))


@pytest.mark.parametrize(
    ("words", "ramp_degc_min"),
    [((2, 10, 0), 1.0), ((2, 300, 1), 0.5), ((0, 10, 0), None), ((1, 10, 0), None), ((2, 0, 0), None)],
)
def test_ramp_to_setpoint(device, chamber, words, ramp_degc_min):
    ask(device, WriteMany(1, 1100, words))
    assert chamber.commands == []
    ask(device, WriteOne(1, 300, 600), now_s=7.0)
    assert chamber.commands == [(7.0, 60.0, ramp_degc_min)]


def test_power_alarms_events_and_state(device, chamber):
    assert (register(device, 103), register(device, 107)) == (1250, 0)
    chamber.power = -50.0
    assert (register(device, 103), register(device, 107)) == (0, -5000)
    assert [register(device, number) for number in (0, 101, 102, 106, 200, 608, 901)] == [5270, 0, 0, 0, 0, 0, 1]
    ask(device, WriteMany(1, 302, (to_word(-100), 400)))
    assert register(device, 102) == 2
    chamber.probe = 40.1
    assert register(device, 102) == 1
    ask(device, WriteOne(1, 2070, 1))
    assert (register(device, 2070), register(device, 2000)) == (1, 0)


@pytest.mark.parametrize(("register_", "open_word"), [(106, 1), (106, 2), (4000, 1), (4000, 0)])
def test_the_door_switch_shows_in_the_register_it_is_wired_to(chamber, register_, open_word):
    settings = {"door_register": register_, "door_open_word": open_word}
    device = SimulatedWatlowF4(simpy.Environment(), chamber, settings)
    shut = register(device, register_)
    assert shut != open_word
    device.show_door(True)
    assert register(device, register_) == open_word
    device.show_door(False)
    assert register(device, register_) == shut


def test_an_alarm_shows_beside_the_door_that_shares_its_register(chamber):
    device = SimulatedWatlowF4(simpy.Environment(), chamber, {"door_register": 106})
    device.show_alarm(2, "low")
    assert register(device, 106) == 2
    device.show_door(True)
    assert register(device, 106) == 1


def test_the_door_frames_byte_for_byte(chamber):
    device = SimulatedWatlowF4(simpy.Environment(), chamber, {"door_register": 106})
    device.show_door(True)
    ((_, reply),) = device.receive(bytes.fromhex("01 03 00 6A 00 01 A4 16"), 0.0)
    assert reply == bytes.fromhex("01 03 02 00 01 79 84")


def test_limits_can_be_narrowed_and_then_hold(device, chamber):
    ask(device, WriteMany(1, 602, (to_word(-300), 600)))
    assert ask(device, WriteOne(1, 300, 601)) == ExceptionReply(1, 6, 3)
    assert ask(device, WriteOne(1, 602, to_word(-610))) == ExceptionReply(1, 6, 3)
    assert chamber.commands == []
    ask(device, WriteOne(1, 300, to_word(-300)))
    assert chamber.commands[-1][1] == -30.0


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (Read(1, 99), 2),
        (Read(1, 300, 4), 2),
        (Read(1, 25), 2),
        (WriteOne(1, 100, 0), 2),
        (WriteMany(1, 1100, (2, 10, 0, 0)), 2),
        (WriteOne(1, 300, 901), 3),
        (WriteOne(1, 606, 4), 3),
        (WriteOne(1, 901, 2), 3),
        (WriteOne(1, 1102, 2), 3),
        (WriteOne(1, 2000, 2), 3),
        (WriteOne(1, 25, 1), 3),
    ],
)
def test_refusals(device, chamber, request_, code):
    reply = ask(device, request_)
    assert isinstance(reply, ExceptionReply)
    assert reply.code == code
    assert chamber.commands == []


def test_a_count_beyond_the_standard_is_an_illegal_value(device):
    frame = FramerRTU(DecodePDU(False)).encode(bytes([3, 0, 100, 0, 126]), 1, 0)
    ((_, reply),) = device.receive(frame, 0.0)
    assert modbus_rtu.decode_reply(reply) == ExceptionReply(1, 3, 3)


def test_unknown_function(device):
    frame = FramerRTU(DecodePDU(False)).encode(bytes([0x2B, 0x0E, 0x01, 0x00]), 1, 0)
    ((_, reply),) = device.receive(frame, 0.0)
    assert modbus_rtu.decode_reply(reply) == ExceptionReply(1, 0x2B, 1)


def test_eeprom_writes_are_counted(device):
    assert device.eeprom_writes == 0
    ask(device, WriteOne(1, 300, 100))
    ask(device, WriteOne(1, 25, 0))
    assert device.eeprom_writes == 1


def test_silence_for_other_addresses_damage_and_broadcast(device, chamber):
    assert device.receive(modbus_rtu.encode_request(Read(2, 100)), 0.0) == []
    assert device.receive(bytes.fromhex("01 03 00 64 00 01 C5 D4"), 1.0) == []
    assert device.receive(modbus_rtu.encode_request(WriteOne(0, 300, 100)), 2.0) == []
    assert chamber.commands == [(2.0, 10.0, None)]


def test_a_split_frame_is_joined_and_a_broken_one_forgotten(device):
    frame = modbus_rtu.encode_request(Read(1, 100))
    assert device.receive(frame[:3], 0.0) == []
    assert len(device.receive(frame[3:], 0.01)) == 1
    assert device.receive(modbus_rtu.encode_request(WriteMany(1, 1100, (2, 1, 1)))[:10], 1.0) == []
    assert len(device.receive(frame, 2.0)) == 1


@given(st.lists(st.binary(max_size=40), max_size=8))
def test_arbitrary_bytes_change_nothing(pieces):
    chamber = FakeChamber()
    device = SimulatedWatlowF4(simpy.Environment(), chamber, {})
    for now_s, piece in enumerate(pieces):
        device.receive(piece, float(now_s))
    assert chamber.commands == []


def test_watlow_f4_client_over_a_simulated_port(chamber):
    """PyPI watlow-f4 (minimalmodbus): 9600 baud, writes single registers with function 16."""
    device = SimulatedWatlowF4(simpy.Environment(), chamber, {"baud": 9600})
    switchboard.attach("sim://test-watlow-client", device)
    try:
        with SimulatedSerial("sim://test-watlow-client", baudrate=9600) as port:
            client = watlow_f4.WatlowF4(port, temp_limit=(-60, 90))
            assert client.temperature == -20.0
            client.temperature_setpoint = -30.5
            assert client.temperature_setpoint == -30.5
    finally:
        switchboard.detach("sim://test-watlow-client")
    assert chamber.commands[0][1] == -30.5


@pytest.mark.wall
def test_pymodbus_client_over_a_pty(device, chamber):
    """pymodbus' own serial client, its framer and its timing, at wall speed."""
    master, slave = os.openpty()
    tty.setraw(slave)

    def pump() -> None:
        while data := os.read(master, 256):
            for _, reply in device.receive(data, 0.0):
                os.write(master, reply)
            if data == b"end of test":
                return

    pumping = threading.Thread(target=pump, daemon=True)
    pumping.start()
    client = ModbusSerialClient(os.ttyname(slave), baudrate=19200, timeout=2)
    try:
        assert client.connect()
        assert to_signed(client.read_holding_registers(100, device_id=1).registers[0]) == -200
        assert client.write_register(300, to_word(-305), device_id=1).registers == [to_word(-305)]
        assert client.write_registers(1100, [2, 10, 0], device_id=1).count == 3
        assert client.read_input_registers(602, count=2, device_id=1).registers == [to_word(-600), 900]
        assert client.read_holding_registers(99, device_id=1).exception_code == 2
    finally:
        client.close()
        os.write(slave, b"end of test")
        pumping.join(2)
        os.close(slave)
        os.close(master)
    assert chamber.commands == [(0.0, -30.5, None)]
