"""The world: instruments at their addresses while it is open, one seed for everything, a truth log on request."""

import csv
import json
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, EntryPoints
from typing import Any

import numpy as np
import pytest
import serial

from simulated_hw import world as world_module
from simulated_hw.physics.axes import EARTH_RATE_DPS
from simulated_hw.wire import switchboard
from simulated_hw.world import (
    ChamberParameters,
    GyroParameters,
    InstrumentSpec,
    SiteParameters,
    World,
    WorldError,
    WorldSpec,
    gyro_class,
)

CHAMBER = InstrumentSpec("watlow_f4", "sim://chamber", {"baud": 19200, "address": 1})
TABLE = InstrumentSpec("acutronic_acl", "sim://table")
GYRO_A = InstrumentSpec("fake_gyro", "sim://gyro-a", {"data_rate_hz": 50.0})
GYRO_B = InstrumentSpec("fake_gyro", "can:gyro-b")


@dataclass
class FakeGyro:
    """A simulator as a lab's own package would bring it."""

    env: Any
    plant: Any
    settings: dict


def refuse(env, plant, settings):
    raise ValueError("settings refused")


@pytest.fixture(autouse=True)
def simulators(monkeypatch):
    """The installed simulators, and two of ours."""
    real = world_module.entry_points

    def with_fakes(*, group):
        own = {"fake_gyro": FakeGyro, "refusing": refuse}
        fakes = [type("Loaded", (EntryPoint,), {"load": lambda self: own[self.name]})(n, f"x:{n}", group) for n in own]
        return EntryPoints([*real(group=group), *fakes])

    monkeypatch.setattr(world_module, "entry_points", with_fakes)


def spec(seed=1, **changes):
    full = WorldSpec(seed, chamber=CHAMBER, rate_table=TABLE, duts={"A": GYRO_A, "B": GYRO_B})
    return replace(full, **{"gyro_parameters": {"B": gyro_class("ts_b")}} | changes)


def drive(world, hours=1.0):
    """An hour of work, and what the gyros saw."""
    world.chamber.command(10.0, 40.0, 2.0)
    world.table.energise(10.0)
    world.table.command_rate(20.0, 60.0)
    world.env.run(until=hours * 3600.0)
    seen = {}
    for name, gyro in world.gyros.items():
        end = gyro.frames_until(world.env.now)
        seen[name] = gyro.block(end - 500, end)
    return seen


def test_instruments_are_there_while_the_world_is_open_and_gone_after():
    with World(spec()) as world:
        assert switchboard.find("sim://gyro-a").plant is world.gyros["A"]
        fake = switchboard.find("can:gyro-b")
        assert fake.env is world.env
        assert fake.settings == {}
        with pytest.raises(WorldError, match="sim://chamber is taken"):
            World(spec(duts={})).open()
        assert switchboard.find("sim://table").env is world.env
    for address in ("sim://chamber", "sim://table", "sim://gyro-a", "can:gyro-b"):
        with pytest.raises(LookupError):
            switchboard.find(address)
    world.close()


def test_real_bytes_reach_the_plant_through_pyserial():
    with World(spec(chamber_parameters=ChamberParameters(probe_offset_sigma_k=0.0))) as world:
        port = serial.serial_for_url("sim://table", baudrate=9600, timeout=1.0)
        port.write(b":Interlock:Close 1\n:Demand:Rate 1,30.0\n:Mode:Rate 1\n")
        world.env.run(until=5.0)
        port.reset_input_buffer()
        port.write(b":Read:Rate? 1\n")
        assert float(port.read_until(b"\n")) == pytest.approx(30.0, abs=0.01)
        assert world.table.true_rate_dps(world.env.now) == pytest.approx(30.0, abs=0.01)
        chamber = serial.serial_for_url("sim://chamber", baudrate=19200, timeout=1.0)
        chamber.write(bytes.fromhex("01 03 00 64 00 01 C5 D5"))  # read register 100
        assert int.from_bytes(chamber.read(7)[3:5], "big") in (249, 250, 251)


@pytest.mark.parametrize(
    "subset", [{"chamber": None}, {"rate_table": None}, {"duts": {}}, {"chamber": None, "rate_table": None}]
)
def test_any_instrument_may_be_missing(subset):
    with World(spec(**subset)) as world:
        assert set(world.gyros) == set(world.spec.duts)
        world.env.run(until=100.0)
        for gyro in world.gyros.values():
            assert abs(gyro.block(0, 100).rate_dps.mean()) < 1.0
            assert gyro.truth(np.array([50.0]))["coil_degc"][0] == pytest.approx(25.0, abs=0.5)


def test_the_same_seed_gives_the_same_everything_and_another_seed_another():
    seen = []
    for seed in (1, 1, 2):
        with World(spec(seed)) as world:
            blocks = drive(world)
            table, chamber = world.table.rate_dps(1000.0), world.chamber.probe_degc(1000.0)
            seen.append((blocks["A"].rate_dps.tobytes(), blocks["B"].temperature_degc.tobytes(), table, chamber))
    assert seen[0] == seen[1]
    assert all(a != b for a, b in zip(seen[0], seen[2], strict=True))


def test_adding_a_dut_changes_nothing_for_the_others():
    with World(spec()) as world:
        both = drive(world)
    with World(spec(duts={"B": GYRO_B})) as world:
        alone = drive(world)
    assert alone["B"].rate_dps.tobytes() == both["B"].rate_dps.tobytes()
    assert alone["B"].temperature_degc.tobytes() == both["B"].temperature_degc.tobytes()


