"""The report's tables about the data: what arrived, what was lost, and the points to look at."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from bench.report.data import DutData, ReportData
from bench.report.formats import MISSING, count, duration, fixed, setpoint, significant, unbroken
from bench.report.tables import Cell, Column, Table, table

WORST_POINTS_SHOWN = 40
LINKS_SHOWN = 40
SLOPE, SLOPE_U = "dut_temperature_slope_degc_min", "dut_temperature_slope_u_degc_min"
# Columns of points.csv that tell a damaged stream from one that lost whole frames.
DAMAGE = {"resyncs": "resynchronisations", "skipped_bytes": "bytes skipped", "bad_checksum": "bad checksums"}


def quality(data: ReportData) -> Table:
    """One column per DUT: what arrived, what was lost, and how good the points are."""
    lines: list[tuple[str, Callable[[DutData], str]]] = [
        ("frames received", lambda dut: _stream(data, dut, "frames", "frames")),
        ("frames lost (sequence gaps)", lambda dut: _stream(data, dut, "lost", "frames_lost")),
        ("duplicate frames", lambda dut: _stream(data, dut, "duplicates", "duplicates")),
        ("bad checksums", lambda dut: _stream(data, dut, "bad_checksum", "bad_checksum")),
        ("frames with bad status", lambda dut: _stream(data, dut, "bad_status", None)),
        ("resynchronisations", lambda dut: _stream(data, dut, "resyncs", "resyncs")),
        ("bytes skipped by them", lambda dut: _stream(data, dut, "skipped_bytes", "skipped_bytes")),
        ("frames lost inside points", lambda dut: count(float(dut.points["frames_lost"].sum()))),
        ("frames of a frozen output", lambda dut: count(float(dut.points["frames_held"].sum()))),
        ("spikes left out", lambda dut: count(float(dut.points["spikes"].sum()))),
        ("outliers left out", lambda dut: count(float(dut.points["outliers"].sum()))),
        *((f"points with verdict {word}", _counter(word)) for word in ("pass", "marginal", "fail")),
        ("largest standard uncertainty, °/s", lambda dut: significant(_largest(dut.points["rate_mean_u_dps"]), 2)),
        ("steepest temperature slope, °C/min", lambda dut: _steepest(dut.points)),
        ("largest |chamber readback − setpoint|, °C", lambda dut: fixed(_chamber_offset(dut.points), 2)),
        ("largest |table readback − setpoint|, °/s", lambda dut: significant(_table_offset(dut.points), 2)),
        ("largest noise against the DUT's own", lambda dut: significant(_largest(dut.points["noise_ratio"]), 2)),
    ]
    columns = [Column("Quantity", numeric=False), *(Column(unbroken(dut.name)) for dut in data.duts)]
    caption = (
        "Data quality per DUT. Stream counts are of the whole run as the decoder saw it. The last five lines are the "
        "worst value over all points; a slope stands with its standard uncertainty, which is large if acquired briefly."
    )
    return _plain_numbers(caption, columns, [[label, *(of(dut) for dut in data.duts)] for label, of in lines])


def _plain_numbers(caption: str, columns: Sequence[Column], rows: Iterable[Sequence[str | Cell]]) -> Table:
    """A table whose columns mix quantities: right-aligned, but without a common decimal point."""
    return Table(
        caption,
        tuple(columns),
        tuple(tuple(item if isinstance(item, Cell) else Cell(item) for item in row) for row in rows),
    )


def _stream(data: ReportData, dut: DutData, key: str, column: str | None) -> str:
    """The stream's own count over the whole run, or the sum over the points where the manifest has none."""
    counts = data.manifest.data_quality.get(dut.name, {})
    if counts.get(key) is not None:
        return count(counts[key])
    return MISSING if column is None or dut.points[column].isna().all() else count(float(dut.points[column].sum()))


def _counter(verdict: str) -> Callable[[DutData], str]:
    return lambda dut: count(int((dut.points["verdict"] == verdict).sum()))


def _largest(values: pd.Series[float]) -> float | None:
    known = np.abs(values.to_numpy(dtype=float))
    known = known[np.isfinite(known)]
    return float(known.max()) if known.size else None


