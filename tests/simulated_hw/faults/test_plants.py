"""Faults of table and chamber: what the machine truly does, and what the real drivers see of it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial

from drivers.chambers.watlow_f4 import WatlowF4, WatlowF4Settings
from drivers.errors import Refused
from simulated_hw.faults.install import Faults
from simulated_hw.faults.kinds import FaultSpec
from simulated_hw.faults.script import Condition
from simulated_hw.world import World
from tests.simulated_hw.faults import worlds
from tests.simulated_hw.faults.worlds import chamber, fault, table, truth_of, wait, world


def turning(bench: World, rate_dps: float):
    driver = table()
    driver.energise()
    driver.set_rate_dps(rate_dps)
    wait(bench, 9.0)
    assert driver.rate_dps() == pytest.approx(rate_dps, abs=0.01)
    return driver


def test_a_table_fault_opens_the_interlock_and_lets_the_axis_coast(tmp_path: Path) -> None:
    with world(fault("fault", "rate_table", at_s=10.0, reason="servo"), truth=tmp_path) as bench:
        driver = turning(bench, 50.0)
        wait(bench, 13.0)
        # it coasts with a time constant of 3 s
        assert bench.table.true_rate_dps(13.0) == pytest.approx(50.0 / np.e, rel=0.01)
        assert "Fault: servo" in driver.fault()
        with pytest.raises(Refused):
            driver.go_to_deg(10.0)
        driver.energise()
        assert driver.fault() is None
    assert [record["state"] for record in truth_of(tmp_path)] == ["begins"]


def test_a_fault_that_lasts_cannot_be_reset(tmp_path: Path) -> None:
    with world(fault("fault", "rate_table", at_s=10.0, for_s=60.0), truth=tmp_path) as bench:
        driver = turning(bench, 50.0)
        wait(bench, 20.0)
        with pytest.raises(Refused):
            driver.energise()
        wait(bench, 71.0)
        driver.energise()
        assert driver.fault() is None
    assert [record["t_s"] for record in truth_of(tmp_path)] == [10.0, 70.0]


def test_an_emergency_stop_brakes(tmp_path: Path) -> None:
    with world(fault("e_stop", "rate_table", at_s=10.0, for_s=5.0), truth=tmp_path) as bench:
        driver = turning(bench, 200.0)
        wait(bench, 11.0)
        # 500 deg/s² bring 200 deg/s to rest in 0.4 s, the servo settles in some tenths
        assert abs(bench.table.true_rate_dps(11.0)) < 0.1
        assert "emergency stop" in driver.fault()
        wait(bench, 15.5)
        driver.energise()
        driver.set_rate_dps(10.0)
        wait(bench, 20.0)
        assert driver.rate_dps() == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize("rate_dps", [100.0, -100.0, 0.0])
def test_over_speed_trips_at_its_rate(rate_dps: float) -> None:
    with world(fault("over_speed", "rate_table", at_s=10.0, trip=1.1)) as bench:
        driver = turning(bench, rate_dps)
        times_s = np.arange(10.0, 40.0, 0.01)
        wait(bench, 12.0)
        # whatever is demanded meanwhile
        driver.set_rate_dps(5.0)
        wait(bench, 40.0)
        rates = np.array([bench.table.true_rate_dps(t) for t in times_s])
        assert np.abs(rates).max() == pytest.approx(440.0, abs=8.0)
        assert abs(rates[-1]) < 1.0
        assert "over-speed" in driver.fault()


def test_a_stuck_table_acknowledges_and_stays_where_it_is() -> None:
    with world(fault("stuck", "rate_table", at_s=10.0, for_s=20.0)) as bench:
        driver = turning(bench, 50.0)
        wait(bench, 12.0)
        driver.set_rate_dps(80.0)
        wait(bench, 29.0)
        assert driver.fault() is None and driver.rate_dps() == pytest.approx(0.0, abs=0.01)
        assert abs(bench.table.true_rate_dps(29.0)) < 1e-6
        wait(bench, 35.0)
        assert driver.rate_dps() == pytest.approx(80.0, abs=0.01)


def test_an_encoder_error_is_in_the_readback_only() -> None:
    error = fault("encoder_error", "rate_table", at_s=10.0, for_s=20.0, rate_offset_dps=0.5, position_offset_deg=7.0)
    with world(error) as bench:
        driver = turning(bench, 20.0)
        wait(bench, 20.0)
        assert driver.rate_dps() == pytest.approx(20.5, abs=0.01)
        assert bench.table.true_rate_dps(20.0) == pytest.approx(20.0, abs=0.001)
        position = driver.position_deg()
        now = bench.env.now
        assert (position - bench.table.position_deg(now)) % 360.0 == pytest.approx(7.0, abs=0.5)
        wait(bench, 31.0)
        assert driver.rate_dps() == pytest.approx(20.0, abs=0.01)


def test_encoder_ripple_repeats_once_per_turn() -> None:
    error = fault("encoder_error", "rate_table", at_s=10.0, rate_offset_dps=0.0, rate_ripple_dps=2.0)
    with world(error) as bench:
        driver = turning(bench, 36.0)
        wait(bench, 11.0)
        readings = []
        for step in range(20):
            wait(bench, 11.0 + 0.5 * step)
            readings.append(driver.rate_dps())
        assert np.mean(readings) == pytest.approx(36.0, abs=0.1)
        assert max(readings) == pytest.approx(38.0, abs=0.2) and min(readings) == pytest.approx(34.0, abs=0.2)


def cold(bench: World, hours: float = 3.0) -> tuple[float, float]:
    """Air after hours at a setpoint of -30 °C: true, and as read."""
    driver = chamber()
    driver.set_setpoint_degc(-30.0)
    wait(bench, hours * 3600.0)
    return float(bench.chamber.air_degc(np.array([bench.env.now]))[0]), driver.temperature_degc()


def test_weak_cooling_does_not_reach_its_setpoint() -> None:
    with world() as bench:
        assert cold(bench)[0] == pytest.approx(-30.0, abs=0.5)
    with world(fault("weak_cooling", "chamber")) as bench:
        true, read = cold(bench, 12.0)
    # 0.2 (1700 - 15 x) = 120 + 10 + 2 x W at x kelvin below the room
    assert true == pytest.approx(25.0 - (340.0 - 130.0) / 5.0, abs=0.5)
    assert read == pytest.approx(true, abs=0.5)


def test_an_open_door_warms_the_chamber_while_it_is_open(tmp_path: Path) -> None:
    door = fault("door_open", "chamber", when=Condition(chamber_below_degc=-29.0), for_s=900.0, leak=50.0)
    with world(door, truth=tmp_path) as bench:
        true, _ = cold(bench, 5.0)
        begins, ends = (record["t_s"] for record in truth_of(tmp_path))
        times_s = np.array([begins, ends, begins + 3 * 3600.0])
        before, after, later = bench.chamber.air_degc(times_s).tolist()
        coil = [bench.gyros["S"].truth(np.array([t]))["coil_degc"][0] for t in times_s]
    assert ends - begins == 900.0
    assert before == pytest.approx(-29.0, abs=0.1) and after > -22.0 and later == pytest.approx(-30.0, abs=0.5)
    assert np.isfinite(coil).all() and true == pytest.approx(-30.0, abs=0.5)


def test_an_open_door_is_told_by_the_controller_it_is_wired_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two that open it, of which the later one closes last."""
    wired = replace(worlds.CHAMBER, settings={**worlds.CHAMBER.settings, "door_register": 106})
    monkeypatch.setattr(worlds, "CHAMBER", wired)
    doors = [fault("door_open", "chamber", at_s=at_s, for_s=20.0) for at_s in (10.0, 20.0)]
    with world(*doors) as bench:
        port = serial.serial_for_url("sim://chamber", baudrate=19200)
        driver = WatlowF4(port, WatlowF4Settings(door_register=106))
        seen = []
        for until in (5.0, 15.0, 35.0, 45.0):
            wait(bench, until)
            seen.append(driver.door_open())
    assert seen == [False, True, True, False]


