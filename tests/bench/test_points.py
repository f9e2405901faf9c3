"""Rows of points.csv, their verdicts, and the two folds of the journal."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bench.errors import Mark
from bench.journal import Entry
from bench.points import (
    COLUMNS,
    Figures,
    judge,
    point_row,
    points_of,
    timeline_of,
    usable,
    write_points,
    write_table,
)
from bench.procedure.conditions import Quality
from bench.procedure.language import Acquire
from bench.procedure.plan import PlannedStep
from bench.reduction import PointStatistics
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses

STEP = PlannedStep(
    number=12,
    verb="acquire",
    args=Acquire.model_validate({"count": 100, "every": "0.1 s"}),
    mark=Mark("p.yaml", 3, 5),
    dwell=2,
    temperature_degc=-25.0,
    rate_dps=-180.0,
    point=38,
)
STATISTICS = PointStatistics(
    rate_mean_dps=-179.123456789012345,
    rate_std_dps=0.0123,
    rate_mean_u_dps=0.00123,
    samples=100,
    outliers=0,
    dut_temperature_degc=-24.87654321,
    dut_temperature_slope_degc_min=0.012345678901,
    dut_temperature_slope_u_degc_min=0.001,
)
QUALITY = Quality.model_validate(
    {"lost": "1000 ppm", "outliers": "5000 ppm", "slope": "0.05 degC/min", "rate_band": "0.02 deg/s", "fail_at": 5}
)
PLANNED = 10_000


def batch(n: int = PLANNED, frozen: bool = False, bad: int = 0) -> FrameBatch:
    raw = np.zeros(n, np.float32) if frozen else np.arange(n, dtype=np.float32)
    good = np.arange(n) >= bad
    return FrameBatch({"rate": raw}, np.arange(n), raw.astype(float), np.zeros(n), good)


FIGURES = Figures(
    planned_samples=100,
    planned_frames=PLANNED,
    frames=batch(),
    losses=Losses(frames=9, lost=3, duplicates=4, bad_checksum=5, skipped_bytes=6, resyncs=7, bad_status=8),
    spikes=0,
    chamber_degc=[-25.02, -25.04],
    rates_dps=[-180.0017, -179.9957],
    typical_std_dps=0.01,
    started_at_s=1000.0,
    ended_at_s=1010.1234567,
)


def row_of(
    statistics: PointStatistics | None = STATISTICS,
    step: PlannedStep = STEP,
    dut: str = "FOG-A",
    quality: Quality = QUALITY,
    **changes: Any,
) -> dict[str, Any]:
    return point_row(step, dut, statistics, replace(FIGURES, **changes), earth_rate_dps=0.0029545, quality=quality)


def test_a_row_has_every_column_in_order_and_the_right_figure_in_each() -> None:
    row = row_of()
    assert tuple(row) == COLUMNS
    assert row == {
        "point": 38,
        "dut": "FOG-A",
        "dwell": 2,
        "chamber_setpoint_degc": -25.0,
        "chamber_readback_degc": -25.03,
        "dut_temperature_degc": -24.876543,
        "dut_temperature_slope_degc_min": 0.01234568,
        "dut_temperature_slope_u_degc_min": 0.001,
        "rate_setpoint_dps": -180.0,
        "rate_readback_dps": -179.9987,
        "rate_worst_dps": -179.9957,
        "rate_reference_dps": -179.9970455,
        "rate_mean_dps": -179.123456789,
        "rate_std_dps": 0.0123,
        "rate_mean_u_dps": 0.00123,
        "noise_ratio": 1.23,
        "samples": 100,
        "frames": 10_000,
        "frames_lost": 0,
        "duplicates": 4,
        "bad_checksum": 5,
        "skipped_bytes": 6,
        "resyncs": 7,
        "frames_held": 0,
        "spikes": 0,
        "outliers": 0,
        "started_at_s": 1000.0,
        "ended_at_s": 1010.123457,
        "verdict": "pass",
        "reasons": "",
    }


def test_the_columns_of_the_run_folder_are_there() -> None:
    """The least that every points.csv has, in this order (issue 2, item 8)."""
    promised = [
        *("point", "dut", "chamber_setpoint_degc", "chamber_readback_degc", "dut_temperature_degc"),
        *("dut_temperature_slope_degc_min", "rate_setpoint_dps", "rate_readback_dps", "rate_mean_dps", "rate_std_dps"),
        *("rate_mean_u_dps", "samples", "frames_lost", "outliers", "started_at_s", "ended_at_s", "verdict"),
    ]
    assert [name for name in COLUMNS if name in promised] == promised


def test_a_point_without_samples_is_a_row_of_nothing_that_failed() -> None:
    row = row_of(None, frames=FrameBatch.empty())
    assert (row["verdict"], row["reasons"]) == ("fail", "no samples")
    assert (row["samples"], row["frames"], row["frames_lost"], row["outliers"]) == (0, 0, PLANNED, 0)
    assert row["rate_mean_dps"] is None
    assert row["dut_temperature_degc"] is None


def test_what_is_no_number_is_nothing() -> None:
    row = row_of(replace(STATISTICS, rate_std_dps=math.nan, dut_temperature_slope_u_degc_min=math.inf))
    assert row["rate_std_dps"] is None
    assert row["dut_temperature_slope_u_degc_min"] is None


def test_a_bench_without_a_table_has_no_reference() -> None:
    row = row_of(step=replace(STEP, rate_dps=None, temperature_degc=None), rates_dps=[], chamber_degc=[])
    assert row["rate_reference_dps"] is None
    assert row["rate_setpoint_dps"] is row["rate_worst_dps"] is None
    assert row["verdict"] == "pass"


@pytest.mark.parametrize(
    ("lost", "verdict"),
    [(0, "pass"), (10, "pass"), (11, "marginal"), (50, "marginal"), (51, "fail"), (9000, "fail")],
)
def test_lost_frames(lost: int, verdict: str) -> None:
    """1000 ppm of 10 000 frames are 10; five times that fails."""
    row = row_of(frames=batch(PLANNED - lost))
    assert (row["frames_lost"], row["verdict"]) == (lost, verdict)
    if verdict != "pass":
        assert row["reasons"] == f"frames lost {lost * 100:.4g} over 1000 ppm"


@pytest.mark.parametrize(("bad", "verdict"), [(0, "pass"), (10, "pass"), (11, "marginal"), (51, "fail")])
def test_frames_that_say_they_are_not_valid_count_like_lost_ones(bad: int, verdict: str) -> None:
    row = row_of(frames=batch(bad=bad))
    assert (row["frames_lost"], row["verdict"]) == (0, verdict)
    assert ("frames invalid by their status" in row["reasons"]) is (verdict != "pass")


@pytest.mark.parametrize(("outliers", "verdict"), [(0, "pass"), (1, "marginal"), (2, "marginal"), (3, "fail")])
def test_outliers(outliers: int, verdict: str) -> None:
    """5000 ppm of 100 samples are half a sample, five times that two and a half."""
    assert row_of(replace(STATISTICS, outliers=outliers))["verdict"] == verdict


@pytest.mark.parametrize(
    ("slope", "u", "verdict"),
    [
        (0.05, 0.0, "pass"),
        (-0.051, 0.0, "marginal"),
        (0.249, 0.0, "marginal"),
        (-0.251, 0.0, "fail"),
        (0.1, 0.03, "pass"),
        (0.1, 0.02, "marginal"),
        (5.0, math.inf, "marginal"),
        (math.nan, math.nan, "marginal"),
    ],
)
def test_a_temperature_that_still_moves(slope: float, u: float, verdict: str) -> None:
    statistics = replace(STATISTICS, dut_temperature_slope_degc_min=slope, dut_temperature_slope_u_degc_min=u)
    row = row_of(statistics)
    assert row["verdict"] == verdict
    assert ("DUT temperature slope" in row["reasons"]) is (verdict != "pass")


@pytest.mark.parametrize(
    ("readback", "verdict"),
    [
        (-180.02, "pass"),
        (-179.98, "pass"),
        (-180.03, "marginal"),
        (-179.91, "marginal"),
        (-179.89, "fail"),
        (180, "fail"),
    ],
)
def test_a_table_off_its_rate(readback: float, verdict: str) -> None:
    # The band has a hair more than 0.02, which no sum of decimals reaches exactly.
    quality = QUALITY.model_copy(update={"rate_band_dps": 0.0200001})
    assert row_of(rates_dps=[float(readback)], quality=quality)["verdict"] == verdict


@pytest.mark.parametrize(
    ("worst", "verdict"), [(-180.09, "pass"), (-180.11, "marginal"), (-179.51, "marginal"), (-179.49, "fail")]
)
def test_a_table_that_left_its_rate_for_a_moment(worst: float, verdict: str) -> None:
    """The mean of all readbacks is as it should be; the one that is farthest off is judged by its own limit."""
    row = row_of(rates_dps=[-180.0] * 300 + [worst])
    assert row["rate_worst_dps"] == worst and abs(row["rate_readback_dps"] + 180.0) < 0.01
    assert row["verdict"] == verdict
    assert ("table off its rate at one time" in row["reasons"]) is (verdict != "pass")


def test_a_rate_that_was_commanded_and_not_read_back_is_not_passed() -> None:
    row = row_of(rates_dps=[])
    assert (row["verdict"], row["reasons"]) == ("marginal", "table rate not measured")


@pytest.mark.parametrize(("spikes", "verdict"), [(0, "pass"), (10, "pass"), (11, "marginal"), (51, "fail")])
def test_spikes(spikes: int, verdict: str) -> None:
    """1000 ppm of 10 000 frames are 10."""
    row = row_of(spikes=spikes)
    assert (row["spikes"], row["verdict"]) == (spikes, verdict)
    assert ("spikes" in row["reasons"]) is (verdict != "pass")


@pytest.mark.parametrize(
    ("std", "samples", "verdict"),
    [
        (0.02, 1000, "pass"),
        (0.0213, 1000, "pass"),
        (0.0215, 1000, "marginal"),
        (0.1, 1000, "marginal"),
        (0.108, 1000, "fail"),
        (0.034, 10, "pass"),  # ten samples may do that by chance
        (0.0349, 9, "pass"),
        (0.0345, 10, "marginal"),
    ],
)
def test_noise_against_the_duts_own(std: float, samples: int, verdict: str) -> None:
    """Twice the usual 0.01 is marginal, ten times fails; less three standard errors, 1 + 3/√(2 · 999) = 1.067."""
    row = row_of(replace(STATISTICS, rate_std_dps=std, samples=samples), typical_std_dps=0.01)
    assert row["noise_ratio"] == pytest.approx(std / 0.01)
    assert row["verdict"] == verdict
    assert ("noise against the DUT's own" in row["reasons"]) is (verdict != "pass")


def test_without_a_history_noise_is_not_judged() -> None:
    row = row_of(replace(STATISTICS, rate_std_dps=100.0), typical_std_dps=None)
    assert row["noise_ratio"] is None and row["verdict"] == "pass"


@pytest.mark.parametrize(("held", "verdict"), [(1000, "fail"), (41, "marginal"), (0, "pass")])
def test_an_output_that_froze_for_a_while(held: int, verdict: str) -> None:
    raw = np.arange(PLANNED, dtype=np.float32)
    raw[5000 : 5000 + held] = raw[5000]
    row = row_of(frames=replace(batch(), columns={"rate": raw}))
    assert (row["frames_held"], row["verdict"]) == (max(0, held - 1), verdict)
    assert ("frames frozen" in row["reasons"]) is (verdict != "pass")


def test_a_gyro_that_froze_fails_though_its_frames_are_good() -> None:
    row = row_of(frames=batch(frozen=True))
    assert (row["verdict"], row["reasons"]) == ("fail", "output frozen")
    assert row["frames_held"] == PLANNED - 1
    few = batch(10, frozen=True)
    assert "frozen" not in row_of(frames=few, planned_frames=10)["reasons"]


def test_in_a_scan_through_a_dead_band_a_still_output_is_told_and_does_not_fail() -> None:
    allowed = QUALITY.model_copy(update={"frozen": "marginal"})
    row = row_of(frames=batch(frozen=True), quality=allowed)
    assert (row["verdict"], row["reasons"]) == ("marginal", "output frozen")
    lost = row_of(frames=batch(PLANNED - 60, frozen=True), quality=allowed)
    assert lost["verdict"] == "fail" and lost["reasons"] == "frames lost 6000 over 1000 ppm; output frozen"
    raw = np.arange(PLANNED, dtype=np.float32)
    raw[5000:6000] = raw[5000]
    assert row_of(frames=replace(batch(), columns={"rate": raw}), quality=allowed)["verdict"] == "pass"


def test_all_reasons_are_told_and_the_worst_decides() -> None:
    row = row_of(replace(STATISTICS, outliers=1), frames=batch(PLANNED - 60))
    assert row["verdict"] == "fail"
    assert row["reasons"] == "frames lost 6000 over 1000 ppm; outliers 1e+04 over 5000 ppm"


def test_limits_of_nothing_fail_at_the_first_loss() -> None:
    quality = Quality.model_validate({"lost": "0 ppm", "outliers": "0 ppm"})
    assert row_of(quality=quality)["verdict"] == "pass"
    assert judge(row_of() | {"frames_lost": 1}, FIGURES, quality)[0] == "fail"


def entries() -> list[Entry]:
    rows = [
        row_of(step=replace(STEP, point=2)),
        row_of(None, frames=FrameBatch.empty(), dut="FOG-B", chamber_degc=[]),
        row_of(step=replace(STEP, point=1), started_at_s=2000.0),
    ]
    return [
        {"n": 0, "t_s": 0.0, "kind": "journal"},
        {"n": 1, "t_s": 1.0, "kind": "readback", "dut_degc": {}, "chamber_setpoint_degc": None, "chamber_degc": 24.9},
        {"n": 2, "t_s": 2.0, "kind": "point", "row": rows[0]},
        {
            "n": 3,
            "t_s": 3.5,
            "kind": "readback",
            "dut_degc": {"FOG-B": 25.5, "FOG-A": 25.25},
            "chamber_setpoint_degc": -30.0,
            "chamber_degc": 24.8,
            "rate_setpoint_dps": 0.0,
            "rate_dps": 0.001,
        },
        {"n": 4, "t_s": 4.0, "kind": "point", "row": rows[1]},
        {"n": 5, "t_s": 5.0, "kind": "note", "text": "x"},
        {"n": 6, "t_s": 6.0, "kind": "point", "row": rows[2]},
        {"n": 7, "t_s": 6.0, "kind": "done", "step": 38},
        # Broken off: neither done nor to be mixed with what follows.
        {"n": 8, "t_s": 7.0, "kind": "point", "row": rows[0]},
        {"n": 9, "t_s": 8.0, "kind": "resumed", "text": "x"},
        {"n": 10, "t_s": 9.0, "kind": "point", "row": rows[0]},
    ]


def test_points_are_in_the_order_of_the_plan_with_types_that_hold() -> None:
    points = points_of(entries())
    assert list(points.columns) == list(COLUMNS)
    assert points["point"].tolist() == [1, 2, 38]
    assert points["started_at_s"].tolist() == [2000.0, 1000.0, 1000.0]
    assert points["samples"].dtype == np.int64
    assert math.isnan(points["rate_mean_dps"][2])
    assert math.isnan(points["chamber_readback_degc"][2])
    assert points["rate_mean_dps"].dtype == np.float64
    assert points["verdict"].tolist() == ["pass", "pass", "fail"]


def test_a_run_without_points_or_readbacks_still_has_tables() -> None:
    points = points_of([{"n": 0, "t_s": 0.0, "kind": "journal"}])
    assert list(points.columns) == list(COLUMNS)
    assert len(points) == 0
    assert points["rate_mean_dps"].dtype == np.float64
    timeline = timeline_of([])
    assert len(timeline) == 0
    assert "t_s" in timeline.columns
    assert "chamber_readback_degc" in timeline.columns


def test_the_timeline_has_a_row_a_readback_and_a_column_a_dut() -> None:
    timeline = timeline_of(entries())
    assert list(timeline.columns) == [
        "t_s",
        "chamber_setpoint_degc",
        "chamber_readback_degc",
        "rate_setpoint_dps",
        "rate_readback_dps",
        "temperature_degc:FOG-B",
        "temperature_degc:FOG-A",
    ]
    nan = math.nan
    np.testing.assert_array_equal(
        timeline.to_numpy(), [[1.0, nan, 24.9, nan, nan, nan, nan], [3.5, -30.0, 24.8, 0.0, 0.001, 25.5, 25.25]]
    )


def test_both_files_hold_the_same_points(tmp_path: Path) -> None:
    points = points_of(entries())
    write_points(tmp_path, points)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["points.csv", "points.parquet"]
    text = (tmp_path / "points.csv").read_bytes().decode()
    lines = text.split("\n")
    assert lines[0] == ",".join(COLUMNS)
    assert lines[1].startswith("1,FOG-A,2,-25.0,-25.03,-24.876543,0.01234568,0.001,-180.0,-179.9987,")
    assert len(lines) == 5
    assert "\r" not in text
    from_csv = list(csv.DictReader(text.splitlines()))
    from_parquet = pd.read_parquet(tmp_path / "points.parquet")
    for name in COLUMNS:
        if points[name].dtype.kind in "if":
            np.testing.assert_array_equal([float(line[name] or "nan") for line in from_csv], points[name])
            np.testing.assert_array_equal(from_parquet[name], points[name])
    assert from_parquet["reasons"].tolist() == ["", "", "no samples"]


def test_the_same_points_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_points(tmp_path / name, points_of(entries()))
    for name in ("points.csv", "points.parquet"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_any_table_can_be_written(tmp_path: Path) -> None:
    table = timeline_of(entries())
    write_table(tmp_path / "t.parquet", table)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "t.parquet"), table)


def test_a_fit_uses_what_was_measured_and_did_not_fail() -> None:
    rows = [
        row_of(step=replace(STEP, point=1)),
        row_of(step=replace(STEP, point=2), dut="FOG-B"),
        row_of(None, frames=FrameBatch.empty(), step=replace(STEP, point=3)),
        row_of(replace(STATISTICS, dut_temperature_degc=math.nan), step=replace(STEP, point=4)),
        row_of(replace(STATISTICS, rate_mean_u_dps=math.nan), step=replace(STEP, point=5)),
        row_of(step=replace(STEP, point=6, rate_dps=None), rates_dps=[]),
        row_of(step=replace(STEP, point=7), frames=batch(PLANNED - 20)),
        row_of(step=replace(STEP, point=8), frames=batch(PLANNED - 2000)),
    ]
    points = points_of([*({"kind": "point", "row": row} for row in rows), {"kind": "done", "step": 8}])
    assert points["verdict"].tolist() == ["pass", "pass", "fail", "pass", "pass", "pass", "marginal", "fail"]
    assert usable(points, "FOG-A")["point"].tolist() == [1, 7]
    assert usable(points, "FOG-A").index.tolist() == [0, 1]
    assert usable(points, "FOG-B")["point"].tolist() == [2]
    assert len(usable(points, "nobody")) == 0
