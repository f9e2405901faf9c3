"""Ports unplugged and put in again during a run at wall speed, over ptys: chamber, table, DUT; another instrument."""

import threading
import uuid
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from bench import run as run_module
from bench.conclude import RunEnd
from bench.journal import load_journal
from bench.resume import prepare_resume
from bench.run import RunRequest, prepare, run
from simulated_hw.wire import acutronic_acl
from simulated_hw.world import InstrumentSpec
from tests.bench.campaigns import write
from tests.bench.test_run_real import SPEC, bench_text
from tests.live_bench import LiveBench

pytestmark = pytest.mark.wall

PROCEDURE = """\
procedure: links
quality: {slope: 5 degC/min}
steps:
  - set_temperature: {to: 25 degC, band: 2 K}
  - soak: 1 s
  - sweep:
      rate: [10 deg/s, 20 deg/s, 30 deg/s]
      steps:
        - settle: {band: 0.05 deg/s, for: 0.3 s, timeout: 10 s}
        - acquire: {count: 10, every: 0.1 s}
"""
OUTAGE_S = 1.5


class Bench:
    """A live bench and the run on it; something happens when its second point is being prepared."""

    def __init__(self, tmp_path: Path, live: LiveBench, channel: str, table_stops_in: str) -> None:
        self.tmp_path, self.live = tmp_path, live
        bench = yaml.safe_load(bench_text(live.ttys, channel))
        bench["links"] = {"patience": "6 s", "silent_after": "2 s"}
        bench["chamber"]["safe"] = {"timeout": "5 s"}
        # An axis that is free takes its time to run out.
        bench["rate_table"]["safe"] = {"timeout": table_stops_in}
        self._bench = write(tmp_path, "bench.yaml", yaml.safe_dump(bench))
        self._timers: list[threading.Timer] = []

    def run(self, happens: Callable[[], None], procedure: str = PROCEDURE) -> RunEnd:
        request = RunRequest(
            write(self.tmp_path, "procedure.yaml", procedure), self._bench, self.tmp_path / "results", "live"
        )
        happened: list[bool] = []

        def listen(progress: Any) -> None:
            if progress.finished and progress.step.point == 1 and not happened:
                happened.append(True)
                happens()

        try:
            return run(prepare(request), listen)
        finally:
            for timer in self._timers:
                timer.join()

    def later(self, what: Callable[[], None], seconds: float = OUTAGE_S) -> None:
        self._timers.append(threading.Timer(seconds, what))
        self._timers[-1].start()


@pytest.fixture
def bench(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Bench]:
    channel = f"test-{uuid.uuid4()}"
    with LiveBench(SPEC, channel) as live:
        yield Bench(tmp_path, live, channel, getattr(request, "param", "60 s"))


class NoGuardian:
    """A guardian would go on looking for the ports of a test that is over."""

    def __init__(self, folder: Path) -> None:
        self.left = False

    def beat(self) -> None: ...
    def dismiss(self) -> None: ...
    def leave(self) -> None: ...


@pytest.fixture
def no_guardian(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "Guardian", NoGuardian)


def links_of(end: RunEnd) -> list[tuple[str, str]]:
    entries = load_journal(end.folder / "journal.jsonl")
    return [(entry["instrument"], entry["state"]) for entry in entries if entry["kind"] == "link"]


def safe_of(end: RunEnd) -> list[str]:
    return [entry["text"] for entry in load_journal(end.folder / "journal.jsonl") if entry["kind"] == "safe"]


@pytest.mark.parametrize(("key", "name"), [("chamber", "chamber"), ("rate_table", "rate table")])
def test_an_instrument_that_is_plugged_in_again_is_found_and_every_point_is_measured(
    bench: Bench, key: str, name: str
) -> None:
    def pull() -> None:
        bench.live.unplug(key)
        bench.later(lambda: bench.live.replug(key))

    end = bench.run(pull)
    assert end.outcome == "PASS", end.message
    assert links_of(end) == [(name, "lost"), (name, "restored")]
    points = pd.read_csv(end.folder / "points.csv")
    assert points["point"].tolist() == [1, 1, 2, 2, 3, 3] and (points["frames"] == 100).all()
    assert abs(points["rate_readback_dps"] - points["rate_setpoint_dps"]).max() < 0.05
    assert abs(bench.live.table_rate_dps()) < 0.1 and not any(text.startswith("NOT SAFE") for text in safe_of(end))


