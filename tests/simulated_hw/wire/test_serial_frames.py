"""The simulated serial gyro: its bytes against an independent CRC and struct, and under the real driver."""

import math
import struct
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import Any

import crccheck.crc as oracle
import numpy as np
import pytest
import serial
import simpy
from numpy.typing import NDArray

from drivers.codecs.counters import Losses
from drivers.gyros.serial_frames import SerialGyro, SerialGyroSettings
from drivers.ports import open_byte_source
from simulated_hw.wire import serial_frames as wire
from simulated_hw.wire import switchboard
from simulated_hw.wire.serial_frames import SimulatedSerialGyro
from simulated_hw.wire.serial_port import SimulatedSerial


@dataclass(frozen=True)
class Block:
    rate_dps: NDArray[np.float64]
    temperature_degc: NDArray[np.float64]
    good: NDArray[np.bool_]


class Gyro:
    """A gyro whose frame k turns at k/8 deg/s at -30 + k/100 degC and is bad for its first five frames."""

    def __init__(self, data_rate_hz: float = 100.0) -> None:
        self.data_rate_hz = data_rate_hz
        self.made: list[tuple[int, int]] = []

    def frames_until(self, now_s: float) -> int:
        return math.floor(now_s * self.data_rate_hz + 1e-6)

    def block(self, first: int, end: int) -> Block:
        self.made.append((first, end))
        numbers = np.arange(first, end, dtype=np.float64)
        return Block(numbers / 8.0, -30.0 + numbers / 100.0, numbers >= 5)


def simulated(gyro: Gyro, **settings: Any) -> SimulatedSerialGyro:
    declared = SerialGyroSettings(**{"frame": "kvh_36_c100", **settings})
    return SimulatedSerialGyro(simpy.Environment(), gyro, asdict(declared))


def test_every_byte_of_a_kvh_frame() -> None:
    data = simulated(Gyro()).bytes_until(1.4)
    assert len(data) == 140 * 36
    for number in (0, 4, 5, 127, 128, 139):
        frame = data[36 * number : 36 * number + 36]
        assert frame[:4].hex() == "fe81ff55"
        x, y, z, ax, ay, az, status, sequence, temperature = struct.unpack(">6fBBh", frame[4:32])
        assert x == np.float32(math.radians(number / 8.0) / 100.0)
        assert (y, z, ax, ay, az) == (0.0,) * 5
        assert (status, sequence, temperature) == (0x77 if number >= 5 else 0x76, number % 128, -3000 + number)
        assert oracle.Crc32Mpeg2.calc(frame) == 0


class Two(Gyro):
    """The same gyro with a second axis and a temperature of its case."""

    def block(self, first: int, end: int) -> Any:
        block = super().block(first, end)
        channels = {
            "rate_y_dps": -block.rate_dps,
            "case_degc": np.full(end - first, 31.25),
            "unheard_v": block.rate_dps,
        }
        return SimpleNamespace(**vars(block), channels=channels)


TWO = {
    "base": "kvh_36_c100",
    "channels": {"rate_y_dps": {"field": "y_rotation", "scale": 10}, "case_degc": {"field": "z_rotation"}},
}


def test_channels_travel_with_the_frame() -> None:
    settings = SerialGyroSettings(frame=TWO)
    batch = SerialGyro(Bytes(simulated(Two(), frame=TWO).bytes_until(3.0)), settings).take()
    assert batch.channels.keys() == {"rate_y_dps", "case_degc"}
    assert batch.channels["rate_y_dps"] == pytest.approx(-np.arange(300) / 8.0, rel=1e-7)
    assert (batch.channels["case_degc"] == 31.25).all()
    assert batch.rate_dps == pytest.approx(np.arange(300) / 8.0, rel=1e-7)


def test_channels_without_physics_are_zero_and_physics_without_channels_is_unheard() -> None:
    batch = SerialGyro(Bytes(simulated(Gyro(), frame=TWO).bytes_until(1.0)), SerialGyroSettings(frame=TWO)).take()
    assert (batch.channels["rate_y_dps"] == 0.0).all() and batch.index[-1] == 99
    assert simulated(Two()).bytes_until(1.0) == simulated(Gyro()).bytes_until(1.0)


def test_the_declaration_decides_what_is_sent() -> None:
    frame = {"base": "kvh_36", "rate": {"kind": "rate", "unit": "deg"}}
    data = simulated(Gyro(), frame=frame).bytes_until(1.0)
    assert struct.unpack(">f", data[36 * 80 + 4 : 36 * 80 + 8]) == (10.0,)
    assert struct.unpack(">h", data[36 * 80 + 30 : 36 * 80 + 32]) == (-29,)