def test_data_rate_comes_from_the_driver_settings_and_the_rest_from_the_parameters():
    parameters = {"A": GyroParameters(data_rate_hz=200.0, max_rate_dps=123.0)}
    with World(spec(gyro_parameters=parameters, site=SiteParameters(latitude_deg=90.0))) as world:
        assert world.gyros["A"].data_rate_hz == 50.0
        assert world.gyros["A"].parameters.max_rate_dps == 123.0
        assert world.gyros["B"].data_rate_hz == 100.0
        assert world.gyros["B"].earth_dps == EARTH_RATE_DPS


def test_a_driver_without_a_simulator_is_named_with_those_that_have_one_and_leaves_nothing_behind():
    broken = spec(duts={"A": GYRO_A, "B": InstrumentSpec("watlow_f5", "sim://b")})
    with pytest.raises(WorldError, match=r"no simulator for driver 'watlow_f5'; there are .*fake_gyro.*watlow_f4"):
        World(broken).open()
    with pytest.raises(ValueError, match="settings refused"):
        World(spec(duts={"A": InstrumentSpec("refusing", "sim://a")})).open()
    with pytest.raises(LookupError, match="no virtual bench is open"):
        switchboard.find("sim://chamber")


def test_the_truth_log_holds_hidden_parameters_and_the_course_of_things(tmp_path):
    with World(spec(), tmp_path / "truth") as world:
        drive(world, hours=2.51)
        hidden = json.loads((tmp_path / "truth" / "truth.json").read_text())
        assert hidden["seed"] == 1
        assert hidden["rate_table"]["rate_gain_ppm"] == world.table.rate_gain_ppm
        assert hidden["chamber"]["probe_offset_k"] == world.chamber.probe_offset_k
        assert hidden["duts"]["A"]["turn_on_bias_dph"] == world.gyros["A"].rows.turn_on_bias_dph
        assert hidden["duts"]["B"]["parameters"]["surface"]["k0"] == 0.041
    with (tmp_path / "truth" / "truth.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert [row["t_s"] for row in rows] == [60.0 * n for n in range(151)]
    at = rows[100]
    assert at["air_degc"] == pytest.approx(float(world.chamber.air_degc(np.array([6000.0]))[0]), rel=1e-8)
    assert at["setpoint_degc"] == at["commanded_degc"] == 40.0
    assert at["table_rate_dps"] == pytest.approx(60.0, rel=1e-3)
    truth = world.gyros["A"].truth(np.array([6000.0]))
    assert at["coil_degc:A"] == pytest.approx(truth["coil_degc"][0], rel=1e-8)
    assert at["scale_ppm:A"] == pytest.approx(truth["scale_ppm"][0], rel=1e-8)
    assert rows[0]["bias_dph:B"] != at["bias_dph:B"]  # the setpoint was changed in between


def test_the_truth_log_changes_nothing_and_without_a_folder_there_is_none(tmp_path):
    with World(spec()) as world:
        assert world.env.peek() == float("inf")  # nothing to do for the clock
        without = drive(world)
    with World(spec(), tmp_path) as world:
        logged = drive(world)
    assert without["A"].rate_dps.tobytes() == logged["A"].rate_dps.tobytes()


def test_two_can_gyros_share_a_channel_by_their_identifiers() -> None:
    import can

    settings = {"dbc": "fog_gyro", "data_rate_hz": 100.0}
    duts = {
        "C1": InstrumentSpec("can_dbc", "can:shared", {**settings, "can_id": 0x1A0}),
        "C2": InstrumentSpec("can_dbc", "can:shared", {**settings, "can_id": 0x1A1}),
    }
    with World(WorldSpec(seed=1, duts=duts)) as world, can.Bus(interface="fogsim", channel="shared") as bus:
        world.env.run(until=1.0)
        ids, _, _ = bus.recv_batch()
        assert sorted(set(ids.tolist())) == [0x1A0, 0x1A1] and abs(len(ids) - 200) <= 2
    twins = {name: InstrumentSpec("can_dbc", "can:shared", settings) for name in ("C1", "C2")}
    with pytest.raises(WorldError, match="1A0"), World(WorldSpec(seed=1, duts=twins)):
        pass


def test_the_truth_of_a_seeker_holds_its_azimuth_and_its_other_axis(tmp_path):
    site = SiteParameters(latitude_deg=40.0, azimuth_deg=30.0)
    with World(spec(gyro_parameters={"A": gyro_class("north")}, site=site), tmp_path) as world:
        world.table.energise(10.0)
        world.table.command_position(10.0, 90.0)
        world.env.run(until=130.0)
        hidden = json.loads((tmp_path / "truth.json").read_text())["duts"]
        assert len(hidden["A"]["accelerometer_bias_ug"]) == 2 and "accelerometer_bias_ug" not in hidden["B"]
    with (tmp_path / "truth.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["azimuth_deg:A"]) for row in rows] == pytest.approx([30.0, 300.0, 300.0], abs=2e-3)
    level_dps = EARTH_RATE_DPS * np.cos(np.radians(40.0))
    assert float(rows[1]["input_rate_y_dps:A"]) == pytest.approx(level_dps * np.sin(np.radians(300.0)), rel=1e-3)
    assert not any(name.startswith(("azimuth_deg:B", "turn_on_bias_dph")) for name in rows[0])