def test_an_open_door_of_a_chamber_that_does_not_tell_is_felt_alone() -> None:
    with world(fault("door_open", "chamber", at_s=10.0)) as bench:
        driver = chamber()
        wait(bench, 20.0)
        assert driver.door_open() is None and driver.alarm() is None


def test_what_is_read_after_a_door_was_opened_is_what_would_have_been_read_before() -> None:
    """Frames from before the event are the same to the last bit, whether read before or after it."""

    def frames(look_s: list[float]) -> bytes:
        with world(fault("door_open", "chamber", at_s=1000.0, for_s=600.0)) as bench:
            chamber().set_setpoint_degc(0.0)
            for until in look_s:
                wait(bench, until)
                bench.gyros["S"].block(0, bench.gyros["S"].frames_until(until))
            block = bench.gyros["S"].block(90_000, 110_000)
            return block.rate_dps.tobytes() + block.temperature_degc.tobytes()

    assert frames([900.0, 999.0, 1001.0, 2000.0]) == frames([2000.0])


def test_a_broken_sensor_reads_full_scale_and_the_chamber_goes_on(tmp_path: Path) -> None:
    with world(fault("sensor_break", "chamber", at_s=3600.0, for_s=600.0), truth=tmp_path) as bench:
        driver = chamber()
        driver.set_setpoint_degc(40.0)
        wait(bench, 3700.0)
        assert driver.temperature_degc() == 800.0
        assert driver.alarm() == "alarm 1 high"
        assert bench.chamber.air_degc(np.array([3700.0]))[0] == pytest.approx(40.0, abs=0.5)
        wait(bench, 4300.0)
        assert driver.temperature_degc() == pytest.approx(40.0, abs=0.5) and driver.alarm() is None


