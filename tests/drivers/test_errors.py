"""Messages say what happened, where, and what to do; foreign bytes are recognised."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs import modbus_rtu
from drivers.errors import BadReply, DriverError, NoReply, PortError, Refused, looks_like, show_bytes


def test_no_reply_is_the_sentence_of_the_law():
    error = NoReply("Watlow F4 at sim://chamber", "read register 100", 1.0, 3)
    assert str(error).startswith("Watlow F4 at sim://chamber: no reply to 'read register 100' within 1 s (3 tries). ")
    assert (error.timeout_s, error.tries) == (1.0, 3)
    assert "(1 try)" in str(NoReply("x", "y", 0.5, 1))


def test_refused_takes_a_code_or_words():
    assert "refused: error 7" in str(Refused("table at COM3", ":Mode:Rate 1", 7))
    assert "refused: exception 3. Do this" in str(Refused("chamber at COM3", "write", "exception 3", "Do this"))


def test_bad_reply_shows_and_names_the_bytes():
    error = BadReply("chamber at COM3", "read register 100", b"NA:CMD ERR\r\n", "the CRC does not match")
    assert error.reply == b"NA:CMD ERR\r\n"
    assert "the CRC does not match" in str(error)
    assert "12 bytes: 4E 41 3A" in str(error)
    assert "ASCII text 'NA:CMD ERR'" in str(error)


def test_all_are_driver_errors():
    errors = [NoReply("a", "b", 1.0, 1), BadReply("a", "b", b"", "c"), Refused("a", "b", 1), PortError("a", "b")]
    assert all(isinstance(error, DriverError) for error in errors)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (bytes.fromhex("AABBFE81FF5500112233"), "KVH gyro stream"),
        (modbus_rtu.encode_request(modbus_rtu.Read(7, 100)), "Modbus RTU frame of address 7"),
        (b"\r\n25.1,30.0,150.0,-40.0\r\nmore", "ASCII text '25.1,30.0,150.0,-40.0'"),
        (b"\xff\xff\xff", "idle or short-circuited"),
        (bytes.fromhex("D5C5FEFF9BFF"), "wrong baud rate"),
    ],
)
def test_looks_like(data, what):
    assert what in looks_like(data)


@given(st.binary(max_size=100))
def test_any_bytes_can_be_shown(data):
    assert looks_like(data).startswith("which looks like")
    assert str(len(data)) in show_bytes(data) or not data
