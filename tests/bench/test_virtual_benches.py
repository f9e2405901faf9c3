"""The benches of the reference experiments: what their drivers hear is what their sensors should feel."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from bench.benchfile import load_bench
from bench.check import check
from bench.clock import Clock
from bench.composition import check_simulation, open_bench, seed_of
from bench.station import Station
from drivers.codecs.batch import FrameBatch

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("virtual_rlg", "virtual_bp", "virtual_north", "virtual_metrics")
EARTH_DPH = 15.041067
UP_DPH = EARTH_DPH * np.sin(np.radians(40.0))
NORTH_DPH = EARTH_DPH * np.cos(np.radians(40.0))


@contextmanager
def opened(name: str) -> Iterator[tuple[Station, Clock]]:
    bench, problems = load_bench(ROOT / "benches" / f"{name}.yaml")
    assert bench is not None and problems == [] and check_simulation(bench) == []
    with open_bench(bench, seed_of(bench), None) as opened:
        yield opened


def heard(station: Station, clock: Clock, begin_s: float, lasting_s: float) -> dict[str, FrameBatch]:
    clock.wait(begin_s - clock.now())
    for gyro in station.gyros.values():
        gyro.discard()
    clock.wait(lasting_s)
    return {name: gyro.take() for name, gyro in station.gyros.items()}


@pytest.mark.parametrize("name", NAMES)
def test_a_procedure_can_be_checked_on_it(name: str) -> None:
    check(ROOT / "procedures" / "smoke.yaml", ROOT / "benches" / f"{name}.yaml")


def test_a_seeker_must_be_told_where_it_stands(tmp_path: Path) -> None:
    text = (ROOT / "benches" / "virtual_north.yaml").read_text()
    (tmp_path / "nowhere.yaml").write_text(text.replace("site: {latitude: 40 deg, azimuth: 35 deg}", ""))
    bench, _ = load_bench(tmp_path / "nowhere.yaml")
    assert bench is not None
    (problem,) = check_simulation(bench)
    assert "SEEKER-1 seeks north" in str(problem) and "site: {latitude: 40 deg}" in str(problem)


def test_ring_lasers_tell_the_earths_rotation_and_three_temperatures() -> None:
    with opened("virtual_rlg") as (station, clock):
        batches = heard(station, clock, 7200.0, 200.0)
    assert list(batches) == ["RLG-A", "RLG-B", "RLG-C"]
    for batch in batches.values():
        assert len(batch) == pytest.approx(20_000, abs=3) and batch.good.all()
        assert batch.rate_dps.mean() * 3600.0 == pytest.approx(UP_DPH, abs=0.1)
        # whole pulses of 0.01 arcsec
        assert batch.columns["rate"].dtype == np.int32 and 1 < np.ptp(batch.columns["rate"]) < 50
        assert list(batch.channels) == ["case_degc", "anode_degc", "cathode_degc"]
        assert batch.channels["case_degc"].tolist() == batch.temperature_degc.tolist()
        warmer = [batch.channels[name].mean() - batch.temperature_degc.mean() for name in batch.channels]
        assert warmer == pytest.approx([0.0, 2.5, 1.5], abs=0.1)


def test_the_stepped_cycle_gyro_sends_400_frames_a_second() -> None:
    with opened("virtual_bp") as (station, clock):
        batch = heard(station, clock, 7200.0, 100.0)["FOG-C01"]
    assert len(batch) == pytest.approx(40_000, abs=5) and batch.good.all()
    assert batch.rate_dps.mean() * 3600.0 == pytest.approx(UP_DPH + 0.08, abs=0.15)
    assert batch.temperature_degc.mean() == pytest.approx(23.0 + 4.0, abs=1.0)
    assert batch.channels == {}


def test_the_seeker_on_the_table_turns_with_it() -> None:
    with opened("virtual_north") as (station, clock):
        assert station.table is not None
        station.table.energise()
        found = []
        for number, position_deg in enumerate((0.0, 180.0)):
            station.table.go_to_deg(position_deg)
            batch = heard(station, clock, 7200.0 + 300.0 * number, 120.0)["SEEKER-1"]
            assert (station.table.position_deg() - position_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=0.01)
            found.append((batch.rate_dps.mean() * 3600.0, batch.channels["rate_y_dps"].mean() * 3600.0))
            assert abs(batch.channels["accel_x_g"].mean()) < 1e-3 and batch.channels["accel_y_g"].std() > 0.0
    x, y = (np.array(found[0]) - np.array(found[1])) / 2.0
    assert x == pytest.approx(NORTH_DPH * np.cos(np.radians(35.0)), abs=0.1)
    assert y == pytest.approx(NORTH_DPH * np.sin(np.radians(35.0)), abs=0.1)


def test_the_high_end_gyro_sticks_in_its_dead_band_only_when_the_earth_is_turned_away() -> None:
    with opened("virtual_metrics") as (station, clock):
        assert station.table is not None
        station.table.energise()
        batches = {}
        for number, against_dph in enumerate((0.0, UP_DPH - 0.5, UP_DPH)):
            station.table.set_rate_dps(-against_dph / 3600.0)
            batches[against_dph] = heard(station, clock, 7200.0 + 300.0 * number, 100.0)
    still = {name: batch.rate_dps.mean() * 3600.0 for name, batch in batches[0.0].items()}
    assert still == pytest.approx({"NAV-1": UP_DPH + 0.1, "HIGH-1": UP_DPH + 0.02}, abs=0.1)
    stuck = batches[UP_DPH]["HIGH-1"].rate_dps
    assert np.mean(stuck == 0.0) > 0.99
    # half a deg/h of input, and half of a dead band of 1: nothing comes out of the one, all of it of the other
    small = {name: batch.rate_dps.mean() * 3600.0 for name, batch in batches[UP_DPH - 0.5].items()}
    assert abs(small["HIGH-1"]) < 0.05 and small["NAV-1"] == pytest.approx(0.6, abs=0.15)