@pytest.mark.parametrize(("alarm", "state"), [(1, "high"), (1, "low"), (2, "high")])
def test_an_alarm_is_reported_while_it_is_on(alarm: int, state: str) -> None:
    with world(fault("alarm", "chamber", at_s=10.0, for_s=10.0, alarm=alarm, state=state)) as bench:
        driver = chamber()
        assert driver.alarm() is None
        wait(bench, 12.0)
        assert driver.alarm() == f"alarm {alarm} {state}"
        wait(bench, 21.0)
        assert driver.alarm() is None


@dataclass
class Bare:
    """A simulator of a lab's own package that knows nothing of faults."""

    env: Any
    baud: int = 9600


@pytest.mark.parametrize(
    ("name", "on", "missing"), [("alarm", "chamber", "Alarming"), ("e_stop", "rate_table", "Tripping")]
)
def test_a_simulator_that_cannot_show_a_fault_is_refused(name: str, on: str, missing: str) -> None:
    bench = world(fault(name, on, at_s=10.0))
    faults = Faults(bench.spec.faults, 1, bench.env, bench.chamber, bench.table, None)
    plant = bench.chamber if on == "chamber" else bench.table
    with pytest.raises(ValueError, match=f"Bare on {on} cannot show the fault '{name}': it is no .*{missing}"):
        faults.over(on, Bare(bench.env), plant, faults.under(on, plant))


def test_a_world_without_faults_has_nothing_of_them(tmp_path: Path) -> None:
    with world(truth=tmp_path) as bench:
        assert bench.faults is None
    assert not (tmp_path / "faults.jsonl").exists()
    faulty: list[FaultSpec] = [fault("loss", "S")]
    with world(*faulty, truth=tmp_path) as bench:
        assert bench.faults is not None
    assert (tmp_path / "faults.jsonl").read_text() == ""
