"""Live simulators: unmodified drivers and other people's clients on real ports, at a multiple of the wall."""

import csv
import time
import uuid
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
import serial

from drivers.can_ports import open_can, open_can_source
from drivers.chambers.watlow_f4 import WatlowF4
from drivers.codecs.batch import FrameBatch
from drivers.gyros.can_dbc import CanGyro
from drivers.gyros.serial_frames import SerialGyro
from drivers.ports import open_byte_source, open_serial
from drivers.rate_tables.acutronic_acl import AcutronicAcl
from simulated_hw.live import Lag, LiveBench, LiveOptions
from simulated_hw.world import GYRO_CLASSES, InstrumentSpec, WorldError, WorldSpec

CHAMBER, TABLE, SERIAL, CAN = "sim://lv-chamber", "sim://lv-table", "sim://lv-s1", "can:lv-c1"
SPEC = WorldSpec(
    seed=3,
    chamber=InstrumentSpec("watlow_f4", CHAMBER, {"baud": 19200}),
    rate_table=InstrumentSpec("acutronic_acl", TABLE, {"baud": 115200}),
    duts={
        "S1": InstrumentSpec("serial_frames", SERIAL, {"frame": "kvh_36_c100", "data_rate_hz": 100.0}),
        "C1": InstrumentSpec("can_dbc", CAN, {"dbc": "fog_gyro", "data_rate_hz": 100.0}),
    },
    gyro_parameters={"S1": GYRO_CLASSES["ts_a"], "C1": GYRO_CLASSES["ts_b"]},
)
wall = pytest.mark.wall


def table_at(address):
    settings = AcutronicAcl.Settings(baud=115200)
    port = open_serial(address, settings.baud, settings.reply_timeout_s)
    return AcutronicAcl(port, settings), port


@wall
@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "tcp"])
def test_a_client_that_comes_back_finds_the_table_still_turning(tcp: bool, tmp_path: Path) -> None:
    with LiveBench(SPEC, LiveOptions(speed=5.0, tcp=tcp), tmp_path, 0.5) as live, live.in_background():
        table, port = table_at(live.addresses[TABLE])
        table.energise()
        table.set_rate_dps(30.0)
        time.sleep(0.3)
        port.close()
        left_s = live.world.env.now
        time.sleep(0.3)
        table, port = table_at(live.addresses[TABLE])
        assert table.rate_dps() == pytest.approx(30.0, abs=0.05)
        table.stop()
        time.sleep(0.4)
        assert table.rate_dps() == pytest.approx(0.0, abs=0.05)
        back_s = live.world.env.now
        port.close()
    assert back_s - left_s > 0.7 * 5.0 * 0.9
    with (tmp_path / "truth.csv").open() as file:
        rows = [(float(row["t_s"]), float(row["table_rate_dps"])) for row in csv.DictReader(file)]
    assert np.allclose(np.diff([t for t, _ in rows]), 0.5)
    away = [rate for t, rate in rows if left_s <= t <= left_s + 1.2]
    assert away and np.allclose(away, 30.0, atol=0.05)
    assert rows[-1][1] == pytest.approx(0.0, abs=0.05)


@wall
@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "tcp"])
def test_streams_of_both_kinds_arrive_whole(tcp: bool) -> None:
    with LiveBench(SPEC, LiveOptions(speed=10.0, tcp=tcp)) as live, live.in_background():
        interface, channel = live.addresses[CAN]
        assert interface == "slcan"
        bus = can.Bus(channel, interface, bitrate=1_000_000, sleep_after_open=0, ignore_config=True)
        gyros = [
            SerialGyro(
                open_byte_source(open_serial(live.addresses[SERIAL], 921600, 0.0), time.monotonic),
                SerialGyro.Settings(frame="kvh_36_c100"),
            ),
            CanGyro(open_can_source(bus, time.monotonic), CanGyro.Settings()),
        ]
        for gyro in gyros:
            gyro.discard()
        before_s = live.world.env.now
        time.sleep(0.5)
        batches = [FrameBatch.concat([gyro.take()]) for gyro in gyros]
        passed_s = live.world.env.now - before_s
        for gyro in gyros:
            gyro._source.close()
    for gyro, batch in zip(gyros, batches, strict=True):
        assert len(batch) == pytest.approx(100 * passed_s, rel=0.4)
        assert gyro.losses.lost == gyro.losses.bad_checksum == gyro.losses.duplicates == 0
        assert (np.diff(batch.index) == 1).all()
        assert abs(batch.temperature_degc.mean() - 25.0) < 1.0


