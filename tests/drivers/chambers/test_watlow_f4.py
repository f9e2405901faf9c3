"""The Watlow F4 driver against the simulated controller, scripted replies, and instruments that are none."""

import os
import tty

import pytest
import simpy
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import ReadHoldingRegistersResponse

from drivers.chambers.watlow_f4 import WatlowF4
from drivers.codecs import modbus_rtu
from drivers.codecs.modbus_rtu import ExceptionReply, Registers, Written
from drivers.errors import BadReply, NoReply, PortError, Refused
from drivers.ports import open_serial
from simulated_hw.wire import switchboard
from simulated_hw.wire.serial_port import SimulatedSerial
from simulated_hw.wire.watlow_f4 import SimulatedWatlowF4

ADDRESS = "sim://test-f4"


class FakeChamber:
    limits_degc = (-60.0, 90.0)

    def __init__(self):
        self.probe, self.final_setpoint_degc = -20.0, 25.0
        self.commands = []

    def probe_degc(self, now_s):
        return self.probe

    def power_percent(self, now_s):
        return 0.0

    def command(self, now_s, setpoint_degc, ramp_degc_min):
        self.commands.append((setpoint_degc, ramp_degc_min))
        self.final_setpoint_degc = setpoint_degc


class Scripted:
    """Answers the n-th request with the n-th of its replies (the last one for ever); keeps the requests."""

    baud = 19200

    def __init__(self, *replies):
        self.env, self.replies, self.requests = simpy.Environment(), replies, []

    def receive(self, data, now_s):
        self.requests.append(data)
        reply = self.replies[min(len(self.requests), len(self.replies)) - 1]
        return [(0.02, reply)] if reply else []


class KvhStream:
    """A gyro on the chamber's port: a KVH frame every 10 ms, whatever is sent."""

    baud = 19200

    def __init__(self):
        self.env, self.frames = simpy.Environment(), 0
        self.frame = bytes.fromhex("FE81FF55") + bytes(range(100, 132))

    def bytes_until(self, now_s):
        before, self.frames = self.frames, int(now_s * 100)
        return self.frame * (self.frames - before)

    def skip_until(self, now_s):
        self.frames = int(now_s * 100)


@pytest.fixture
def plug():
    """plug(instrument, baud=…, **settings): the driver with that instrument at the far end of its port."""
    ports = []

    def connect(instrument, baud=19200, **settings):
        switchboard.attach(ADDRESS, instrument)
        ports.append(SimulatedSerial(ADDRESS, baudrate=baud, timeout=5.0))
        return WatlowF4(ports[0], WatlowF4.Settings(**settings))

    yield connect
    switchboard.detach(ADDRESS)
    for port in ports:
        port.close()


@pytest.fixture
def chamber():
    return FakeChamber()


@pytest.fixture
def simulated(chamber):
    return SimulatedWatlowF4(simpy.Environment(), chamber, {})


@pytest.fixture
def driver(plug, simulated):
    return plug(simulated)


def test_a_session(driver, chamber, simulated):
    assert driver.identify() == "Watlow F4, model 5270"
    assert driver.limits_degc() == (-60.0, 90.0)
    assert driver.temperature_degc() == -20.0
    driver.set_ramp_degc_min(1.0)
    driver.set_setpoint_degc(-30.04)
    assert chamber.commands == [(-30.0, 1.0)]
    assert driver.setpoint_degc() == -30.0
    driver.set_ramp_degc_min(None)
    driver.set_setpoint_degc(60.0)
    assert chamber.commands[-1] == (60.0, None)
    assert driver.alarm() is None
    chamber.probe = 95.0
    assert driver.alarm() == "alarm 1 high"
    assert simulated.eeprom_writes == 0


def test_without_a_register_nothing_is_known_of_the_door(driver):
    assert driver.door_open() is None


