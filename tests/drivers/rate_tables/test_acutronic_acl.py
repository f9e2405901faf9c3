"""The ACL driver against the simulated controller, scripted answers, and instruments that are none."""

import socket
import threading
from contextlib import suppress

import pytest
import simpy
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs import modbus_rtu
from drivers.errors import BadReply, NoReply, PortError, Refused
from drivers.ports import open_serial
from drivers.rate_tables.acutronic_acl import AcutronicAcl
from simulated_hw.wire import switchboard
from simulated_hw.wire.acutronic_acl import SimulatedAcutronicAcl
from simulated_hw.wire.serial_port import SimulatedSerial

ADDRESS = "sim://test-acl"


class FakeTable:
    """Does at once what it is told."""

    max_rate_dps, max_acceleration_dps2, acceleration_dps2 = 400.0, 500.0, 100.0

    def __init__(self):
        self.rate, self.angle, self.calls = 0.0, 0.0, []

    def energise(self, now_s):
        self.calls.append("energise")

    def release(self, now_s):
        self.calls.append("release")
        self.rate = 0.0

    def command_rate(self, now_s, rate_dps):
        self.calls.append(f"rate {rate_dps:g}")
        self.rate = rate_dps

    def command_position(self, now_s, position_deg):
        self.calls.append(f"position {position_deg:g}")
        self.angle = position_deg

    def set_acceleration(self, acceleration_dps2):
        self.calls.append(f"acceleration {acceleration_dps2:g}")

    def rate_dps(self, now_s):
        return self.rate

    def position_deg(self, now_s):
        return self.angle


class Scripted:
    """Answers the n-th line with the n-th of its answers (the last one for ever); keeps the lines."""

    baud = 9600

    def __init__(self, *answers):
        self.env, self.answers, self.lines = simpy.Environment(), answers, []

    def receive(self, data, now_s):
        self.lines.append(data)
        answer = self.answers[min(len(self.lines), len(self.answers)) - 1]
        return [(0.005, answer)] if answer else []


class Chatter:
    """An instrument that talks all the time."""

    baud = 9600

    def __init__(self, piece):
        self.env, self.piece, self.said = simpy.Environment(), piece, 0

    def bytes_until(self, now_s):
        before, self.said = self.said, int(now_s * 100)
        return self.piece * (self.said - before)

    def skip_until(self, now_s):
        self.said = int(now_s * 100)


@pytest.fixture
def plug():
    """plug(instrument, baud=…, **settings): the driver with that instrument at the far end of its port."""
    ports = []

    def connect(instrument, baud=9600, **settings):
        switchboard.attach(ADDRESS, instrument)
        ports.append(SimulatedSerial(ADDRESS, baudrate=baud, timeout=5.0))
        return AcutronicAcl(ports[0], AcutronicAcl.Settings(**settings))

    yield connect
    switchboard.detach(ADDRESS)
    for port in ports:
        port.close()


@pytest.fixture
def table():
    return FakeTable()


@pytest.fixture
def simulated(table):
    return SimulatedAcutronicAcl(simpy.Environment(), table, {})


def test_a_session(plug, simulated, table):
    driver = plug(simulated, acceleration_dps2=50.0, lockout=True)
    assert driver.identify().startswith("Acutronic USA, ACT3000")
    assert driver.mode() == "off"
    driver.energise()
    assert table.calls == ["acceleration 50", "energise", "rate 0"]
    assert driver.mode() == "rate"
    driver.set_rate_dps(-180.0)
    assert driver.rate_dps() == -180.0
    driver.go_to_deg(90.5)
    assert driver.mode() == "position"
    assert driver.position_deg() == 90.5
    driver.set_rate_dps(10.0)
    driver.stop()
    assert driver.rate_dps() == 0.0
    assert driver.fault() is None
    driver.release()
    assert table.calls[3:] == ["rate -180", "position 90.5", "rate 10", "rate 0", "rate 0", "release"]
    assert driver.mode() == "off"
    assert driver.fault() is None


@pytest.mark.parametrize("options", [{}, {"terminator": "lf"}, {"answers_commands": False}])
@pytest.mark.parametrize("prefixed", [False, True])
def test_other_links(plug, table, options, prefixed):
    driver = plug(SimulatedAcutronicAcl(simpy.Environment(), table, options, prefixed=prefixed), **options)
    driver.energise()
    driver.set_rate_dps(3.5)
    assert driver.rate_dps() == 3.5
    assert table.calls == ["energise", "rate 0", "rate 3.5"]


