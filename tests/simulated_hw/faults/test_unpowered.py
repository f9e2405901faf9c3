"""A supply that switches the DUTs of a world: silence, a new counter, another turn-on bias, and warming up again."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import serial

from drivers.power_supplies.scpi_supply import ScpiSupply, ScpiSupplySettings
from simulated_hw import world as world_module
from simulated_hw.faults.kinds import FAULTS, FaultSpec
from simulated_hw.world import InstrumentSpec, World, WorldError, WorldSpec, gyro_class
from tests.simulated_hw.faults.worlds import CAN, SERIAL, can_gyro, serial_gyro, wait

SUPPLY = InstrumentSpec("scpi_supply", "sim://supply", {"baud": 9600})
STEADY = replace(gyro_class("navigation"), turn_on_bias_sigma_dph=50.0)


class Mute:
    """A simulator that knows nothing of faults."""

    def __init__(self, env, plant, settings):
        self.env = env


def powered_world(truth=None, **changes):
    duts = {"S": SERIAL, "C": CAN}
    gyros = dict.fromkeys(duts, STEADY)
    spec = WorldSpec(1, duts=duts, supply=SUPPLY, gyro_parameters=gyros)
    return World(replace(spec, **changes), truth)


def supply():
    return ScpiSupply(serial.serial_for_url("sim://supply", baudrate=9600), ScpiSupplySettings())


def test_switching_off_and_on_through_the_wire(tmp_path):
    with powered_world(tmp_path) as world:
        gyros, source = [serial_gyro(world), can_gyro(world)], supply()
        for gyro in gyros:
            gyro.discard()
        wait(world, 100.0)
        before = [gyro.take() for gyro in gyros]
        assert [len(batch) for batch in before] == pytest.approx([10_000] * 2, abs=5)
        source.switch(False)
        ((off_s, _),) = world.gyros["S"].power.gaps(world.env.now)
        wait(world, 130.0)
        rest = [len(gyro.take()) for gyro in gyros]
        assert rest == pytest.approx([100.0 * (off_s - 100.0)] * 2, abs=2)
        wait(world, 160.0)
        assert [len(gyro.take()) for gyro in gyros] == [0, 0]
        assert gyros[0].complaint() is not None
        source.switch(True)
        on_s = world.env.now
        for gyro in gyros:
            gyro.discard()
        wait(world, on_s + 50.0)
        after = [gyro.take() for gyro in gyros]
        for n, name in enumerate(("S", "C")):
            assert len(after[n]) == pytest.approx(5000, abs=20)
            drawn = world.gyros[name].rows
            expected = drawn.turn_on(1)[0] - drawn.turn_on(0)[0]
            shift_dph = (after[n].rate_dps.mean() - before[n].rate_dps.mean()) * 3600.0
            assert shift_dph == pytest.approx(expected, abs=2.0)
            assert abs(expected) > 5.0
        # the counter has begun again: 128 values on the serial line
        sent = np.asarray(after[0].columns["counter"])
        assert int(sent[0]) < 10
        world.env.run(until=3700.0)
    with (tmp_path / "truth.csv").open() as file:
        rows = list(csv.DictReader(file))
    drawn = [float(row["turn_on_bias_dph:S"]) for row in rows]
    assert drawn[0] == pytest.approx(world.gyros["S"].rows.turn_on(0)[0], rel=1e-6)
    assert drawn[-1] == pytest.approx(world.gyros["S"].rows.turn_on(1)[0], rel=1e-6)


def test_only_what_it_feeds_is_switched_and_nothing_else_changes():
    with powered_world(powered=("C",)) as world:
        source = supply()
        first = serial_gyro(world)
        first.discard()
        source.switch(False)
        wait(world, 60.0)
        with_supply = first.take()
    with powered_world(supply=None) as world:
        second = serial_gyro(world)
        second.discard()
        wait(world, 60.0)
        without = second.take()
    assert len(without) > 5990
    assert with_supply.rate_dps[-5000:].tobytes() == without.rate_dps[-5000:].tobytes()


def test_beside_other_faults():
    late = FaultSpec("loss", "S", FAULTS["loss"](probability=0.1))
    with powered_world(faults=(late,)) as world:
        gyro, source = serial_gyro(world), supply()
        gyro.discard()
        wait(world, 50.0)
        assert len(gyro.take()) == pytest.approx(4500, abs=150)
        source.switch(False)
        wait(world, 60.0)
        gyro.take()
        wait(world, 90.0)
        assert len(gyro.take()) == 0


def test_a_simulator_that_cannot_be_silent_is_refused(monkeypatch):
    monkeypatch.setattr(world_module, "_simulator", lambda driver: Mute)
    mute = InstrumentSpec("mute", "sim://mute")
    with pytest.raises(WorldError, match="Mute of M cannot be without power"):
        powered_world(duts={"M": mute}, gyro_parameters={}).open()
