"""The CAN gyro driver: over a scripted source, and over python-can message by message against whole batches."""

import threading
from dataclasses import fields
from typing import Any

import can
import numpy as np
import pytest

from drivers.can_ports import ThreadedCanSource, open_can
from drivers.codecs.batch import FrameBatch
from drivers.codecs.can_frames import CanDecoder
from drivers.codecs.can_spec import DEFAULTS, CanSpec
from drivers.codecs.counters import Losses
from drivers.gyros.can_dbc import CanGyro, CanGyroSettings

SPEC = CanSpec.from_settings({})


def payload(*numbers: int) -> Any:
    columns: dict[str, Any] = {
        "rate": np.array(numbers, np.float32),
        "temperature": np.array(numbers, np.int16),
        "counter": np.array(numbers) % 256,
        "status": 0,
    }
    return SPEC.encode(columns, len(numbers))


class Script:
    """A CanSource that hands out what a test puts in."""

    name = "can:gyro-b"

    def __init__(self) -> None:
        self.waiting: list[tuple[int, bytes]] = []
        self.now_s = 0.0

    def arrive(self, now_s: float, *numbers: int, can_id: int = 0x1A0, length: int = 8) -> None:
        self.waiting += [(can_id, row.tobytes()[:length]) for row in payload(*numbers)] if numbers else []
        self.now_s = now_s

    def take(self) -> Any:
        waiting, self.waiting = self.waiting, []
        rows = np.frombuffer(b"".join(row.ljust(8, b"\0") for _, row in waiting), np.uint8).reshape(-1, 8)
        lengths = np.array([len(row) for _, row in waiting], np.uint8)
        return np.array([number for number, _ in waiting], np.uint32), rows, lengths, self.now_s

    def discard(self) -> None:
        self.waiting = []

    def close(self) -> None:
        pass


@pytest.fixture
def source() -> Script:
    return Script()


def test_frames_in_engineering_units(source: Script) -> None:
    driver = CanGyro(source, CanGyroSettings())
    source.arrive(0.02, 3, 4)
    batch = driver.take()
    assert (batch.rate_dps.tolist(), batch.index.tolist()) == ([3.0, 4.0], [3, 4])
    assert batch.temperature_degc == pytest.approx([0.03, 0.04])
    assert driver.losses == Losses(frames=2)
    assert driver.describe() == "CAN message GyroFrame (id 1A0), 100 Hz, on can:gyro-b"
    assert driver.complaint() is None
    for name, law in driver.meaning.quantities.items():
        value = {"rate": batch.rate_dps, "temperature": batch.temperature_degc}[name]
        assert (batch.columns[name].astype(np.float64) * law.scale + law.offset).tolist() == value.tolist()


def test_discard_leaves_no_loss(source: Script) -> None:
    driver = CanGyro(source, CanGyroSettings())
    source.arrive(0.02, 3, 4)
    driver.take()
    source.arrive(0.3, *range(5, 30))
    driver.discard()
    source.arrive(0.5, *range(30, 50))
    assert driver.take().rate_dps.tolist() == list(range(30, 50))
    assert driver.losses == Losses(frames=22)


def test_complaints(source: Script) -> None:
    driver = CanGyro(source, CanGyroSettings(can_id=0x1A5))
    driver.discard()
    source.arrive(2.0)
    driver.take()
    assert "nothing received for 2 s with id 1A5. Is the gyro powered, are bitrate" in (driver.complaint() or "")
    source.arrive(2.1, 1, 2, can_id=0x1A0)
    source.arrive(2.1, 1, 2, can_id=0x9CF02A80)
    driver.take()
    assert driver.complaint() == "messages with id 1A0, 1CF02A80 received, none with 1A5: is can_id right?"
    driver.discard()
    source.arrive(2.2, 1, 2, can_id=0x1A5, length=6)
    driver.take()
    assert "messages with id 1A5 have fewer than the 8 bytes of the DBC" in (driver.complaint() or "")
    assert driver.losses == Losses(skipped_bytes=12)
    source.arrive(2.3, 3, can_id=0x1A5)
    driver.take()
    assert driver.complaint() is None


def test_message_by_message_is_the_same_as_in_batches() -> None:
    """python-can's own bus and the reader thread on one side, arrays on the other: same frames, same losses."""
    numbers = [*range(90), *range(95, 200), 199, *range(200, 300)]
    rows = payload(*numbers)
    ids, lengths = np.full(len(rows), 0x1A0, np.uint32), np.full(len(rows), 8, np.uint8)
    decoder = CanDecoder(SPEC, 100.0)
    expected = decoder.feed(ids, rows, lengths)

    with can.Bus("test-can-gyro", "virtual") as sender:
        source = ThreadedCanSource(
            open_can("virtual", "test-can-gyro", None, CanGyro.can_id(CanGyroSettings())), lambda: 0.0
        )
        driver = CanGyro(source, CanGyroSettings())
        batches = []
        pause = threading.Event()
        for at, row in enumerate(rows):
            sender.send(can.Message(arbitration_id=0x1A0, data=row.tobytes(), is_extended_id=False))
            sender.send(can.Message(arbitration_id=0x1A1, data=bytes(8), is_extended_id=False))
            if at % 50 == 0:
                batches.append(driver.take())
        for _ in range(1000):
            if sum(map(len, batches)) >= len(expected):
                break
            pause.wait(0.005)
            batches.append(driver.take())
        source.close()
    received = FrameBatch.concat(batches)
    assert received.columns.keys() == expected.columns.keys()
    for name in expected.columns:
        assert received.columns[name].tobytes() == expected.columns[name].tobytes()
    for field in ("index", "rate_dps", "temperature_degc", "good"):
        assert getattr(received, field).tobytes() == getattr(expected, field).tobytes()
    assert driver.losses == decoder.losses == Losses(frames=295, lost=5, duplicates=1)


def test_wrong_settings() -> None:
    with pytest.raises(ValueError, match="data_rate: -1 Hz is not allowed"):
        CanGyroSettings(data_rate_hz=-1.0)
    with pytest.raises(ValueError, match=r"dbc 'fog_gyro': rate: there is no signal 'rat'.*Did you mean rate\?"):
        CanGyroSettings(rate="rat")


def test_defaults_are_those_of_the_simulator() -> None:
    """The simulator reads the same mapping and may not import the driver."""
    assert CanGyro.Settings is CanGyroSettings
    defaults = CanGyroSettings()
    names = [field.name for field in fields(CanGyroSettings) if field.name != "data_rate_hz"]
    assert {name: getattr(defaults, name) for name in names} == dict(DEFAULTS)