@pytest.mark.wall
def test_over_tcp(table):
    """The same driver over a socket, to a controller that precedes its answers with error word and length."""
    device = SimulatedAcutronicAcl(simpy.Environment(), table, {}, prefixed=True)
    server = socket.create_server(("127.0.0.1", 0))

    def serve():
        link, _ = server.accept()
        with link:
            while data := link.recv(256):
                for _, answer in device.receive(data, 0.0):
                    link.sendall(answer)

    serving = threading.Thread(target=serve, daemon=True)
    serving.start()
    port = open_serial(f"socket://127.0.0.1:{server.getsockname()[1]}", 9600, 1.0)
    try:
        driver = AcutronicAcl(port, AcutronicAcl.Settings())
        assert driver.identify().startswith("Acutronic")
        driver.energise()
        driver.set_rate_dps(-12.5)
        assert driver.rate_dps() == -12.5
        with pytest.raises(Refused, match="error 1"):
            driver.set_rate_dps(1e4)
    finally:
        port.close()
        serving.join(2)
        server.close()


def test_the_demand_goes_before_the_mode_and_the_mode_only_when_it_changes(plug):
    device = Scripted(b"OK\r\n")
    driver = plug(device)
    driver.set_rate_dps(20.0)
    driver.set_rate_dps(-1e-3)
    driver.go_to_deg(-90.0)
    assert device.lines == [
        b":Demand:Rate 1,20.000000\r\n",
        b":Mode:Rate 1\r\n",
        b":Demand:Rate 1,-0.001000\r\n",
        b":Demand:Position 1,-90.000000\r\n",
        b":Mode:Position 1\r\n",
    ]


@pytest.mark.parametrize("answer", [b"OK\r\n", b"ok\n", b"\r\n", b"\n", b"\0\0\0\0\2\0\0\0OK", bytes(8)])
def test_acknowledgements(plug, answer):
    plug(Scripted(answer)).set_acceleration_dps2(10.0)


@pytest.mark.parametrize(("answer", "mode"), [(b"R\r\n", "rate"), (b"position\r\n", "position"), (b"OFF\n", "off")])
def test_modes_as_words_or_letters(plug, answer, mode):
    assert plug(Scripted(answer)).mode() == mode


def test_a_trip_is_a_fault_and_stopping_then_is_no_error(plug, simulated, table):
    driver = plug(simulated)
    driver.energise()
    driver.set_rate_dps(100.0)
    simulated.trip("door open")
    assert driver.fault() == "interlock: Fault: door open"
    driver.stop()
    driver.release()
    assert table.rate == 0.0
    driver.energise()
    assert driver.fault() is None


def test_an_interlock_that_opened_by_another_hand_is_a_fault(plug, simulated):
    driver = plug(simulated)
    driver.energise()
    simulated.receive(b":Interlock:Open 1\n", 0.0)
    assert driver.fault() == "interlock: Open"


def test_stopping_an_axis_that_is_not_energised(plug, simulated, table):
    plug(simulated).stop()
    assert table.calls == []


def test_a_stop_that_is_refused_under_power_is_an_error(plug):
    device = Scripted(b"OK\r\n", b"ERROR mode locked\r\n", b"Close\r\n")
    with pytest.raises(Refused, match="mode locked"):
        plug(device).stop()


def test_a_rate_beyond_the_limit_is_refused(plug, simulated, table):
    driver = plug(simulated)
    driver.energise()
    with pytest.raises(Refused, match=r"':Demand:Rate 1,400.100000' was refused: ERROR .* limit of 400"):
        driver.set_rate_dps(400.1)
    assert table.rate == 0.0


def test_a_mode_without_interlock_is_refused(plug, simulated):
    with pytest.raises(Refused, match="interlock is not closed"):
        plug(simulated).set_rate_dps(1.0)


def test_an_error_word_is_a_refusal(plug):
    with pytest.raises(Refused, match="error 17") as caught:
        plug(Scripted(bytes.fromhex("00000011 00000000"))).set_rate_dps(1.0)
    assert caught.value.code == 17


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_values_that_are_none(plug, simulated, value):
    driver = plug(simulated)
    for call in (driver.set_rate_dps, driver.go_to_deg, driver.set_acceleration_dps2):
        with pytest.raises(ValueError, match="must be"):
            call(value)
    with pytest.raises(ValueError, match="acceleration"):
        driver.set_acceleration_dps2(0.0)