@pytest.mark.parametrize(
    ("reply", "opened"),
    [("01 03 02 00 01 79 84", True), ("01 03 02 00 00 B8 44", False), ("01 03 02 00 02 39 85", False)],
)
def test_the_door_is_open_when_its_register_says_so(plug, reply, opened):
    """A read of register 106 and the replies 1, 0 and 2, byte for byte (CRCs by pymodbus)."""
    line = Scripted(bytes.fromhex(reply))
    driver = plug(line, door_register=106)
    assert driver.door_open() is opened
    assert line.requests == [bytes.fromhex("01 03 00 6A 00 01 A4 16")]


def test_a_door_switch_that_opens_is_told_the_other_way_round(plug):
    driver = plug(Scripted(bytes.fromhex("01 03 02 00 00 B8 44")), door_register=4000, door_open_word=0)
    assert driver.door_open() is True


def test_the_alarm_that_is_the_door_switch_is_no_alarm(plug, chamber):
    simulated = SimulatedWatlowF4(simpy.Environment(), chamber, {"door_register": 106})
    driver = plug(simulated, door_register=106)
    simulated.show_door(True)
    assert (driver.door_open(), driver.alarm()) == (True, None)
    chamber.probe = 95.0
    assert driver.alarm() == "alarm 1 high"
    simulated.show_door(False)
    assert driver.door_open() is False


def test_a_door_register_that_the_controller_has_not_is_refused(plug, simulated):
    with pytest.raises(Refused, match="read register 4711"):
        plug(simulated, door_register=4711).door_open()


@pytest.mark.parametrize("settings", [{"door_register": -1}, {"door_register": 65536}, {"door_open_word": 65536}])
def test_a_door_beyond_what_registers_are(settings):
    with pytest.raises(ValueError, match="door_"):
        WatlowF4.Settings(**settings)


def test_without_identify_the_scale_is_learnt_at_the_first_need(driver):
    assert driver.temperature_degc() == -20.0


@pytest.mark.parametrize(("decimals", "seen"), [(0, -12.0), (1, -12.3), (2, -12.35), (3, -12.346)])
def test_all_decimals(plug, simulated, chamber, decimals, seen):
    simulated.receive(modbus_rtu.encode_request(modbus_rtu.WriteOne(1, 606, decimals)), 0.0)
    driver, chamber.probe = plug(simulated), -12.3456
    assert driver.temperature_degc() == pytest.approx(seen, abs=1e-9)
    driver.set_setpoint_degc(-12.3456)
    assert chamber.commands[0][0] == pytest.approx(seen, abs=1e-9)
    assert driver.setpoint_degc() == pytest.approx(seen, abs=1e-9)


def test_a_controller_in_fahrenheit_is_converted(plug, simulated, chamber):
    simulated.receive(modbus_rtu.encode_request(modbus_rtu.WriteOne(1, 901, 0)), 0.0)
    driver = plug(simulated)
    assert driver.identify() == "Watlow F4, model 5270, set to degF (converted)"
    chamber.probe = -40.0
    assert driver.temperature_degc() == pytest.approx(-40.0)
    driver.set_ramp_degc_min(1.0)
    driver.set_setpoint_degc(-30.0)
    assert chamber.commands == [(pytest.approx(-30.0), pytest.approx(1.0))]
    assert driver.limits_degc() == (pytest.approx(-60.0), pytest.approx(90.0))


@pytest.mark.parametrize(
    ("rate_degc_min", "words"),
    [
        (1.0, (2, 10, 0)),
        (0.1, (2, 1, 0)),
        (0.05, (2, 30, 1)),
        (0.33, (2, 198, 1)),
        (5.0, (2, 50, 0)),
        (200.0, (2, 2000, 0)),
    ],
)
def test_the_ramp_goes_out_per_minute_or_per_hour(plug, rate_degc_min, words):
    device = Scripted(*(modbus_rtu.encode_reply(Registers(1, (word,))) for word in (1, 0, 1)), b"")
    with pytest.raises(NoReply):
        plug(device, tries=1).set_ramp_degc_min(rate_degc_min)
    assert modbus_rtu.decode_request(device.requests[-1]) == modbus_rtu.WriteMany(1, 1100, words)


