"""A short procedure at wall speed: real ports (ptys, a CAN bus), the wall clock, a reader thread per stream."""

import uuid
from pathlib import Path

import pytest

from bench.conclude import RunEnd
from bench.errors import BenchFailure
from bench.run import RunRequest, prepare, run
from simulated_hw.world import GYRO_CLASSES, InstrumentSpec, WorldSpec
from tests.bench.campaigns import write
from tests.live_bench import LiveBench

PROCEDURE = """\
procedure: wall
quality: {slope: 2 degC/min}
steps:
  - set_temperature: {to: 25 degC, band: 2 K}
  - sweep:
      rate: [20 deg/s]
      steps:
        - settle: {band: 0.05 deg/s, for: 0.5 s, timeout: 10 s}
        - acquire: {count: 20, every: 0.1 s}
        - acquire: {count: 20, every: 0.1 s, take: newest}
"""

SPEC = WorldSpec(
    seed=5,
    chamber=InstrumentSpec("watlow_f4", "sim://live-chamber", {"baud": 19200}),
    rate_table=InstrumentSpec("acutronic_acl", "sim://live-table", {"baud": 115200}),
    duts={
        "S1": InstrumentSpec(
            "serial_frames", "sim://live-s1", {"frame": "kvh_36_c100", "baud": 921600, "data_rate_hz": 100.0}
        ),
        "C1": InstrumentSpec("can_dbc", "can:live-c1", {"dbc": "fog_gyro", "data_rate_hz": 100.0}),
    },
    gyro_parameters={"S1": GYRO_CLASSES["ts_a"], "C1": GYRO_CLASSES["ts_b"]},
)


def bench_text(ttys: dict[str, str], channel: str) -> str:
    return f"""\
bench: live
chamber:
  {{driver: watlow_f4, port: {ttys["chamber"]}, limits: {{temperature: {{from: -60 degC, to: 90 degC}}}}}}
rate_table:
  {{driver: acutronic_acl, port: {ttys["rate_table"]}, settings: {{baud: 115200}}, limits: {{rate: 400 deg/s}}}}
duts:
  S1:
    driver: serial_frames
    port: {ttys["S1"]}
    settings: {{frame: kvh_36_c100, data_rate: 100 Hz}}
    limits: {{rate: 200 deg/s}}
  C1:
    driver: can_dbc
    port: {{interface: virtual, channel: {channel}}}
    settings: {{dbc: fog_gyro, data_rate: 100 Hz}}
    limits: {{rate: 200 deg/s}}
"""


def run_live(tmp_path: Path, live: LiveBench, channel: str) -> RunEnd:
    request = RunRequest(
        write(tmp_path, "procedure.yaml", PROCEDURE),
        write(tmp_path, "bench.yaml", bench_text(live.ttys, channel)),
        tmp_path / "results",
        "live",
    )
    return run(prepare(request))


@pytest.mark.wall
def test_a_real_bench_runs_the_same_procedure(tmp_path: Path) -> None:
    channel = f"test-{uuid.uuid4()}"
    with LiveBench(SPEC, channel) as live:
        end = run_live(tmp_path, live, channel)
    import pandas as pd

    points = pd.read_csv(end.folder / "points.csv")
    assert end.outcome == "PASS", (end.message, list(points["reasons"]))
    assert not end.manifest["bench"]["virtual"]
    assert list(points["dut"]) == ["S1", "C1"] * 2
    assert (points["frames"] == 200).all() and (points["samples"] == 20).all()
    assert (points["frames_lost"] == 0).all()
    # surface A and its variant at 20 deg/s and 25 degC are off by 1.6 and 1.5 deg/s at most
    assert points["rate_mean_dps"].between(20.0, 22.0).all()
    assert abs(points["rate_readback_dps"] - 20.0).max() < 0.05
    # an acquisition of 2 s took 2 s on the wall
    assert ((points["ended_at_s"] - points["started_at_s"]) - 2.0).abs().max() < 0.6


@pytest.mark.wall
def test_a_port_pulled_before_the_run_is_told_plainly(tmp_path: Path) -> None:
    channel = f"test-{uuid.uuid4()}"
    with LiveBench(SPEC, channel) as live:
        live.unplug("chamber")
        with pytest.raises(BenchFailure) as failure:
            run_live(tmp_path, live, channel)
    assert live.ttys["chamber"] in str(failure.value)
    assert not (tmp_path / "results" / "live").exists()


@pytest.mark.wall
def test_an_instrument_that_speaks_another_protocol_is_recognised(tmp_path: Path) -> None:
    channel = f"test-{uuid.uuid4()}"
    with LiveBench(SPEC, channel) as live:
        live.ttys["chamber"], live.ttys["S1"] = live.ttys["S1"], live.ttys["chamber"]
        with pytest.raises(BenchFailure, match="looks like a KVH gyro stream") as failure:
            run_live(tmp_path, live, channel)
    assert live.ttys["chamber"] in str(failure.value)
    assert not (tmp_path / "results" / "live").exists()
