"""Points: one row per DUT and condition, its verdict, and the two files that hold all of them."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.journal import Entry
from bench.procedure.language import Quality
from bench.procedure.plan import PlannedStep
from bench.reduction import PointStatistics
from bench.runfolder import write_atomic
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses

if TYPE_CHECKING:
    import pandas as pd

Row = dict[str, Any]

COLUMNS = (
    "point",
    "dut",
    "dwell",
    "chamber_setpoint_degc",
    "chamber_readback_degc",
    "dut_temperature_degc",
    "dut_temperature_slope_degc_min",
    "dut_temperature_slope_u_degc_min",
    "rate_setpoint_dps",
    "rate_readback_dps",
    "rate_reference_dps",
    "rate_mean_dps",
    "rate_std_dps",
    "rate_mean_u_dps",
    "samples",
    "frames",
    "frames_lost",
    "duplicates",
    "bad_checksum",
    "skipped_bytes",
    "resyncs",
    "outliers",
    "started_at_s",
    "ended_at_s",
    "verdict",
    "reasons",
)

TEXT_COLUMNS = ("dut", "verdict", "reasons")

# Column of timeline.parquet -> field of a readback record.
_READBACKS = {
    "t_s": "t_s",
    "chamber_setpoint_degc": "chamber_setpoint_degc",
    "chamber_readback_degc": "chamber_degc",
    "rate_setpoint_dps": "rate_setpoint_dps",
    "rate_readback_dps": "rate_dps",
}

# Digits kept: to 1e-10 deg/s, 1e-6 degC, 1e-8 degC/min and 1e-6 s, below any figure that is reported.
_DIGITS = {"_dps": 10, "_degc": 6, "_degc_min": 8, "_s": 6}


def point_row(
    step: PlannedStep,
    dut: str,
    statistics: PointStatistics | None,
    planned_samples: int,
    planned_frames: int,
    frames: FrameBatch,
    losses: Losses,
    chamber_degc: float | None,
    rate_dps: float | None,
    earth_rate_dps: float,
    started_at_s: float,
    ended_at_s: float,
    quality: Quality,
) -> Row:
    """One row of points.csv. The reference rate is the table's setpoint plus the vertical earth rate, if known."""
    s = statistics
    setpoint = step.rate_dps
    row: Row = {
        "point": step.point,
        "dut": dut,
        "dwell": step.dwell,
        "chamber_setpoint_degc": step.temperature_degc,
        "chamber_readback_degc": chamber_degc,
        "dut_temperature_degc": s and s.dut_temperature_degc,
        "dut_temperature_slope_degc_min": s and s.dut_temperature_slope_degc_min,
        "dut_temperature_slope_u_degc_min": s and s.dut_temperature_slope_u_degc_min,
        "rate_setpoint_dps": setpoint,
        "rate_readback_dps": rate_dps,
        "rate_reference_dps": None if setpoint is None else setpoint + earth_rate_dps,
        "rate_mean_dps": s and s.rate_mean_dps,
        "rate_std_dps": s and s.rate_std_dps,
        "rate_mean_u_dps": s and s.rate_mean_u_dps,
        "samples": s.samples if s else 0,
        "frames": len(frames.index),
        "frames_lost": planned_frames - len(frames.index),
        "duplicates": losses.duplicates,
        "bad_checksum": losses.bad_checksum,
        "skipped_bytes": losses.skipped_bytes,
        "resyncs": losses.resyncs,
        "outliers": s.outliers if s else 0,
        "started_at_s": started_at_s,
        "ended_at_s": ended_at_s,
    }
    row |= {key: _rounded(key, value) for key, value in row.items()}
    row["verdict"], row["reasons"] = judge(row, frames, planned_samples, planned_frames, quality)
    return row


def _rounded(key: str, value: Any) -> Any:
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    return round(value, digits_of(key))


def digits_of(column: str) -> int:
    """Digits kept behind the point in a column."""
    return max((digits for suffix, digits in _DIGITS.items() if column.endswith(suffix)), default=9)