@given(st.floats(-60, 90), st.floats(0.05, 50))
def test_setpoints_and_ramps_arrive_to_the_controllers_step(setpoint_degc, ramp_degc_min):
    chamber = FakeChamber()
    switchboard.attach(ADDRESS, SimulatedWatlowF4(simpy.Environment(), chamber, {}))
    try:
        with SimulatedSerial(ADDRESS, baudrate=19200) as port:
            driver = WatlowF4(port, WatlowF4.Settings())
            driver.set_ramp_degc_min(ramp_degc_min)
            driver.set_setpoint_degc(setpoint_degc)
    finally:
        switchboard.detach(ADDRESS)
    assert chamber.commands[0][0] == pytest.approx(setpoint_degc, abs=0.05 + 1e-9)
    assert chamber.commands[0][1] == pytest.approx(ramp_degc_min, rel=0.01, abs=0.05 / 60 + 1e-9)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e6])
def test_setpoints_that_are_none(driver, chamber, value):
    with pytest.raises(ValueError, match="setpoint"):
        driver.set_setpoint_degc(value)
    assert chamber.commands == []


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), 1e-6, 1e7])
def test_ramps_that_are_none(driver, rate):
    with pytest.raises(ValueError, match="ramp"):
        driver.set_ramp_degc_min(rate)


def test_a_setpoint_beyond_the_controllers_limits_is_refused(driver, chamber):
    with pytest.raises(Refused, match=r"'write 901 to register 300' was refused: exception 3, illegal value\. Keep"):
        driver.set_setpoint_degc(90.1)
    assert chamber.commands == []


def test_a_register_that_is_not_there_is_refused_with_advice(plug):
    device = Scripted(modbus_rtu.encode_reply(ExceptionReply(1, 3, 2)))
    with pytest.raises(Refused, match="Is it an F4"):
        plug(device).identify()
    assert len(device.requests) == 1


@pytest.mark.parametrize(
    ("words", "why"),
    [((5270, 4), "holds 4"), ((5270, 1, 1), "register 608.*holds 1"), ((5270, 1, 0, 2), "register 901.*holds 2")],
)
def test_a_configuration_it_does_not_understand(plug, words, why):
    device = Scripted(*(modbus_rtu.encode_reply(Registers(1, (word,))) for word in words))
    with pytest.raises(BadReply, match=why):
        plug(device).identify()


def test_silence(plug):
    device = Scripted(b"")
    driver = plug(device, reply_timeout_s=0.7, tries=4)
    with pytest.raises(
        NoReply, match=r"Watlow F4 at sim://test-f4 \(address 1\): no reply to 'read register 0' within 0.7 s"
    ):
        driver.identify()
    assert len(device.requests) == 4
    assert device.env.now == pytest.approx(2.8)


def test_a_wrong_line_speed_is_silence(plug, simulated):
    with pytest.raises(NoReply, match="baud rate"):
        plug(simulated, baud=9600).identify()


def test_a_wrong_address_is_silence(plug, simulated):
    with pytest.raises(NoReply, match="address 2"):
        plug(simulated, address=2).identify()


GOOD = bytes.fromhex("01 03 02 FF 38 F8 66")
SCALE = [modbus_rtu.encode_reply(Registers(1, (word,))) for word in (1, 0, 1)]


@pytest.mark.parametrize(
    "damaged",
    [b"", GOOD[:4], GOOD[:-1], b"\0" + GOOD, bytes([1, 3, 2, 0xFF, 0x39, 0xF8, 0x66]), b"\xff" * 3],
    ids=["silence", "cut", "cut at the CRC", "stray byte", "flipped bit", "noise"],
)
def test_one_damaged_reply_is_asked_again(plug, damaged):
    device = Scripted(*SCALE, damaged, damaged, GOOD)
    assert plug(device).temperature_degc() == -20.0
    assert len(set(device.requests[3:])) == 1


