"""The simulated ACUTROL: the command table of the notes, its interlock and mode, and what it refuses."""

import pytest
import simpy
from hypothesis import given
from hypothesis import strategies as st

from simulated_hw.wire.acutronic_acl import SimulatedAcutronicAcl


class FakeTable:
    max_rate_dps, max_acceleration_dps2, acceleration_dps2 = 400.0, 500.0, 100.0

    def __init__(self):
        self.calls = []

    def energise(self, now_s):
        self.calls.append(("energise", now_s))

    def release(self, now_s):
        self.calls.append(("release", now_s))

    def command_rate(self, now_s, rate_dps):
        self.calls.append(("rate", now_s, rate_dps))

    def command_position(self, now_s, position_deg):
        self.calls.append(("position", now_s, position_deg))

    def set_acceleration(self, acceleration_dps2):
        self.calls.append(("acceleration", acceleration_dps2))

    def rate_dps(self, now_s):
        return -3.25 * now_s

    def position_deg(self, now_s):
        return 359.5


@pytest.fixture
def table():
    return FakeTable()


@pytest.fixture
def device(table):
    return SimulatedAcutronicAcl(simpy.Environment(), table, {"axis": 1, "baud": 9600})


def say(device, text, now_s=0.0):
    replies = device.receive(text.encode() + b"\r\n", now_s)
    assert all(delay_s > 0 for delay_s, _ in replies)
    return b"".join(reply for _, reply in replies).decode()


def test_the_start_up_of_an_open_client_and_its_shut_down(device, table):
    """AC117: lockout, open, reset, close; demand before mode; rate 0, open."""
    lines = (":Utility:Lockout ON", ":Interlock:Open 1", ":Interlock:Reset", ":Interlock:Close 1")
    assert [say(device, line) for line in lines] == ["OK\r\n"] * 4
    assert say(device, ":Interlock? 1") == "Close\r\n"
    assert say(device, ":Demand:Rate 1,20.0", 1.0) == "OK\r\n"
    assert table.calls == []
    assert say(device, ":Mode:Rate 1", 2.0) == "OK\r\n"
    assert table.calls == [("energise", 2.0), ("rate", 2.0, 20.0)]
    assert say(device, ":Demand:Rate 1,0", 3.0) == "OK\r\n"
    assert table.calls[-1] == ("rate", 3.0, 0.0)
    assert say(device, ":Interlock:Open 1", 4.0) == "OK\r\n"
    assert table.calls[-1] == ("release", 4.0)
    assert say(device, ":Mode? 1") == "Off\r\n"


@pytest.mark.parametrize("line", [":Mode:Position 1", ":Mode 1,Position", ":M:P 1", ":mode 1,p", "MODE:POS 1"])
def test_position_mode_in_all_spellings(device, table, line):
    say(device, ":I:C 1")
    say(device, ":D:P 1,-90.5")
    assert say(device, line) == "OK\r\n"
    assert table.calls == [("energise", 0.0), ("position", 0.0, -90.5)]
    assert say(device, ":Mode? 1") == "Position\r\n"


def test_a_demand_of_another_mode_waits(device, table):
    say(device, ":I:C 1")
    say(device, ":Mode:Rate 1")
    say(device, ":Demand:Position 1,45")
    assert ("position", 0.0, 45.0) not in table.calls
    assert say(device, ":Demand:Position? 1") == "45.000000\r\n"


def test_readings_joined_shortened_and_without_question_mark(device):
    assert say(device, ":read:pos? 1;rate? 1;acc? 1", 2.0) == "359.500000;-6.500000;-3.250000\r\n"
    assert say(device, ":Read:Rate 1", 2.0) == "-6.500000\r\n"
    assert say(device, "*IDN?").startswith("Acutronic USA, ACT3000")


