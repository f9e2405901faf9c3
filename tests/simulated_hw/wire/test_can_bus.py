"""The virtual CAN bus under python-can and under the real driver; batches against single messages."""

import math
from collections.abc import Iterator
from dataclasses import asdict
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest
import simpy

from drivers.can_ports import BatchCanSource, ThreadedCanSource, open_can, open_can_source
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses
from drivers.gyros.can_dbc import CanGyro, CanGyroSettings
from simulated_hw.wire import can_bus, switchboard
from simulated_hw.wire.can_bus import SimulatedCanBus
from simulated_hw.wire.can_dbc import SimulatedCanGyro

CHANNEL = "test-can-bus"


class Gyro:
    """Frame k turns at k deg/s."""

    def __init__(self, data_rate_hz: float) -> None:
        self.data_rate_hz = data_rate_hz
        self.made: list[tuple[int, int]] = []

    def frames_until(self, now_s: float) -> int:
        return math.floor(now_s * self.data_rate_hz + 1e-6)

    def block(self, first: int, end: int) -> Any:
        self.made.append((first, end))
        numbers = np.arange(first, end, dtype=np.float64)
        return SimpleNamespace(rate_dps=numbers, temperature_degc=numbers / 100.0, good=numbers >= 0)


@pytest.fixture
def bench() -> Iterator[tuple[simpy.Environment, Gyro, Gyro]]:
    """Two gyros on one channel: 1A0 at 100 Hz, 1A1 (29 bits) at 250 Hz."""
    env, slow, fast = simpy.Environment(), Gyro(100.0), Gyro(250.0)
    node = SimulatedCanGyro(env, slow, asdict(CanGyroSettings()))
    node.join(SimulatedCanGyro(env, fast, asdict(CanGyroSettings(can_id=0x18FF01A1, data_rate_hz=250.0))))
    switchboard.attach(f"can:{CHANNEL}", node)
    yield env, slow, fast
    switchboard.detach(f"can:{CHANNEL}")


def test_python_can_finds_it_by_its_interface_and_waits_in_virtual_time(bench: Any) -> None:
    env, *_ = bench
    with can.Bus(CHANNEL, "fogsim", can_filters=[{"can_id": 0x1A0, "can_mask": 0x7FF, "extended": False}]) as bus:
        assert isinstance(bus, SimulatedCanBus)
        message = bus.recv(timeout=5.0)
        assert message is not None and env.now == pytest.approx(0.01, abs=2e-6)
        assert (message.arbitration_id, message.is_extended_id, message.dlc) == (0x1A0, False, 8)
        assert message.timestamp == pytest.approx(0.01)
        assert np.frombuffer(bytes(message.data[:4]), "<f4")[0] == 0.0
        assert bus.recv(timeout=0) is None
        before = env.now
        assert bus.recv(timeout=0.004) is None
        assert env.now == before + 0.004
        assert bus.recv() is not None and env.now == pytest.approx(0.02, abs=2e-6)
        env.run(until=3.0)
        rates = [np.frombuffer(bytes(message.data[:4]), "<f4")[0] for message in iter(lambda: bus.recv(0), None)]
        assert rates == list(range(2, 300))
        assert env.now == 3.0


