"""Faults of frames: what the real drivers count is what the log says, exactly, however the stream is read."""

from dataclasses import asdict
from pathlib import Path

import can
import numpy as np
import pytest
import serial

from drivers.codecs.batch import FrameBatch
from simulated_hw.world import World
from tests.simulated_hw.faults.worlds import (
    COUNTED,
    can_gyro,
    fault,
    serial_gyro,
    sums,
    truth_of,
    wait,
    world,
)

ON_SERIAL = {
    "loss": {"probability": 2e-3},
    "burst_loss": {"enter": 5e-4, "mean_frames": 12.0},
    "bit_error": {"probability": 1e-5},
    "duplicate": {"probability": 2e-3},
    "sync_slip": {"probability": 2e-3},
}
# For this seed the last frames are undisturbed: what is lost at the end of a stream nobody can count yet.
LONG_S = 600.0


def listen(gyro, open_world: World, until_s: float, step_s: float) -> list[FrameBatch]:
    batches = []
    while open_world.env.now < until_s - 1e-9:
        wait(open_world, min(open_world.env.now + step_s, until_s))
        batches.append(gyro.take())
    return batches


@pytest.mark.parametrize("names", [*([name] for name in ON_SERIAL), list(ON_SERIAL)], ids="+".join)
def test_a_serial_driver_counts_what_the_log_says(names: list[str], tmp_path: Path) -> None:
    with world(*(fault(name, "S", **ON_SERIAL[name]) for name in names), truth=tmp_path) as bench:
        gyro = serial_gyro(bench)
        listen(gyro, bench, LONG_S, 7.3)
    records = truth_of(tmp_path)
    counted = {name: value for name, value in asdict(gyro.losses).items() if name in COUNTED}
    assert counted == sums(records)
    assert {record["fault"] for record in records} == set(names)
    assert len(records) > 30
    assert gyro.losses.frames == 60_000 - gyro.losses.lost


@pytest.mark.parametrize("names", [["loss"], ["burst_loss"], ["duplicate"], ["loss", "burst_loss", "duplicate"]])
def test_a_can_driver_counts_what_the_log_says(names: list[str], tmp_path: Path) -> None:
    with world(*(fault(name, "C", **ON_SERIAL[name]) for name in names), truth=tmp_path) as bench:
        gyro = can_gyro(bench)
        listen(gyro, bench, LONG_S, 7.3)
    records = truth_of(tmp_path)
    counted = {name: value for name, value in asdict(gyro.losses).items() if name in COUNTED}
    assert counted == sums(records)
    assert {record["fault"] for record in records} == set(names)


def test_the_stream_and_its_log_do_not_depend_on_who_reads_when(tmp_path: Path) -> None:
    def stream(folder: Path, step_s: float) -> bytes:
        faults = [fault(name, "S", **about) for name, about in ON_SERIAL.items()]
        faults += [fault("silence", "S", at_s=50.0, for_s=3.0), fault("late", "S", at_s=70.0, for_s=5.0)]
        faults += [fault("power_reset", "S", at_s=90.0), fault("spike", "S", probability=1e-3)]
        faults += [fault("frozen", "S", at_s=20.0, for_s=10.0)]
        with world(*faults, truth=folder) as bench:
            port = serial.serial_for_url("sim://s", baudrate=921600, timeout=0)
            data = b""
            while bench.env.now < 200.0:
                wait(bench, min(bench.env.now + step_s, 200.0))
                data += port.read(port.in_waiting)
            return data

    assert stream(tmp_path / "a", 0.37) == stream(tmp_path / "b", 200.0)
    assert sorted(map(str, truth_of(tmp_path / "a"))) == sorted(map(str, truth_of(tmp_path / "b")))


def test_another_fault_or_instrument_changes_nothing_of_the_first(tmp_path: Path) -> None:
    def lost(folder: Path, *more: object) -> list[dict]:
        with world(fault("loss", "S", probability=1e-3), *more, truth=folder) as bench:
            listen(serial_gyro(bench), bench, 200.0, 10.0)
            listen(can_gyro(bench), bench, 300.0, 10.0)
        return [record for record in truth_of(folder) if record["number"] == 0 and record["t_s"] < 200.0]

    alone = lost(tmp_path / "a")
    assert alone
    assert lost(tmp_path / "b", fault("duplicate", "S", probability=1e-3), fault("loss", "C", probability=0.1)) == alone


@pytest.mark.parametrize("on", ["S", "C"])
def test_silence_is_a_gap_of_exactly_its_frames(on: str, tmp_path: Path) -> None:
    with world(fault("silence", on, at_s=10.0, for_s=4.5), truth=tmp_path) as bench:
        gyro = serial_gyro(bench) if on == "S" else can_gyro(bench)
        gyro.discard()
        batches = listen(gyro, bench, 12.0, 1.0)
        assert "nothing received for 2 s" in gyro.complaint()
        batches += listen(gyro, bench, 20.0, 1.0)
    assert gyro.losses.lost == 450 and gyro.losses.frames == 1550
    (record,) = truth_of(tmp_path)
    assert (record["frame"], record["frames"], record["lost"]) == (1000, 450, 450)
    index = np.concatenate([batch.index for batch in batches])
    assert int(np.diff(index).max()) == 451