def _steepest(points: pd.DataFrame) -> str:
    """The steepest slope, and its standard uncertainty where the file has one."""
    slopes = points[[SLOPE, SLOPE_U]].dropna(subset=[SLOPE])
    if slopes.empty:
        return MISSING
    values = slopes.to_numpy(dtype=float)
    slope, u = values[np.argmax(np.abs(values[:, 0]))]
    return significant(abs(slope), 2) + (f" ± {significant(u, 2)}" if np.isfinite(u) else "")


def _chamber_offset(points: pd.DataFrame) -> float | None:
    return _largest(points["chamber_readback_degc"] - points["chamber_setpoint_degc"])


def _table_offset(points: pd.DataFrame) -> float | None:
    return _largest(points["rate_readback_dps"] - points["rate_setpoint_dps"])


def points_to_look_at(data: ReportData) -> Table | None:
    """Points with a verdict other than 'pass', failed ones first, at most WORST_POINTS_SHOWN; None if all passed."""
    found = [dut.points[dut.points["verdict"] != "pass"] for dut in data.duts]
    points = pd.concat(found) if found else pd.DataFrame()
    if points.empty:
        return None
    points = points.assign(passed=points["verdict"] != "fail").sort_values(["passed", "point", "dut"], kind="stable")
    shown = points.head(WORST_POINTS_SHOWN)
    damaged = bool((shown[list(DAMAGE)].fillna(0) > 0).any(axis=None))
    columns = [
        Column("Point"),
        Column("DUT", numeric=False),
        Column("chamber setpoint, °C"),
        Column("rate setpoint, °/s"),
        Column("Verdict", numeric=False),
        *([Column("Stream", numeric=False)] if damaged else []),
        Column("Reasons", numeric=False),
    ]
    rows = [_point_to_look_at(row, damaged) for row in shown.to_dict("records")]
    more = (
        f" The first {WORST_POINTS_SHOWN} are listed; points.csv has all." if len(points) > WORST_POINTS_SHOWN else ""
    )
    caption = f"The {count(len(points))} points whose verdict is not pass, failed ones first.{more}"
    return table(caption, columns, rows)


def _point_to_look_at(row: Mapping[Any, Any], damaged: bool) -> list[str | Cell]:
    stream = ", ".join(f"{count(row[name])} {words}" for name, words in DAMAGE.items() if row[name] > 0)
    return [
        count(row["point"]),
        Cell(str(row["dut"]), kind="nowrap"),
        setpoint(row["chamber_setpoint_degc"]),
        setpoint(row["rate_setpoint_dps"]),
        Cell(str(row["verdict"]) or "none given", kind="bad" if row["verdict"] == "fail" else ""),
        *([stream or MISSING] if damaged else []),
        str(row["reasons"]),
    ]


def missing_points(data: ReportData) -> Table | None:
    """Per DUT the points it lacks, and what measures them; None if it lacks none."""
    missing = data.manifest.missing
    if not missing:
        return None
    # A plan that was not carried out to its end goes on first.
    option = " --missing" if data.manifest.outcome in ("PASS", "FAIL") else ""
    command = f"fogbench resume {shlex.quote(data.manifest.run_id)}{option}"
    rows: list[list[str | Cell]] = [
        [Cell(dut, kind="nowrap"), left.get("not_measured") or MISSING, left.get("failed") or MISSING]
        for dut, left in missing.items()
    ]
    columns = [Column("DUT", numeric=False), Column("Not measured", numeric=False), Column("Failed", numeric=False)]
    return table(f"Missing points per DUT, by their numbers. They are measured by: {command}", columns, rows)


def links(data: ReportData) -> Table | None:
    """What was lost and found again, at most LINKS_SHOWN events; None if everything answered throughout."""
    found = [event for event in data.manifest.events if event.kind == "link"]
    if not found:
        return None
    more = f" The first {LINKS_SHOWN} of {count(len(found))} are listed." if len(found) > LINKS_SHOWN else ""
    rows = [[duration(event.t_s), event.text] for event in found[:LINKS_SHOWN]]
    columns = [Column("Bench time", numeric=False), Column("What happened", numeric=False)]
    return table(f"Links that were lost, and found again.{more}", columns, rows)