def test_a_late_reply_is_not_taken_for_the_next_questions(plug, simulated, chamber):
    driver = plug(simulated)
    driver.identify()
    prompt = simulated.receive
    delays = iter([1.5])
    simulated.receive = lambda data, now_s: [(next(delays, delay), reply) for delay, reply in prompt(data, now_s)]
    assert driver.temperature_degc() == -20.0
    assert driver.setpoint_degc() == 25.0


def test_a_reply_made_by_pymodbus(plug):
    theirs = FramerRTU(DecodePDU(True)).buildFrame(ReadHoldingRegistersResponse(dev_id=1, registers=[0xFF38]))
    assert plug(Scripted(*SCALE, theirs)).temperature_degc() == -20.0


@pytest.mark.parametrize(
    ("reply", "names"),
    [
        (b"NA:CMD ERR\r\n", "ASCII text 'NA:CMD ERR'"),
        (b"OK\r\n", "ASCII text 'OK'"),
        (modbus_rtu.encode_reply(Registers(2, (1,))), "comes from address 2.*Modbus RTU frame of address 2"),
        (modbus_rtu.encode_reply(Registers(1, (1, 2))), "does not hold exactly 1 register"),
        (modbus_rtu.encode_reply(Written(1, 6, 0, 1)), "function 6.*Modbus RTU frame of address 1"),
        (bytes.fromhex("FE81FF55") * 9, "KVH gyro stream"),
        (b"\xff" * 20, "idle or short-circuited"),
    ],
)
def test_another_instrument_on_the_port(plug, reply, names):
    with pytest.raises(BadReply, match=f"(?s){names}") as caught:
        plug(Scripted(reply)).identify()
    assert caught.value.reply[:4] == reply[:4]


def test_a_gyro_stream_on_the_port(plug):
    with pytest.raises(BadReply, match="KVH gyro stream"):
        plug(KvhStream()).identify()


def test_a_write_confirmed_differently(plug):
    device = Scripted(*SCALE, modbus_rtu.encode_reply(Written(1, 6, 300, 251)))
    with pytest.raises(BadReply, match="confirms something else"):
        plug(device).set_setpoint_degc(25.0)


@given(st.binary(min_size=1, max_size=40))
def test_arbitrary_replies_give_one_of_our_errors_or_a_number(reply):
    switchboard.attach(ADDRESS, Scripted(*SCALE, reply))
    try:
        with SimulatedSerial(ADDRESS, baudrate=19200) as port:
            driver = WatlowF4(port, WatlowF4.Settings())
            with pytest.raises((BadReply, Refused)):
                driver.temperature_degc()
    finally:
        switchboard.detach(ADDRESS)


def test_a_port_that_is_gone(driver):
    driver._link._port.close()
    with pytest.raises(PortError, match="sim://test-f4: failed while in use"):
        driver.temperature_degc()


@pytest.mark.wall
def test_a_real_port_that_is_unplugged():
    master, slave = os.openpty()
    tty.setraw(slave)
    port = open_serial(os.ttyname(slave), 19200, 1.0)
    os.close(slave)
    silent, fresh = (WatlowF4(port, WatlowF4.Settings(reply_timeout_s=0.05, tries=1)) for _ in range(2))
    with pytest.raises(NoReply):
        silent.identify()
    os.close(master)
    # One meets it while reading (SerialException), the other while emptying the buffer (termios.error on Linux).
    for driver in (silent, fresh):
        with pytest.raises(PortError, match="Check cable, adapter and power"):
            driver.identify()
    port.close()


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"baud": 0}, "baud"),
        ({"address": 0}, "address"),
        ({"address": 248}, "address"),
        ({"reply_timeout_s": 0.0}, "reply_timeout"),
        ({"reply_timeout_s": float("nan")}, "reply_timeout"),
        ({"tries": 0}, "tries"),
    ],
)
def test_settings_are_checked(settings, field):
    with pytest.raises(ValueError, match=field):
        WatlowF4.Settings(**settings)
