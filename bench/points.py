"""Points: one row per DUT and condition, its verdict, and the two files that hold all of them."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.journal import Entry
from bench.procedure.conditions import Quality
from bench.procedure.plan import PlannedStep
from bench.reduction import PointStatistics, held_frames
from bench.replacement import begins_anew, joined
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
    "rate_worst_dps",
    "rate_reference_dps",
    "rate_mean_dps",
    "rate_std_dps",
    "rate_mean_u_dps",
    "noise_ratio",
    "samples",
    "frames",
    "frames_lost",
    "duplicates",
    "bad_checksum",
    "skipped_bytes",
    "resyncs",
    "frames_held",
    "spikes",
    "outliers",
    "started_at_s",
    "ended_at_s",
    "verdict",
    "reasons",
)

TEXT_COLUMNS = ("dut", "verdict", "reasons")

# Rows of journals from before these were counted have none.
_NOT_COUNTED: Row = {"frames_held": 0, "spikes": 0}

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


@dataclass(frozen=True)
class Figures:
    """What a point is made of beside its statistics.

    spikes: frames left out as such. chamber_degc, rates_dps: readbacks during the acquisition. typical_std_dps: the
    DUT's usual noise at such a point, None if not known yet.
    """

    planned_samples: int
    planned_frames: int
    frames: FrameBatch
    losses: Losses
    spikes: int
    chamber_degc: Sequence[float]
    rates_dps: Sequence[float]
    typical_std_dps: float | None
    started_at_s: float
    ended_at_s: float


def point_row(
    step: PlannedStep,
    dut: str,
    statistics: PointStatistics | None,
    figures: Figures,
    earth_rate_dps: float,
    quality: Quality,
) -> Row:
    """One row of points.csv. The reference rate is the table's setpoint plus the vertical earth rate, if known."""
    s, f, losses = statistics, figures, figures.losses
    setpoint, typical = step.rate_dps, f.typical_std_dps
    row: Row = {
        "point": step.point,
        "dut": dut,
        "dwell": step.dwell,
        "chamber_setpoint_degc": step.temperature_degc,
        "chamber_readback_degc": _mean(f.chamber_degc),
        "dut_temperature_degc": s and s.dut_temperature_degc,
        "dut_temperature_slope_degc_min": s and s.dut_temperature_slope_degc_min,
        "dut_temperature_slope_u_degc_min": s and s.dut_temperature_slope_u_degc_min,
        "rate_setpoint_dps": setpoint,
        "rate_readback_dps": _mean(f.rates_dps),
        "rate_worst_dps": _farthest(f.rates_dps, setpoint),
        "rate_reference_dps": None if setpoint is None else setpoint + earth_rate_dps,
        "rate_mean_dps": s and s.rate_mean_dps,
        "rate_std_dps": s and s.rate_std_dps,
        "rate_mean_u_dps": s and s.rate_mean_u_dps,
        "noise_ratio": s.rate_std_dps / typical if s and typical else None,
        "samples": s.samples if s else 0,
        "frames": len(f.frames.index),
        "frames_lost": f.planned_frames - len(f.frames.index),
        "duplicates": losses.duplicates,
        "bad_checksum": losses.bad_checksum,
        "skipped_bytes": losses.skipped_bytes,
        "resyncs": losses.resyncs,
        "frames_held": held_frames(f.frames.columns["rate"]) if f.frames.columns else 0,
        "spikes": f.spikes,
        "outliers": s.outliers if s else 0,
        "started_at_s": f.started_at_s,
        "ended_at_s": f.ended_at_s,
    }
    row |= {key: _rounded(key, value) for key, value in row.items()}
    row["verdict"], row["reasons"] = judge(row, f, quality)
    return row


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _farthest(values: Sequence[float], setpoint: float | None) -> float | None:
    """The readback farthest from the setpoint."""
    return max(values, key=lambda value: abs(value - setpoint)) if values and setpoint is not None else None


def _rounded(key: str, value: Any) -> Any:
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    return round(value, digits_of(key))


def digits_of(column: str) -> int:
    """Digits kept behind the point in a column."""
    return max((digits for suffix, digits in _DIGITS.items() if column.endswith(suffix)), default=9)