def judge(row: Row, frames: FrameBatch, planned_samples: int, planned_frames: int, quality: Quality) -> tuple[str, str]:
    """The verdict pass, marginal or fail with its reasons.

    Each figure is compared with its limit: above it the point is marginal, above `fail_at` times it the point fails. A
    point without samples, or whose output never changed, fails outright: a frozen gyro has a valid checksum.
    """
    if not row["samples"]:
        return "fail", "no samples"
    raw = frames.columns["rate"]
    if len(raw) > 10 and (raw == raw[0]).all():
        return "fail", "output frozen"
    invalid = np.count_nonzero(~frames.good)
    checks = [
        ("frames lost", row["frames_lost"] / planned_frames * 1e6, quality.lost_ppm, "ppm"),
        ("frames invalid by their status", invalid / planned_frames * 1e6, quality.lost_ppm, "ppm"),
        ("outliers", row["outliers"] / planned_samples * 1e6, quality.outliers_ppm, "ppm"),
        ("DUT temperature slope", _certain_slope(row), quality.slope_degc_min, "degC/min"),
    ]
    if row["rate_readback_dps"] is not None and row["rate_setpoint_dps"] is not None:
        off_rate = abs(row["rate_readback_dps"] - row["rate_setpoint_dps"])
        checks.append(("table off its rate", off_rate, quality.rate_band_dps, "deg/s"))
    reasons = [f"{name} {value:.4g} over {limit:g} {unit}" for name, value, limit, unit in checks if value > limit]
    if row["dut_temperature_slope_u_degc_min"] is None:
        reasons.append("DUT temperature slope not measured")
    failed = any(value > limit * quality.fail_at for _, value, limit, _ in checks)
    return ("fail" if failed else "marginal" if reasons else "pass"), "; ".join(reasons)


def _certain_slope(row: Row) -> float:
    """The part of the temperature slope that is not within two standard uncertainties of none.

    A short acquisition cannot tell a slope from the resolution of the sensor, and is not blamed for it.
    """
    slope, u = row["dut_temperature_slope_degc_min"], row["dut_temperature_slope_u_degc_min"]
    return 0.0 if slope is None or u is None else max(0.0, abs(slope) - 2.0 * u)


def finished_rows(entries: Iterable[Entry]) -> list[Row]:
    """The rows of acquisitions that were finished; those of one that was broken off are dropped, never mixed."""
    rows: list[Row] = []
    pending: list[Row] = []
    for entry in entries:
        if entry["kind"] == "point":
            pending.append(entry["row"])
        elif entry["kind"] == "done":
            rows += pending
            pending = []
        elif entry["kind"] in ("step", "resumed"):
            pending = []
    return rows


def points_of(entries: Iterable[Entry]) -> pd.DataFrame:
    """The points of a journal in the order measured (a fold of it)."""
    import pandas as pd

    rows = finished_rows(entries)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    whole = {"point", "dwell", "samples", "frames", "frames_lost", "duplicates", "bad_checksum", "skipped_bytes"}
    whole |= {"resyncs", "outliers"}
    kinds = {name: "str" if name in TEXT_COLUMNS else "int64" if name in whole else "float64" for name in COLUMNS}
    typed: pd.DataFrame = table.astype(kinds)
    return typed


def timeline_of(entries: Iterable[Entry]) -> pd.DataFrame:
    """The readbacks of a journal, one row each, DUT temperatures in columns `temperature_degc:<dut>`."""
    import pandas as pd

    rows = []
    for entry in entries:
        if entry["kind"] == "readback":
            temperatures = {f"temperature_degc:{dut}": degc for dut, degc in entry["dut_degc"].items()}
            rows.append({name: entry.get(key) for name, key in _READBACKS.items()} | temperatures)
    duts = dict.fromkeys(name for row in rows for name in row if name not in _READBACKS)
    return pd.DataFrame(rows, columns=[*_READBACKS, *duts]).astype("float64")


def write_points(folder: Path, points: pd.DataFrame) -> None:
    """Write points.csv and points.parquet."""
    write_atomic(folder / "points.csv", points.to_csv(index=False, lineterminator="\n").encode())
    write_table(folder / "points.parquet", points)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table as Parquet, whole or not at all."""
    buffer = io.BytesIO()
    table.to_parquet(buffer, index=False, compression="zstd")
    write_atomic(path, buffer.getvalue())


def usable(points: pd.DataFrame, dut: str) -> pd.DataFrame:
    """The points of a DUT that a fit may use: measured and not failed."""
    needed = ["dut_temperature_degc", "rate_mean_dps", "rate_reference_dps", "rate_mean_u_dps"]
    mine = (points["dut"] == dut) & (points["verdict"] != "fail")
    measured = np.isfinite(points[needed].to_numpy()).all(axis=1)
    kept: pd.DataFrame = points.loc[mine & measured].reset_index(drop=True)
    return kept