def test_a_table_that_lost_its_power_meanwhile_is_energised_again(bench: Bench) -> None:
    """Behind the unplugged adapter the interlock opens, as after a power cut: the axis is free and runs out."""

    def cut() -> None:
        bench.live.unplug("rate_table")
        bench.live.tell("rate_table", b":Interlock:Open 1\r\n")
        bench.later(lambda: bench.live.replug("rate_table"))

    end = bench.run(cut)
    assert end.outcome == "PASS", end.message
    points = pd.read_csv(end.folder / "points.csv")
    assert abs(points["rate_readback_dps"] - points["rate_setpoint_dps"]).max() < 0.05


@pytest.mark.parametrize("bench", ["3 s"], indirect=True)
def test_another_table_behind_the_same_port_is_not_commanded(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, no_guardian: None
) -> None:
    def exchange() -> None:
        bench.live.unplug("rate_table")
        monkeypatch.setattr(acutronic_acl, "_IDENTITY", "Acutronic USA, ACT2000, serial 7")
        bench.later(lambda: bench.live.replug("rate_table"), 0.5)

    end = bench.run(exchange)
    assert end.outcome == "ERROR"
    assert "where 'Acutronic USA, ACT3000, simulated' was, 'Acutronic USA, ACT2000, serial 7' answers" in end.message
    assert bench.live.ttys["rate_table"] in end.message and "procedure.yaml:" in end.message
    # the chamber was made safe; of the table it is said that it was not
    texts = safe_of(end)
    assert len(texts) == 2 and sum(text.startswith("NOT SAFE: rate table") for text in texts) == 1


def test_a_port_that_stays_away_ends_the_run_when_the_patience_is_over(bench: Bench, no_guardian: None) -> None:
    end = bench.run(lambda: bench.live.unplug("chamber"))
    assert end.outcome == "ERROR" and "tried again for" in end.message
    assert abs(bench.live.table_rate_dps()) < 0.1
    assert links_of(end) == [("chamber", "lost")]


def test_a_dut_that_is_plugged_in_again_is_measured_again(bench: Bench) -> None:
    def pull() -> None:
        bench.live.unplug("S1")
        bench.later(lambda: bench.live.replug("S1"), 0.2)

    end = bench.run(pull, PROCEDURE.replace("30 deg/s]", "30 deg/s, 40 deg/s, 50 deg/s, 60 deg/s]"))
    points = pd.read_csv(end.folder / "points.csv")
    assert links_of(end) == [("S1", "lost"), ("S1", "restored")]
    other, mine = points[points["dut"] == "C1"], points[points["dut"] == "S1"]
    assert other["point"].tolist() == [1, 2, 3, 4, 5, 6] and (other["frames_lost"] == 0).all()
    assert mine["point"].tolist()[-1] == 6 and mine["frames"].tolist()[-1] == 100


def test_a_dut_lost_for_the_rest_is_measured_later_and_alone(bench: Bench) -> None:
    end = bench.run(lambda: bench.live.unplug("S1"))
    assert end.outcome == "FAIL" and links_of(end) == [("S1", "lost")]
    assert set(end.manifest["missing"]) == {"S1"} and "fogbench resume live --missing" in end.message
    before = pd.read_parquet(end.folder / "points.parquet").query("dut == 'C1'").reset_index(drop=True)
    assert before["point"].tolist() == [1, 2, 3]
    bench.live.replug("S1")
    end = run(prepare_resume(end.folder, missing=True))
    assert end.outcome == "PASS", end.message
    points = pd.read_parquet(end.folder / "points.parquet")
    assert points["point"].tolist() == [1, 1, 2, 2, 3, 3] and (points["verdict"] == "pass").all()
    pd.testing.assert_frame_equal(points.query("dut == 'C1'").reset_index(drop=True), before)


def test_a_gyro_on_a_serial_can_adapter_comes_back(tmp_path: Path) -> None:
    """An slcan adapter says goodbye before it closes, which a pulled one cannot; its port has to be given back."""
    import can

    from drivers.can_ports import open_can_source
    from drivers.errors import PortError
    from simulated_hw.live import LiveBench as World
    from simulated_hw.live import LiveOptions

    spec = replace(SPEC, duts={"C1": InstrumentSpec("can_dbc", "can:live-c1", {"dbc": "fog_gyro"})}, gyro_parameters={})
    with World(spec, LiveOptions(links=tmp_path)) as live, live.in_background():
        interface, channel = live.addresses["can:live-c1"]
        for _ in range(2):
            bus = can.Bus(channel, interface, bitrate=1_000_000, sleep_after_open=0, ignore_config=True)
            source = open_can_source(bus, lambda: 0.0)
            waiting = threading.Event()
            waiting.wait(0.3)
            assert len(source.take()[0])
            live.unplug("can:live-c1")
            waiting.wait(0.3)
            with pytest.raises(PortError, match="went away"):
                source.take()
            with pytest.raises(PortError, match="did not close"):
                source.close()
            assert not bus.serialPortOrig.is_open
            live.plug("can:live-c1")