def test_line_ends_and_pieces(device):
    assert device.receive(b":Read:Po", 0.0) == []
    assert [reply for _, reply in device.receive(b"s? 1\n*STB?\r\n\r\n", 0.0)] == [b"359.500000\r\n", b"0\r\n"]


def test_a_trip_opens_the_interlock_until_it_is_reset(device, table):
    say(device, ":I:C 1")
    say(device, ":Mode:Rate 1")
    device.trip("door open")
    assert table.calls[-1] == ("release", 0.0)
    assert say(device, ":Interlock? 1") == "Fault: door open\r\n"
    assert say(device, "*STB?") == "65\r\n"
    assert say(device, ":Interlock:Close 1").startswith("ERROR")
    assert say(device, ":Mode:Rate 1").startswith("ERROR")
    assert say(device, ":Interlock:Open 1") == "OK\r\n"
    assert say(device, ":Interlock? 1") == "Fault: door open\r\n"
    say(device, ":Interlock:Reset")
    assert say(device, ":Interlock? 1") == "Open\r\n"
    assert say(device, ":Interlock:Close 1") == "OK\r\n"


def test_limits_bound_demands(device, table):
    assert say(device, ":Demand:Rate 1,400.1").startswith("ERROR")
    assert say(device, ":Limit:Rate 1,50") == "OK\r\n"
    assert say(device, ":Demand:Rate 1,-50") == "OK\r\n"
    assert say(device, ":Demand:Rate 1,-51").startswith("ERROR")
    assert say(device, ":Limit:Rate 1,401").startswith("ERROR")
    assert say(device, ":Demand:Acceleration 1,20") == "OK\r\n"
    assert say(device, ":Demand:Acceleration 1,0").startswith("ERROR")
    assert say(device, ":Limit:Rate? 1") == "50.000000\r\n"
    assert table.calls == [("acceleration", 20.0)]


@pytest.mark.parametrize(
    "line",
    [
        ":Foo 1",
        ":Mode:Rate 1",
        ":Mode:Synthesis 1",
        ":Mode 1",
        ":Mode 1,Sideways",
        ":Demand:Oscillator 1,1,1,0",
        ":Demand:Rate 2,1",
        ":Demand:Rate 1",
        ":Demand:Rate 1,nan",
        ":Demand:Position 1,inf",
        ":Demand:Rate 1,fast",
        ":Read? 1",
        ":Interlock 1",
        ":Interlock:Close? 1",
        ":Utility:Lockout MAYBE",
        "*IDN",
    ],
)
def test_what_is_refused_moves_nothing(device, table, line):
    assert say(device, line).startswith("ERROR ")
    assert table.calls == []


def test_a_refusal_ends_its_line(device, table):
    assert say(device, ":Interlock:Close 1;:Mode:Sideways 1;:Mode:Rate 1").startswith("ERROR")
    assert table.calls == []


def test_where_only_queries_answer(table):
    device = SimulatedAcutronicAcl(simpy.Environment(), table, {"answers_commands": False})
    assert say(device, ":Interlock:Close 1") == ""
    assert say(device, ":Demand:Rate 1,9999") == ""
    assert say(device, ":Interlock? 1") == "Close\r\n"


def test_prefixed_answers(table):
    device = SimulatedAcutronicAcl(simpy.Environment(), table, {}, prefixed=True)
    assert say(device, ":Interlock:Close 1") == "\0\0\0\0\0\0\0\4OK\r\n"
    assert say(device, ":Foo 1").startswith("\0\0\0\1\0\0\0")


@given(
    st.lists(st.one_of(st.binary(max_size=40), st.text("*:;?,. 1IDNRAMPO\n", max_size=40).map(str.encode)), max_size=6)
)
def test_arbitrary_bytes_never_crash_it(pieces):
    device = SimulatedAcutronicAcl(simpy.Environment(), FakeTable(), {})
    for now_s, piece in enumerate([*pieces, b"\n"]):
        for _, reply in device.receive(piece, float(now_s)):
            assert reply.endswith(b"\r\n")