def test_messages_of_several_gyros_come_in_order_one_by_one_and_in_batches(
    bench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    env, *_ = bench
    monkeypatch.setattr(can_bus, "_QUEUED", 7)
    monkeypatch.setattr(can_bus, "SLICE_FRAMES", 16)
    single, batch, mixed = (can.Bus(CHANNEL, "fogsim") for _ in range(3))
    assert isinstance(batch, SimulatedCanBus) and isinstance(mixed, SimulatedCanBus)
    env.run(until=2.0)
    messages = list(iter(lambda: single.recv(0), None))
    assert len(messages) == 200 + 500
    stamps = [message.timestamp for message in messages]
    assert stamps == sorted(stamps)
    seen = [(message.arbitration_id | message.is_extended_id << 31, bytes(message.data)) for message in messages]
    first = [mixed.recv(0) for _ in range(5)]
    assert [one and bytes(one.data) for one in first] == [data for _, data in seen[:5]]
    for bus, skipped in ((batch, 0), (mixed, 5)):
        ids, payload, lengths = bus.recv_batch()
        assert [(number, row.tobytes()) for number, row in zip(ids.tolist(), payload, strict=True)] == seen[skipped:]
        assert (ids.dtype, payload.dtype, payload.shape[1]) == (np.uint32, np.uint8, 8)
        assert (lengths == 8).all() and payload.flags.c_contiguous
        assert [len(part) for part in bus.recv_batch()] == [0, 0, 0]


def test_a_gyro_whose_clock_is_off_is_read_in_order_after_a_week(monkeypatch: pytest.MonkeyPatch) -> None:
    """50 ppm are 30 s after a week: messages must not be looked for when the declared data rate says."""
    monkeypatch.setattr(can_bus, "_QUEUED", 7)
    env = simpy.Environment()
    node = SimulatedCanGyro(env, Gyro(100.0 * (1.0 + 50e-6)), asdict(CanGyroSettings()))
    node.join(SimulatedCanGyro(env, Gyro(100.0 * (1.0 - 50e-6)), asdict(CanGyroSettings(can_id=0x1A1))))
    monkeypatch.setitem(switchboard._attached, "can:off-clock", node)
    env.run(until=600_000.0)
    single, batch = SimulatedCanBus("off-clock"), SimulatedCanBus("off-clock")
    waited = []
    for _ in range(20):
        message = single.recv(timeout=1.0)
        assert message is not None and message.timestamp == pytest.approx(env.now, abs=1e-4)
        waited.append(message)
    env.run(until=600_001.0)
    waited += list(iter(lambda: single.recv(0), None))
    ids, payload, _ = batch.recv_batch()
    assert ids.tolist() == [message.arbitration_id for message in waited]
    assert payload.tobytes() == b"".join(bytes(message.data) for message in waited)
    assert len(ids) in (199, 200, 201)


def test_only_what_passes_the_filter_is_ever_made(bench: Any) -> None:
    env, slow, fast = bench
    bus = open_can("fogsim", CHANNEL, 1_000_000, 0x18FF01A1)
    source = open_can_source(bus, lambda: float(env.now))
    assert isinstance(source, BatchCanSource) and source.name == f"can:{CHANNEL}"
    env.run(until=1000.0)
    source.discard()
    env.run(until=1060.0)
    ids, payload, lengths, stamp = source.take()
    assert set(ids.tolist()) == {0x98FF01A1} and len(payload) == len(lengths) == 15_000
    assert (slow.made, fast.made[0][0], fast.made[-1][1], stamp) == ([], 250_000, 265_000, 1060.0)
    assert max(end - first for first, end in fast.made) <= can_bus.SLICE_FRAMES
    source.close()


def test_the_driver_gets_the_same_by_batches_and_by_messages(bench: Any) -> None:
    env, *_ = bench
    settings = CanGyroSettings()

    class OneByOne:
        """The bus without its batches, as any other python-can bus."""

        def __init__(self, bus: can.BusABC) -> None:
            self.bus, self.channel_info = bus, bus.channel_info

        def take(self) -> Any:
            records = list(iter(lambda: self.bus.recv(0), None))
            ids = np.array([one.arbitration_id | one.is_extended_id << 31 for one in records], np.uint32)
            payload = np.frombuffer(b"".join(bytes(one.data) for one in records), np.uint8).reshape(-1, 8)
            return ids, payload, np.array([one.dlc for one in records], np.uint8), float(env.now)

        name, discard, close = "one by one", lambda self: None, lambda self: None

    batches = CanGyro(open_can_source(can.Bus(CHANNEL, "fogsim"), lambda: float(env.now)), settings)
    singles = CanGyro(OneByOne(can.Bus(CHANNEL, "fogsim")), settings)
    both: tuple[list[FrameBatch], list[FrameBatch]] = ([], [])
    for until in (0.5, 0.504, 7.0):
        env.run(until=until)
        both[0].append(batches.take())
        both[1].append(singles.take())
    one, other = map(FrameBatch.concat, both)
    assert len(one) == 700 and one.rate_dps.tolist() == list(range(700))
    for name in one.columns:
        assert one.columns[name].tobytes() == other.columns[name].tobytes()
    for name in ("index", "rate_dps", "temperature_degc", "good"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert batches.losses == singles.losses == Losses(frames=700)


def test_a_bus_hears_what_is_sent_after_it_was_opened_and_filters_can_change(bench: Any) -> None:
    env, *_ = bench
    env.run(until=100.0)
    with SimulatedCanBus(CHANNEL) as bus:
        env.run(until=100.1)
        assert len(bus.recv_batch()[0]) == 10 + 25
        bus.set_filters([{"can_id": 0x1A0, "can_mask": 0x1FFFFFFF, "extended": False}])
        env.run(until=100.2)
        assert len(bus.recv_batch()[0]) == 10
        bus.send(can.Message(arbitration_id=1, data=b"no effect"[:8]))
        bus.set_filters([{"can_id": 0x7FF, "can_mask": 0x7FF, "extended": False}])
        assert bus.recv(timeout=1.0) is None
        assert env.now == pytest.approx(101.2)
        with pytest.raises(can.CanOperationError, match="nothing passes the filters"):
            bus.recv()


def test_no_such_channel(bench: Any) -> None:
    with pytest.raises(can.CanInitializationError, match=r"no simulated instrument at can:elsewhere; this world has"):
        can.Bus("elsewhere", "fogsim")
    switchboard.attach("can:no-gyro", bench[1])
    try:
        with pytest.raises(can.CanInitializationError, match="can:no-gyro is no CAN instrument"):
            can.Bus("no-gyro", "fogsim")
    finally:
        switchboard.detach("can:no-gyro")


def test_the_reader_thread_is_not_used_for_it(bench: Any) -> None:
    assert not isinstance(open_can_source(can.Bus(CHANNEL, "fogsim"), lambda: 0.0), ThreadedCanSource)