@wall
def test_a_named_can_bus_carries_all_can_gyros() -> None:
    channel = f"test-{uuid.uuid4()}"
    second = InstrumentSpec("can_dbc", "can:lv-c2", {"dbc": "fog_gyro", "data_rate_hz": 100.0, "can_id": 0x1A5})
    spec = replace(SPEC, duts={**SPEC.duts, "C2": second})
    with (
        LiveBench(spec, LiveOptions(can=("virtual", channel))) as live,
        open_can("virtual", channel, 1_000_000) as bus,
        live.in_background(),
    ):
        assert live.addresses[CAN] == live.addresses["can:lv-c2"] == ("virtual", channel)
        heard = {message.arbitration_id for message in (bus.recv(2.0) for _ in range(20)) if message}
    assert heard == {0x1A0, 0x1A5}


@wall
def test_a_third_partys_modbus_client_reads_the_temperature_over_tcp() -> None:
    from pymodbus import FramerType
    from pymodbus.client import ModbusTcpClient

    with LiveBench(SPEC, LiveOptions(tcp=True)) as live, live.in_background():
        host, port = live.addresses[CHAMBER].removeprefix("socket://").split(":")
        client = ModbusTcpClient(host, port=int(port), framer=FramerType.RTU, timeout=3.0)
        assert client.connect()
        answer = client.read_holding_registers(100, count=1, device_id=1)
        client.close()
    assert answer.registers[0] in (249, 250, 251)


@wall
def test_a_pulled_adapter_comes_back_under_its_link(tmp_path: Path) -> None:
    with LiveBench(SPEC, LiveOptions(links=tmp_path / "links")) as live, live.in_background():
        address = live.addresses[CHAMBER]
        assert address == str(tmp_path / "links" / "chamber")
        for _ in range(2):
            port = open_serial(address, 19200, 1.0)
            assert WatlowF4(port, WatlowF4.Settings()).temperature_degc() == pytest.approx(25.0, abs=0.3)
            live.unplug(CHAMBER)
            with pytest.raises((OSError, serial.SerialException)):
                for _ in range(3):
                    port.read(1)
            port.close()
            assert not Path(address).exists()
            live.plug(CHAMBER)
    assert list((tmp_path / "links").iterdir()) == []


@wall
def test_who_does_not_read_loses_bytes_and_is_told_of() -> None:
    told: list[str] = []
    live = LiveBench(SPEC, LiveOptions(speed=500.0), tell=told.append)
    with live, live.in_background(), serial.Serial(live.addresses[SERIAL]):
        time.sleep(0.8)
    assert any("too slow a client" in text and str(live.addresses[SERIAL]) in text for text in told)


def test_a_world_that_stands_still_is_reported() -> None:
    lag = Lag(speed=10.0)
    assert not lag.note(1.0, 0.01)
    assert lag.report(1.0) is None
    assert not lag.note(3.0, 0.06)
    assert lag.note(12.0, 0.01)
    text = lag.report(12.0)
    assert text is not None and "in the last 11 s" in text and "60 ms, 0.6 s of bench time" in text
    assert lag.report(30.0) is None
    # at the wall's own speed a quarter of a second is what a driver's time-out stands
    slow = Lag(speed=1.0)
    slow.note(1.0, 0.2)
    assert slow.report(2.0) is None


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_is_above_zero(speed: float) -> None:
    with pytest.raises(ValueError, match="speed"):
        LiveOptions(speed)
    with pytest.raises(ValueError, match="--tcp"):
        LiveOptions(tcp=True, links=Path("x"))


def test_what_cannot_be_built_leaves_nothing_behind(tmp_path: Path) -> None:
    spec = replace(SPEC, rate_table=InstrumentSpec("no_such_driver", TABLE))
    for _ in range(2):
        with pytest.raises(WorldError, match="no_such_driver"):
            LiveBench(spec, LiveOptions()).open()
    bad_bus = LiveBench(SPEC, LiveOptions(can=("no_such_interface", "x"), links=tmp_path))
    with pytest.raises((can.CanError, NotImplementedError)):
        bad_bus.open()
    assert list(tmp_path.iterdir()) == []
    again = LiveBench(SPEC, LiveOptions())
    again.open()
    again.close()


@wall
def test_a_failure_of_the_pump_is_not_lost() -> None:
    live = LiveBench(SPEC, LiveOptions())
    live.open()

    def failing(until_s: float) -> None:
        raise OSError("disk full")

    live._move = failing  # type: ignore[method-assign]
    with pytest.raises(OSError, match="disk full"), live.in_background():
        time.sleep(0.05)
    live.close()