@pytest.mark.parametrize("on", ["S", "C"])
def test_late_frames_all_arrive_in_the_end(on: str, tmp_path: Path) -> None:
    with world(fault("late", on, at_s=10.0, for_s=4.0), truth=tmp_path) as bench:
        gyro = serial_gyro(bench) if on == "S" else can_gyro(bench)
        counts = [len(batch) for batch in listen(gyro, bench, 20.0, 1.0)]
    assert counts == [100] * 10 + [0, 0, 0, 400] + [100] * 6
    assert gyro.losses.lost == 0
    assert [record["state"] for record in truth_of(tmp_path)] == ["begins", "ends"]


def test_late_messages_can_be_waited_for_one_by_one() -> None:
    with world(fault("late", "C", at_s=1.0, for_s=2.0)) as bench:
        bus = can.Bus(interface="fogsim", channel="c")
        for _ in range(100):
            assert bus.recv(1.0)
        assert bus.recv(1.0) is None and bench.env.now == pytest.approx(2.0, abs=1e-3)
        assert bus.recv(2.0) and bench.env.now == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("on", ["S", "C"])
def test_after_a_power_reset_the_counter_begins_at_0_and_the_bias_is_another(on: str, tmp_path: Path) -> None:
    with world(fault("power_reset", on, at_s=100.3, for_s=3.0), truth=tmp_path) as bench:
        gyro = serial_gyro(bench) if on == "S" else can_gyro(bench)
        before = FrameBatch.concat(listen(gyro, bench, 100.3, 1.0))
        after = FrameBatch.concat(listen(gyro, bench, 203.3, 1.0))
        bias_dph = bench.gyros[on].rows.turn_on_bias_dph
    assert len(before) == 10_030 and len(after) == 10_000
    assert before.columns["counter"][-1] == 10_029 % (128 if on == "S" else 256)
    assert list(after.columns["counter"][:3]) == [0, 1, 2]
    gone = next(record for record in truth_of(tmp_path) if "frame" in record)
    assert (gone["frame"], gone["frames"]) == (10_030, 300) and "lost" not in gone
    new_dph = next(record["turn_on_bias_dph"] for record in truth_of(tmp_path) if record.get("state") == "ends")
    change_dph = (after.rate_dps.mean() - before.rate_dps.mean()) * 3600.0
    assert abs(new_dph - bias_dph) > 0.1
    # white noise of 100 s: 0.05 deg/sqrt(h) is 0.3 deg/h, twice; the flicker floor beside it
    assert change_dph == pytest.approx(new_dph - bias_dph, abs=2.0)


def test_what_is_thrown_away_unread_is_not_counted(tmp_path: Path) -> None:
    with world(fault("loss", "S", probability=0.01), truth=tmp_path) as bench:
        gyro = serial_gyro(bench)
        listen(gyro, bench, 10.0, 1.0)
        wait(bench, 100.0)
        gyro.discard()
        listen(gyro, bench, 110.0, 1.0)
    records = truth_of(tmp_path)
    assert not [record for record in records if 1000 <= record["frame"] < 10_000]
    assert gyro.losses.lost == sum(record["lost"] for record in records if record["frame"] not in (10_000, 999))


def test_flipped_bits_that_pass_all_checks_are_logged_as_such(tmp_path: Path) -> None:
    """Two flipped bits can compensate in a byte sum, so some damaged frames are good ones to every receiver."""
    frame = {
        "name": "sum", "length": 10, "header": "EB 90", "fields": [{"name": "r", "at": 2, "type": "i32"},
        {"name": "c", "at": 6, "type": "u8"}, {"name": "t", "at": 7, "type": "i16"}],
        "checksum": {"kind": "sum8", "over": [0, 9], "at": 9}, "counter": {"field": "c"},
        "rate": {"field": "r", "kind": "rate", "unit": "deg", "scale": 1e-6},
        "temperature": {"field": "t", "unit": "degC", "scale": 0.01},
    }  # fmt: skip
    with world(fault("bit_error", "S", probability=0.01), truth=tmp_path, frame=frame) as bench:
        port = serial.serial_for_url("sim://s", baudrate=921600, timeout=0)
        wait(bench, 300.0)
        data = np.frombuffer(port.read(port.in_waiting), np.uint8).reshape(-1, 10)
    valid = (data[:, 0] == 0xEB) & (data[:, 1] == 0x90) & (data[:, :9].sum(axis=1) % 256 == data[:, 9])
    records = truth_of(tmp_path)
    passing = [record for record in records if record.get("passes_checks")]
    assert passing and not any("lost" in record for record in passing)
    assert np.count_nonzero(~valid) == sums(records)["lost"] == len(records) - len(passing)
