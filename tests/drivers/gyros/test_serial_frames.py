"""The serial gyro driver over a scripted byte source."""

import re
from typing import Any

import numpy as np
import pytest

from drivers.codecs.counters import Losses
from drivers.codecs.frame_spec import FrameSpec
from drivers.codecs.frames import encode
from drivers.gyros.serial_frames import SerialGyro, SerialGyroSettings

KVH = FrameSpec.load("kvh_36")


def rows(*numbers: int) -> bytes:
    counter = np.array(numbers) % 128
    rotation = np.array(numbers, np.float32)
    return encode(
        KVH, {"x_rotation": rotation, "sequence": counter, "status": 0x77, "temperature": 25}, len(numbers)
    ).tobytes()


class Script:
    """A ByteSource that hands out what a test puts in."""

    name = "sim://gyro-a"

    def __init__(self) -> None:
        self.waiting, self.now_s, self.discarded = b"", 0.0, 0

    def arrive(self, data: bytes, now_s: float) -> None:
        self.waiting += data
        self.now_s = now_s

    def take(self) -> tuple[bytes, float]:
        data, self.waiting = self.waiting, b""
        return data, self.now_s

    def discard(self) -> None:
        self.discarded += 1
        self.waiting = b""

    def close(self) -> None:
        pass


@pytest.fixture
def source() -> Script:
    return Script()


def gyro(source: Script, **settings: Any) -> SerialGyro:
    return SerialGyro(source, SerialGyroSettings(**settings))


def test_frames_in_engineering_units(source: Script) -> None:
    driver = gyro(source)
    source.arrive(rows(3, 4), 0.02)
    batch = driver.take()
    assert batch.rate_dps == pytest.approx(np.degrees([300.0, 400.0]), rel=1e-12)
    assert batch.temperature_degc.tolist() == [25.0, 25.0]
    assert batch.good.all() and batch.index.tolist() == [3, 4]
    assert (driver.data_rate_hz, driver.losses) == (100.0, Losses(frames=2))
    assert driver.describe() == "KVH 36-byte frame, 100 Hz, on sim://gyro-a"
    assert driver.complaint() is None


def test_raw_columns_can_be_read_again_with_the_published_law(source: Script) -> None:
    driver = gyro(source, frame={"base": "kvh_36_c100", "rate": {"unit": "deg"}}, data_rate_hz=250.0)
    source.arrive(rows(*range(50)), 1.0)
    batch = driver.take()
    for name, law in driver.meaning.quantities.items():
        value = {"rate": batch.rate_dps, "temperature": batch.temperature_degc}[name]
        assert (batch.columns[name].astype(np.float64) * law.scale + law.offset).tolist() == value.tolist()
    assert driver.meaning.quantities["temperature"].value(np.array([2500])) == pytest.approx([25.0])


def test_discard_leaves_no_loss_and_starts_the_clock(source: Script) -> None:
    driver = gyro(source)
    source.arrive(rows(0, 1) + rows(2)[:20], 0.03)
    driver.take()
    source.arrive(rows(2)[20:] + rows(*range(3, 50)), 0.5)
    driver.discard()
    assert source.discarded == 1
    # 128 + 5 frames missing inside what came since the discard: only time tells
    source.arrive(rows(*range(50, 60), *range(193, 200)), 2.0)
    batch = driver.take()
    assert np.diff(batch.index).max() == 134
    assert driver.losses == Losses(frames=19, lost=133)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"TEMP 25.0\r\n" * 30, r"330 bytes received .* no frame with header FE 81 FF 55: .* ASCII text"),
        (bytes.fromhex("010302FF38F866") * 30, r"210 bytes received since the last valid frame, no frame with header"),
        (
            rows(1)[:35] * 10,
            r"header FE 81 FF 55 was found \d+ times, but never with a correct checksum \(crc32-mpeg2\)",
        ),
        (bytes(400), r"no frame with header FE 81 FF 55: .*is this the gyro's port"),
    ],
)
def test_bytes_that_are_no_frames_are_complained_about(source: Script, data: bytes, message: str) -> None:
    driver = gyro(source)
    driver.discard()
    for part in (data[:100], data[100:]):
        source.arrive(part, source.now_s + 0.5)
        assert len(driver.take()) == 0
    complaint = driver.complaint()
    assert complaint is not None
    assert re.search(message, complaint, re.IGNORECASE), complaint
    # a valid frame, and all is forgotten
    source.arrive(rows(1, 2), source.now_s)
    assert len(driver.take()) == 2
    assert driver.complaint() is None


def test_silence_and_a_wrong_pace_are_complained_about(source: Script) -> None:
    driver = gyro(source)
    driver.discard()
    source.arrive(b"", 3.0)
    driver.take()
    assert "nothing received for 3 s. Is the gyro powered" in (driver.complaint() or "")
    driver.discard()
    for second in range(4):
        source.arrive(rows(*range(second * 10, second * 10 + 10)), 4.0 + second)
        driver.take()
    assert "frames come at 10 Hz, but data_rate says 100 Hz" in (driver.complaint() or "")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"baud": 0}, "baud: 0 is not allowed"),
        ({"data_rate_hz": 0.0}, "data_rate: 0 Hz is not allowed"),
        ({"data_rate_hz": float("nan")}, "data_rate: nan Hz is not allowed"),
        ({"data_rate_hz": 5000.0}, r"data_rate: 5000 Hz of 36-byte frames needs 1800000 baud, the line has 921600"),
        ({"frame": "kvh36"}, r"Did you mean kvh_36\?"),
        ({"frame": {"base": "kvh_36", "rate": {"kind": "delta"}}}, r"rate\.kind: 'delta'"),
    ],
)
def test_wrong_settings(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SerialGyroSettings(**settings)


def test_settings_are_named_by_the_class() -> None:
    assert SerialGyro.Settings is SerialGyroSettings