@pytest.mark.parametrize("damaged", [b"", b"12.", b"1\xff2.5\r\n", bytes.fromhex("0000000000000009") + b"12.5"])
def test_one_damaged_answer_is_asked_again(plug, damaged):
    device = Scripted(damaged, damaged, b"12.5\r\n")
    assert plug(device).rate_dps() == 12.5
    assert len(device.lines) == 3


def test_a_late_answer_is_not_taken_for_the_next_questions(plug, simulated, table):
    driver = plug(simulated)
    table.rate, table.angle = 12.5, 77.0
    prompt = simulated.receive
    delays = iter([1.5])
    simulated.receive = lambda data, now_s: [(next(delays, delay), answer) for delay, answer in prompt(data, now_s)]
    assert driver.rate_dps() == 12.5
    assert driver.position_deg() == 77.0


def test_closing_the_interlock_is_not_repeated(plug):
    device = Scripted(b"OK\r\n", b"")
    with pytest.raises(NoReply, match="1 try"):
        plug(device).energise()
    assert device.lines == [b":Interlock:Reset\r\n", b":Interlock:Close 1\r\n"]


def test_silence(plug):
    device = Scripted(b"")
    with pytest.raises(
        NoReply, match=r"Acutronic ACL table at sim://test-acl: no reply to '\*IDN\?' within 0.5 s \(2 tries\)"
    ):
        plug(device, reply_timeout_s=0.5, tries=2).identify()
    assert device.env.now == pytest.approx(1.0, abs=0.1)


def test_a_wrong_line_speed_is_silence(plug, simulated):
    with pytest.raises(NoReply, match="baud rate"):
        plug(simulated, baud=19200).identify()


@pytest.mark.parametrize(
    ("answer", "names"),
    [
        (b"NA:CMD ERR\r\n", "does not hold 'Acutronic'.*ASCII text 'NA:CMD ERR'"),
        (b"\r\n", "empty"),
        (modbus_rtu.encode_reply(modbus_rtu.Registers(1, (0xFF38,))), "Modbus RTU frame of address 1"),
        (modbus_rtu.encode_request(modbus_rtu.WriteOne(3, 0x2020, 0x2020)), "Modbus RTU frame of address 3"),
        (bytes.fromhex("FE81FF55") * 9, "KVH gyro stream"),
        (b"x" * 600, "no end within 512 bytes"),
    ],
)
def test_another_instrument_on_the_port(plug, answer, names):
    with pytest.raises(BadReply, match=f"(?s){names}"):
        plug(Scripted(answer)).identify()


@pytest.mark.parametrize("piece", [bytes.fromhex("FE81FF55") + bytes(range(100, 132)), b"12.5 34.7\r\n", b"\xaa" * 7])
def test_an_instrument_that_talks_all_the_time(plug, piece):
    with pytest.raises(BadReply):
        plug(Chatter(piece)).identify()


@pytest.mark.parametrize(
    ("call", "answer", "names"),
    [
        ("mode", b"12.5\r\n", "'12.5' is no mode"),
        ("fault", b"maybe\r\n", "neither Open nor Close nor Fault"),
        ("rate_dps", b"OK\r\n", "'OK' is no number"),
        ("rate_dps", b"nan\r\n", "'nan' is no number"),
        ("stop", b"25.1,30.0\r\n", "no acknowledgement"),
    ],
)
def test_answers_that_make_no_sense(plug, call, answer, names):
    with pytest.raises(BadReply, match=names):
        getattr(plug(Scripted(answer)), call)()


@given(st.binary(min_size=1, max_size=40))
def test_arbitrary_answers_give_one_of_our_errors_or_a_number(answer):
    switchboard.attach(ADDRESS, Scripted(answer))
    try:
        with SimulatedSerial(ADDRESS, baudrate=9600) as port:
            driver = AcutronicAcl(port, AcutronicAcl.Settings())
            with suppress(BadReply, Refused):
                assert isinstance(driver.rate_dps(), float)
    finally:
        switchboard.detach(ADDRESS)


def test_a_port_that_is_gone(plug, simulated):
    driver = plug(simulated)
    driver._link._port.close()
    with pytest.raises(PortError, match="sim://test-acl: failed while in use"):
        driver.rate_dps()


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"baud": -1}, "baud"),
        ({"axis": 0}, "axis"),
        ({"reply_timeout_s": 0.0}, "reply_timeout"),
        ({"tries": 99}, "tries"),
        ({"terminator": "cr"}, "terminator"),
        ({"acceleration_dps2": 0.0}, "acceleration"),
    ],
)
def test_settings_are_checked(settings, field):
    with pytest.raises(ValueError, match=field):
        AcutronicAcl.Settings(**settings)
