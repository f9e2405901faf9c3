"""The simulated CAN gyro: its payloads against cantools."""

import math
from dataclasses import asdict
from importlib import resources
from types import SimpleNamespace
from typing import Any

import cantools
import numpy as np
import pytest
import simpy

from drivers.gyros.can_dbc import CanGyroSettings
from simulated_hw.wire.can_dbc import SimulatedCanGyro

DBC = resources.files("drivers").joinpath("gyros", "frames", "fog_gyro.dbc").read_text()


class Gyro:
    """Frame k turns at -k/8 deg/s at k/100 degC; every seventh is bad."""

    data_rate_hz = 100.0

    def frames_until(self, now_s: float) -> int:
        return math.floor(now_s * self.data_rate_hz + 1e-6)

    def block(self, first: int, end: int) -> Any:
        numbers = np.arange(first, end, dtype=np.float64)
        return SimpleNamespace(rate_dps=-numbers / 8.0, temperature_degc=numbers / 100.0, good=numbers % 7 != 0)


def simulated(**settings: Any) -> SimulatedCanGyro:
    return SimulatedCanGyro(simpy.Environment(), Gyro(), asdict(CanGyroSettings(**settings)))


def test_payloads_are_what_cantools_reads_in_the_dbc() -> None:
    message = cantools.database.load_string(DBC, "dbc").get_message_by_name("GyroFrame")
    gyro = simulated()
    assert (gyro.can_id, gyro.length, gyro.frames_until(2.5)) == (0x1A0, 8, 250)
    for number, row in enumerate(gyro.payload(200, 300), 200):
        assert message.decode(row.tobytes()) == {
            "rate": -number / 8.0,
            "temperature": pytest.approx(number / 100.0),
            "counter": number % 256,
            "status": 0xFF if number % 7 == 0 else 0,
        }


def test_any_dbc_and_any_settings(tmp_path: Any) -> None:
    """An integer in rad/s, big-endian, in four bits less than a byte's end; no status; a counter of four bits."""
    path = tmp_path / "lab.dbc"
    path.write_text(
        "BU_: X\nBO_ 290 Gyro: 7 X\n"
        ' SG_ z : 3|20@0- (0.0001,0) [0|0] "rad/s" X\n'
        ' SG_ t : 32|8@1+ (1,-50) [0|0] "degC" X\n'
        ' SG_ n : 40|4@1+ (1,0) [0|0] "" X\n'
    )
    settings = {"dbc": str(path), "rate": "z", "temperature": "t", "counter": "n", "status": None, "can_id": 0x18FF0001}
    gyro = SimulatedCanGyro(simpy.Environment(), Gyro(), {**settings, "data_rate_hz": 100.0})
    assert (gyro.can_id, gyro.length) == (0x98FF0001, 7)
    message = cantools.database.load_file(path).get_message_by_name("Gyro")
    for number, row in enumerate(gyro.payload(0, 50)):
        decoded: dict[str, Any] = message.decode(row.tobytes()[:7])  # type: ignore[assignment]
        assert decoded["z"] == pytest.approx(math.radians(-number / 8.0), abs=0.51e-4)
        assert decoded["t"] == round(number / 100.0)
        assert decoded["n"] == number % 16


def test_channels_are_signals_of_the_message(tmp_path: Any) -> None:
    path = tmp_path / "two.dbc"
    path.write_text(
        "BU_: X\nBO_ 290 Gyro: 6 X\n"
        ' SG_ x : 0|16@1- (0.01,0) [0|0] "deg/s" X\n'
        ' SG_ y : 16|16@1- (0.01,0) [0|0] "deg/s" X\n'
        ' SG_ case : 32|16@1- (0.01,0) [0|0] "degC" X\n'
    )

    class Two(Gyro):
        def block(self, first: int, end: int) -> Any:
            block = super().block(first, end)
            return SimpleNamespace(**vars(block), channels={"rate_y_dps": 2.0 * block.rate_dps})

    names = {"rate": "x", "temperature": None, "counter": None, "status": None}
    channels = {"rate_y_dps": "y", "case_degc": "case"}
    gyro = SimulatedCanGyro(simpy.Environment(), Two(), {"dbc": str(path), **names, "channels": channels})
    message = cantools.database.load_file(path).get_message_by_name("Gyro")
    for number, row in enumerate(gyro.payload(0, 50)):
        decoded: dict[str, Any] = message.decode(row.tobytes()[:6])  # type: ignore[assignment]
        assert decoded["y"] == pytest.approx(-number / 4.0)
        assert (decoded["x"], decoded["case"]) == (pytest.approx(-number / 8.0, abs=0.0051), 0.0)


def test_several_gyros_on_a_channel_need_their_own_identifiers() -> None:
    first, second = simulated(), simulated(can_id=0x1A1)
    first.join(second)
    assert first.nodes == (first, second)
    with pytest.raises(ValueError, match=r"two gyros send id 1A1 on one channel.*setting can_id"):
        first.join(simulated(can_id=0x1A1))
