"""CAN buses: python-can's own virtual bus behind the reader thread, and what goes wrong."""

import itertools
import threading
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from drivers.can_ports import (
    BatchCanSource,
    Messages,
    ThreadedCanSource,
    open_can,
    open_can_source,
)
from drivers.errors import PortError

_channels = itertools.count()


@pytest.fixture
def pair() -> Iterator[tuple[can.BusABC, str]]:
    """A sender, and the channel it sends on."""
    channel = f"test-can-ports-{next(_channels)}"
    with can.Bus(channel, "virtual") as sender:
        yield sender, channel


def collect(source: ThreadedCanSource, count: int) -> Messages:
    """Take until so many messages are there."""
    parts: list[Messages] = []
    pause = threading.Event()
    for _ in range(1000):
        if sum(len(part[0]) for part in parts) >= count:
            break
        pause.wait(0.005)
        parts.append(source.take())
    ids, payloads, lengths = (np.concatenate([part[at] for part in parts]) for at in range(3))
    return ids, payloads, lengths, parts[-1][3]


def until(condition: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(1000):
        if condition():
            return
        pause.wait(0.005)
    raise AssertionError("it never happened")


def test_messages_come_as_arrays(pair: tuple[can.BusABC, str]) -> None:
    sender, channel = pair
    source = open_can_source(open_can("virtual", channel, 500_000), lambda: 12.5)
    assert isinstance(source, ThreadedCanSource)
    sender.send(can.Message(arbitration_id=0x1A0, data=bytes(range(8)), is_extended_id=False))
    sender.send(can.Message(arbitration_id=0x1A0, data=b"\xaa\xbb", is_extended_id=True))
    sender.send(can.Message(arbitration_id=0x1A1, is_remote_frame=True, dlc=4, is_extended_id=False))
    sender.send(can.Message(is_error_frame=True))
    sender.send(can.Message(arbitration_id=0x7FF, data=b"", is_extended_id=False))
    ids, payload, lengths, stamp = collect(source, 3)
    assert ids.tolist() == [0x1A0, 0x800001A0, 0x7FF]
    assert payload.tolist() == [list(range(8)), [0xAA, 0xBB, 0, 0, 0, 0, 0, 0], [0] * 8]
    assert lengths.tolist() == [8, 2, 0]
    assert (ids.dtype, payload.dtype, lengths.dtype, stamp) == (np.uint32, np.uint8, np.uint8, 12.5)
    assert payload.flags.c_contiguous and channel in source.name
    source.close()


@pytest.mark.parametrize(("wanted", "extended"), [(0x1A1, False), (0x1A1 | 1 << 31, True), (0x18FF0123, True)])
def test_the_filter_lets_one_identifier_through(pair: tuple[can.BusABC, str], wanted: int, extended: bool) -> None:
    sender, channel = pair
    number = wanted & 0x1FFFFFFF
    source = ThreadedCanSource(open_can("virtual", channel, None, wanted), lambda: 0.0)
    for other, kind in ((0x1A0, False), (number, not extended and number > 0x7FF), (number, extended), (0x1A2, False)):
        sender.send(can.Message(arbitration_id=other, data=b"\x01", is_extended_id=kind))
    ids, *_ = collect(source, 1)
    assert set((ids & 0x1FFFFFFF).tolist()) == {number}
    source.close()


def test_discard_throws_away_what_came(pair: tuple[can.BusABC, str]) -> None:
    sender, channel = pair
    source = ThreadedCanSource(open_can("virtual", channel, None), lambda: 0.0)
    sender.send(can.Message(arbitration_id=1, data=b"old"))
    until(lambda: bool(source._records))
    source.discard()
    sender.send(can.Message(arbitration_id=2, data=b"new"))
    assert collect(source, 1)[0].tolist() == [2 | 1 << 31]
    source.close()


def test_an_overflow_is_said_until_discarded(pair: tuple[can.BusABC, str]) -> None:
    sender, channel = pair
    source = ThreadedCanSource(open_can("virtual", channel, None), lambda: 0.0, limit_bytes=160)
    for number in range(11):
        sender.send(can.Message(arbitration_id=number, data=b"x"))
    until(lambda: source._overflowed)
    for _ in range(2):
        with pytest.raises(PortError, match="more than 10 messages came in and nobody took them"):
            source.take()
    source.discard()
    assert len(source.take()[0]) == 0
    source.close()


def test_a_bus_that_goes_away_is_said_on_take(pair: tuple[can.BusABC, str]) -> None:
    _, channel = pair
    bus = open_can("virtual", channel, None)
    source = ThreadedCanSource(bus, lambda: 0.0)
    bus.shutdown()
    until(lambda: source._failure is not None)
    with pytest.raises(PortError, match=r"went away while reading.*Check adapter"):
        source.take()
    source.close()


def test_a_bus_that_hands_over_batches_needs_no_thread() -> None:
    class Batches:
        channel_info = "can:x"
        log: list[str] = []  # noqa: RUF012

        def recv_batch(self) -> tuple[object, object, object]:
            return "ids", "payload", "lengths"

        def discard(self) -> None:
            self.log.append("discard")

        def shutdown(self) -> None:
            self.log.append("shutdown")

    source = open_can_source(Batches(), lambda: 3.0)
    assert isinstance(source, BatchCanSource)
    assert source.take() == ("ids", "payload", "lengths", 3.0)
    source.discard()
    source.close()
    assert (source.name, Batches.log) == ("can:x", ["discard", "shutdown"])


@pytest.mark.parametrize(
    ("interface", "channel", "message"),
    [
        ("socketcan", "no-such-can7", r"port socketcan:no-such-can7: does not open: .*'ip link set no-such-can7 up"),
        ("sockecan", "can0", r"port sockecan:can0: does not open: .*Interfaces known here: .*socketcan"),
        (
            "fogsim",
            "nobody",
            r"no simulated instrument at can:nobody.*fogsim buses exist while a virtual bench is open",
        ),
    ],
)
def test_a_bus_that_does_not_open(interface: str, channel: str, message: str) -> None:
    with pytest.raises(PortError, match=message):
        open_can(interface, channel, 500_000)
