"""The serial CAN adapter: commands as in the Lawicel manual, messages as python-can reads them."""

import os
import re
import tty

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs.dbc import EXTENDED
from simulated_hw.wire.slcan import SlcanAdapter, encode_messages

MESSAGE = st.tuples(
    st.one_of(st.integers(0, 0x7FF), st.integers(EXTENDED, EXTENDED | 0x1FFFFFFF)), st.binary(min_size=0, max_size=8)
)


class FakeBus:
    """Two messages at every look, unless discarded."""

    def __init__(self):
        self.discarded = 0

    def recv_batch(self):
        ids = np.array([0x1A0, EXTENDED | 0x12345], np.uint32)
        return ids, np.arange(16, dtype=np.uint8).reshape(2, 8), np.array([8, 1], np.uint8)

    def discard(self):
        self.discarded += 1

    def shutdown(self): ...


TWO = b"t1A080001020304050607\rT00012345108\r"


def adapter(bitrate=1_000_000):
    return SlcanAdapter(FakeBus(), bitrate)


def ask(made, data):
    made.give(data)
    return made.take()


def test_nothing_comes_before_the_channel_is_open_and_all_after():
    made = adapter()
    assert ask(made, b"") == b""
    assert ask(made, b"O\r") == b"\a"  # no bit rate yet
    assert ask(made, b"S8\r") == b"\r"
    assert ask(made, b"O\r") == b"\r" + TWO
    assert made.take() == TWO
    assert ask(made, b"C\r") == b"\r"


def test_what_python_can_types_when_it_opens():
    made = adapter()
    # close, bit rate, no data bit rate, open, open again
    assert ask(made, b"C\rS8\r\rO\rO\r") == b"\a\r\r\r\a" + TWO


def test_another_bit_rate_hears_nothing():
    made = adapter(bitrate=500_000)
    assert ask(made, b"S8\rO\r") == b"\r\r"
    assert ask(made, b"C\rS6\rO\r") == b"\r\r\r" + TWO


def test_the_channel_stays_open_when_the_client_goes():
    made = adapter()
    made.give(b"S8\rO\r")
    made.discard()
    assert made.take() == TWO


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"V\r", b"V1010\r"), (b"N\r", b"NFSIM\r"), (b"F\r", b"F00\r"), (b"S6\r", b"\a"), (b"Q\r", b"\a"),
        (b"t1A02BEEF\r", b"z\r"), (b"T000123450\r", b"Z\r"), (b"t1A02BE\r", b"\a"), (b"t1A09\r", b"\a"),
        (b"t1A", b""), (b"\xff\xfe\r", b"\a"),
    ],
)  # fmt: skip
def test_commands_on_an_open_channel(command, answer):
    made = adapter()
    assert ask(made, b"S8\rO\r").startswith(b"\r\r")
    assert ask(made, command) == answer + TWO


def test_commands_may_come_in_pieces_and_garbage_is_bounded():
    made = adapter()
    assert [ask(made, piece) for piece in (b"S", b"8", b"\rO")] == [b"", b"", b"\r"]
    assert ask(made, b"\r") == b"\r" + TWO
    made.give(b"x" * 1_000_000)
    assert ask(made, b"\rV\r") == b"\aV1010\r" + TWO


@given(st.lists(MESSAGE, min_size=1, max_size=20))
def test_python_can_reads_back_every_message(messages):
    ids = np.array([number for number, _ in messages], np.uint32)
    payload = np.array([list(data.ljust(8, b"\0")) for _, data in messages], np.uint8)
    text = encode_messages(ids, payload, np.array([len(data) for _, data in messages], np.uint8))
    master, slave = os.openpty()
    tty.setraw(slave)
    bus = can.Bus(os.ttyname(slave), "slcan", ignore_config=True, sleep_after_open=0)
    try:
        os.write(master, text)
        read = [bus.recv(1.0) for _ in messages]
    finally:
        bus.shutdown()
        os.close(master)
        os.close(slave)
    assert [(m.arbitration_id | EXTENDED * m.is_extended_id, bytes(m.data)) for m in read] == messages
    assert re.fullmatch(rb"((t[0-9A-F]{4}|T[0-9A-F]{9})[0-9A-F]*\r)+", text)
