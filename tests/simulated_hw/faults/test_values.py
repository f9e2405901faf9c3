"""Lying outputs: they pass every check of the wire, and are what the log says."""

from pathlib import Path

import numpy as np
import serial

from drivers.codecs.batch import FrameBatch
from drivers.gyros.serial_frames import SerialGyro, SerialGyroSettings
from drivers.ports import open_byte_source
from simulated_hw.physics.gyro import GyroBlock
from tests.simulated_hw.faults.test_frames import listen
from tests.simulated_hw.faults.worlds import can_gyro, fault, serial_gyro, truth_of, world


def test_a_frozen_gyro_repeats_its_rate_and_nothing_else(tmp_path: Path) -> None:
    with world(fault("frozen", "S", at_s=10.0, for_s=5.0), truth=tmp_path) as bench:
        gyro = serial_gyro(bench)
        frames = FrameBatch.concat(listen(gyro, bench, 20.0, 0.7))
    rate, counter = frames.columns["rate"], frames.columns["counter"].astype(int)
    assert len(frames) == 2000 and gyro.losses.lost == 0 and frames.good.all()
    assert (rate[1000:1500] == rate[1000]).all()
    # white noise of a few counts of the angle's resolution
    assert len(set(rate[:1000].tolist())) > 4 and len(set(rate[1500:].tolist())) > 4
    assert np.array_equal(np.diff(counter) % 128, np.ones(1999))
    (record,) = truth_of(tmp_path)
    assert (record["frame"], record["frames"], record["fault"]) == (1000, 500, "frozen")


def test_spikes_are_where_the_log_says_and_nowhere_else(tmp_path: Path) -> None:
    spikes = [fault("spike", on, probability=2e-3, size_dps=50.0) for on in ("S", "C")]
    with world(*spikes, truth=tmp_path) as bench:
        gyros = {"S": serial_gyro(bench), "C": can_gyro(bench)}
        for on, gyro in gyros.items():
            frames = FrameBatch.concat(listen(gyro, bench, bench.env.now + 100.0, 3.0))
            gyros[on] = frames
    for on, frames in gyros.items():
        off = np.flatnonzero(np.abs(frames.rate_dps) > 40.0)
        logged = [r["frame"] + i for r in truth_of(tmp_path) if r["instrument"] == on for i in range(r["frames"])]
        first = logged[0] - off[0]
        assert len(off) > 5 and (off + first).tolist() == logged
        assert {-1.0, 1.0} == set(np.sign(frames.rate_dps[off]))
        assert np.abs(np.abs(frames.rate_dps[off]) - 50.0).max() < 5.0


def test_a_healthy_gyro_beside_a_sick_one_is_untouched() -> None:
    def healthy(*faults) -> bytes:
        with world(*faults) as bench:
            return FrameBatch.concat(listen(can_gyro(bench), bench, 50.0, 5.0)).rate_dps.tobytes()

    assert healthy() == healthy(fault("frozen", "S"), fault("loss", "S", probability=0.1))


def test_channels_come_through_a_lying_output_and_a_damaged_line() -> None:
    frame = {"base": "kvh_36_c100", "channels": {"case_degc": {"field": "y_rotation"}}}
    faults = [fault("frozen", "S", at_s=1.0, for_s=1.0), fault("loss", "S", probability=0.05)]
    with world(*faults, frame=frame) as bench:
        honest = bench.gyros["S"].block

        def with_channel(first: int, end: int) -> GyroBlock:
            block = honest(first, end)
            numbers = np.arange(first, end, dtype=np.float64)
            return GyroBlock(block.rate_dps, block.temperature_degc, block.good, {"case_degc": numbers})

        bench.gyros["S"].block = with_channel  # type: ignore[method-assign]
        gyro = SerialGyro(
            open_byte_source(serial.serial_for_url("sim://s", baudrate=921600, timeout=0), lambda: bench.env.now),
            SerialGyroSettings(frame=frame),
        )
        frames = FrameBatch.concat(listen(gyro, bench, 5.0, 0.7))
    assert 430 < len(frames) < 500 and gyro.losses.lost > 5
    assert frames.channels["case_degc"].tolist() == frames.index.tolist()