def judge(row: Row, figures: Figures, quality: Quality) -> tuple[str, str]:
    """The verdict pass, marginal or fail with its reasons.

    Each figure is compared with its limit: above it the point is marginal, above `fail_at` times it the point fails. A
    point without samples, or whose output never changed (unless a dead band is looked for), fails outright: a frozen
    gyro has a valid checksum. What was to be measured and was not makes a point marginal (law 9).
    """
    if not row["samples"]:
        return "fail", "no samples"
    frozen = bool(row["frames_held"]) and row["frames_held"] == row["frames"] - 1
    if frozen and quality.frozen == "fail":
        return "fail", "output frozen"
    checks = _checks(row, figures, quality)
    reasons = [
        f"{name} {value:.4g} over {limit:g} {unit}".rstrip() for name, value, limit, unit in checks if value > limit
    ]
    if frozen:
        reasons.append("output frozen")
    if row["dut_temperature_slope_u_degc_min"] is None:
        reasons.append("DUT temperature slope not measured")
    if row["rate_setpoint_dps"] is not None and row["rate_readback_dps"] is None:
        reasons.append("table rate not measured")
    failed = any(value > limit * quality.fail_at for _, value, limit, _ in checks)
    return ("fail" if failed else "marginal" if reasons else "pass"), "; ".join(reasons)


def _checks(row: Row, figures: Figures, quality: Quality) -> list[tuple[str, float, float, str]]:
    """Name, figure, limit and unit of everything a point is judged by."""
    of_frames, lost_ppm = 1e6 / figures.planned_frames, quality.lost_ppm
    invalid = np.count_nonzero(~figures.frames.good)
    checks = [
        ("frames lost", row["frames_lost"] * of_frames, lost_ppm, "ppm"),
        ("frames invalid by their status", invalid * of_frames, lost_ppm, "ppm"),
        ("frames frozen", row["frames_held"] * of_frames, _held_ppm(quality), "ppm"),
        ("spikes", row["spikes"] * of_frames, quality.spikes_ppm, "ppm"),
        ("outliers", row["outliers"] / figures.planned_samples * 1e6, quality.outliers_ppm, "ppm"),
        ("noise against the DUT's own", _certain_ratio(row), quality.noise_ratio, ""),
        ("DUT temperature slope", _certain_slope(row), quality.slope_degc_min, "degC/min"),
    ]
    if row["rate_readback_dps"] is not None and row["rate_setpoint_dps"] is not None:
        mean, worst = (abs(row[key] - row["rate_setpoint_dps"]) for key in ("rate_readback_dps", "rate_worst_dps"))
        checks.append(("table off its rate", mean, quality.rate_band_dps, "deg/s"))
        checks.append(("table off its rate at one time", worst, quality.rate_worst_dps, "deg/s"))
    return checks


def _held_ppm(quality: Quality) -> float:
    """Frames that may be held; in a dead band any number."""
    return quality.lost_ppm if quality.frozen == "fail" else math.inf


def _certain_ratio(row: Row) -> float:
    """The noise ratio less what chance adds: three standard errors of a standard deviation, 1/√(2(n-1)) of it each."""
    ratio, n = row["noise_ratio"], row["samples"]
    return 0.0 if ratio is None or n < 2 else float(ratio / (1.0 + 3.0 / math.sqrt(2.0 * (n - 1))))


def _certain_slope(row: Row) -> float:
    """The part of the temperature slope that is not within two standard uncertainties of none.

    A short acquisition cannot tell a slope from the resolution of the sensor, and is not blamed for it.
    """
    slope, u = row["dut_temperature_slope_degc_min"], row["dut_temperature_slope_u_degc_min"]
    return 0.0 if slope is None or u is None else max(0.0, abs(slope) - 2.0 * u)


def finished_rows(entries: Iterable[Entry]) -> list[Row]:
    """The rows of acquisitions that were finished, the last one of each; those of one broken off are dropped."""
    parts: list[list[Row]] = [[]]
    pending: list[Row] = []
    for entry in entries:
        if entry["kind"] == "point":
            pending.append(entry["row"])
        elif entry["kind"] == "done":
            parts[-1] += pending
            pending = []
        elif entry["kind"] in ("step", "resumed"):
            pending = []
            parts += [[]] if begins_anew(entry) else []
    return joined(parts)


def points_of(entries: Iterable[Entry]) -> pd.DataFrame:
    """The points of a journal in the order measured (a fold of it)."""
    import pandas as pd

    rows = [_NOT_COUNTED | row for row in finished_rows(entries)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    whole = {"point", "dwell", "samples", "frames", "frames_lost", "duplicates", "bad_checksum", "skipped_bytes"}
    whole |= {"resyncs", "frames_held", "spikes", "outliers"}
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