def test_frames_are_made_once_in_slices_and_skipped_ones_never(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wire, "SLICE_FRAMES", 64)
    gyro = Gyro()
    instrument = simulated(gyro)
    assert instrument.bytes_until(0.0) == b""
    instrument.skip_until(3600.0)
    assert gyro.made == []
    whole = instrument.bytes_until(3601.5)
    assert gyro.made == [(360_000, 360_064), (360_064, 360_128), (360_128, 360_150)]
    assert instrument.bytes_until(3601.5) == b""
    instrument.skip_until(0.0)
    assert len(instrument.bytes_until(3601.6)) == 36 * 10
    assert [whole[36 * at + 29] for at in range(150)] == [(360_000 + at) % 128 for at in range(150)]


@pytest.fixture
def attached() -> Iterator[tuple[simpy.Environment, Gyro]]:
    env, gyro = simpy.Environment(), Gyro()
    settings = asdict(SerialGyroSettings(frame="kvh_36_c100"))
    switchboard.attach("sim://test-serial-frames", SimulatedSerialGyro(env, gyro, settings))
    yield env, gyro
    switchboard.detach("sim://test-serial-frames")


def test_the_real_driver_reads_it_through_a_port(attached: tuple[simpy.Environment, Gyro]) -> None:
    env, gyro = attached
    port = SimulatedSerial("sim://test-serial-frames", baudrate=921_600, timeout=0.0)
    driver = SerialGyro(open_byte_source(port, lambda: float(env.now)), SerialGyroSettings(frame="kvh_36_c100"))
    env.run(until=10.0)
    batch = driver.take()
    assert batch.index.tolist() == list(range(1000))
    assert batch.rate_dps == pytest.approx(np.arange(1000) / 8.0, rel=1e-7)
    assert batch.temperature_degc == pytest.approx(-30.0 + np.arange(1000) / 100.0, abs=1e-9)
    assert batch.good.tolist() == [False] * 5 + [True] * 995
    env.run(until=7200.0)
    driver.discard()
    env.run(until=7260.0)
    assert driver.take().rate_dps[[0, -1]] == pytest.approx([720_000 / 8.0, 725_999 / 8.0])
    assert gyro.made == [(0, 1000), (720_000, 726_000)]
    assert driver.losses == Losses(frames=7000, bad_status=5)
    assert driver.complaint() is None


def test_at_the_wrong_baud_rate_the_driver_says_what_it_sees(attached: tuple[simpy.Environment, Gyro]) -> None:
    env, _ = attached
    port = SimulatedSerial("sim://test-serial-frames", baudrate=460_800, timeout=0.0)
    driver = SerialGyro(open_byte_source(port, lambda: float(env.now)), SerialGyroSettings(baud=460_800))
    env.run(until=1.0)
    assert len(driver.take()) == 0
    complaint = driver.complaint()
    assert complaint is not None and complaint.startswith(
        "3600 bytes received since the last valid frame, no frame with"
    )


def test_every_packaged_frame_survives_the_way_through_driver_and_simulator() -> None:
    for frame in ("kvh_36", "kvh_36_c100", "stim300_rate_temperature", "example_eb90", "ring_laser_3t", "fog_angle"):
        settings = SerialGyroSettings(frame=frame)
        instrument = SimulatedSerialGyro(simpy.Environment(), Gyro(), asdict(settings))
        source = Bytes(instrument.bytes_until(30.0))
        batch = SerialGyro(source, settings).take()
        assert batch.index.tolist() == list(range(3000))
        scale = {"stim300_rate_temperature": 2.0**-14, "example_eb90": 1e-6}.get(frame, 1e-4)
        assert batch.rate_dps == pytest.approx(np.arange(3000) / 8.0, abs=scale)
        step = {"kvh_36": 1.0, "stim300_rate_temperature": 2.0**-8}.get(frame, 0.01)
        assert batch.temperature_degc == pytest.approx(-30.0 + np.arange(3000) / 100.0, abs=step / 2 + 1e-9)
        assert batch.good.tolist() == [False] * 5 + [True] * 2995


class Bytes:
    name = "test"

    def __init__(self, data: bytes) -> None:
        self._data = data

    def take(self) -> tuple[bytes, float]:
        return self._data, 30.0

    def discard(self) -> None: ...
    def close(self) -> None: ...


def test_the_handler_opens_it_by_url(attached: tuple[simpy.Environment, Gyro]) -> None:
    import simulated_hw.wire.protocol_sim  # noqa: F401 - an ImportError would be hidden by serial_for_url

    serial.protocol_handler_packages.append("simulated_hw.wire")
    try:
        with serial.serial_for_url("sim://test-serial-frames", baudrate=921_600, timeout=1.0) as port:
            assert port.read(72)[::36] == b"\xfe\xfe"
    finally:
        serial.protocol_handler_packages.remove("simulated_hw.wire")
    assert attached[0].now == pytest.approx(0.02, abs=2e-3)
