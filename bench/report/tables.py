"""The report's tables about the run itself: results, limits, data quality, points to look at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from bench.report.data import HEADLINE_SPLIT, HELD_BACK_SPLIT, UNCOMPENSATED, DutData, ReportData
from bench.report.formats import MISSING, count, decimals_missing, fixed, ratio, setpoint, significant, unbroken
from bench.report.manifest import LimitCheck, Manifest
from bench.report.wording import model_name, quantity_name, split_name

WORST_POINTS_SHOWN = 40


@dataclass(frozen=True)
class Column:
    """One column: its label, and whether it holds numbers (then right-aligned on the decimal point)."""

    label: str
    numeric: bool = True


@dataclass(frozen=True)
class Cell:
    """One cell: its text, the digits of padding that align its decimal point, and a style ('strong', 'good', 'bad')."""

    text: str
    pad: int = 0
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """A table ready to print: `groups` are labels over several columns; the first cell of a row is its heading."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    groups: tuple[tuple[str, int], ...] = ()


def table(
    caption: str,
    columns: Sequence[Column],
    rows: Iterable[Sequence[str | Cell]],
    groups: Sequence[tuple[str, int]] = (),
) -> Table:
    """Build a table; numeric columns get the padding that puts their decimal points below each other."""
    cells = [[item if isinstance(item, Cell) else Cell(item) for item in row] for row in rows]
    for number, column in enumerate(columns):
        if column.numeric:
            pads = decimals_missing(row[number].text for row in cells)
            for row, pad in zip(cells, pads, strict=True):
                row[number] = replace(row[number], pad=pad)
    return Table(caption, tuple(columns), tuple(tuple(row) for row in cells), tuple(groups))


@dataclass(frozen=True)
class Headline:
    """The result of one DUT in one line: before and after, and the floor nothing can go below."""

    dut: str
    model: str
    split: str
    std_before: str
    std_after: str
    times_smaller: str
    max_before: str
    max_after: str
    floor: str
    floors_above: str


def headline(dut: DutData) -> Headline | None:
    """The best model's figures on the headline split, or on the random split if that is all there is."""
    if dut.model is None:
        return None
    for split in (HEADLINE_SPLIT, HELD_BACK_SPLIT):
        before = dut.figure(UNCOMPENSATED, split, "std_dps")
        after = dut.figure(dut.model, split, "std_dps")
        if after is not None:
            break
    else:
        return None
    return Headline(
        dut=dut.name,
        model=model_name(dut.model),
        split=split_name(split),
        std_before=significant(before),
        std_after=significant(after),
        times_smaller=ratio(before, after),
        max_before=significant(dut.figure(UNCOMPENSATED, split, "max_abs_dps")),
        max_after=significant(dut.figure(dut.model, split, "max_abs_dps")),
        floor=significant(dut.floor_dps, 2),
        floors_above=ratio(after, dut.floor_dps),
    )


def results(dut: DutData) -> Table:
    """Largest error and std per model: headline split, random split beside it, noise floor below."""
    columns = [
        Column("Model", numeric=False),
        *(Column(label) for label in ("max", "std") * 2),
        Column("std smaller by a factor"),
    ]
    before = dut.figure(UNCOMPENSATED, HEADLINE_SPLIT, "std_dps")
    rows: list[list[str | Cell]] = []
    for model in dut.metrics:
        kind = "strong" if model == dut.model else ""
        figures = [
            Cell(significant(dut.figure(model, split, quantity)), kind=kind)
            for split in (HEADLINE_SPLIT, HELD_BACK_SPLIT)
            for quantity in ("max_abs_dps", "std_dps")
        ]
        after = dut.figure(model, HEADLINE_SPLIT, "std_dps")
        times = MISSING if model == UNCOMPENSATED else ratio(before, after)
        rows.append([Cell(model_name(model), kind=kind), *figures, Cell(times, kind=kind)])
    floor = significant(dut.floor_dps, 2)
    rows.append([Cell("noise floor", kind="floor"), MISSING, floor, MISSING, floor, MISSING])
    sizes = [dut.figure(UNCOMPENSATED, split, "n") for split in (HEADLINE_SPLIT, HELD_BACK_SPLIT)]
    caption = (
        f"DUT {dut.name}: error in °/s per model, on {count(sizes[0])} points each predicted by a model that never saw "
        f"its dwell (left) and on {count(sizes[1])} points held back at random (right). Max is the largest magnitude. "
        f"Shown in the figures: {model_name(dut.model or UNCOMPENSATED)} ({dut.chosen_by})."
    )
    groups = (("", 1), ("Leave temperatures out, °/s", 2), ("Random split, °/s", 2), ("", 1))
    return table(caption, columns, rows, groups)


def limits(manifest: Manifest) -> Table | None:
    """The procedure's limits, what was measured, and whether they were kept; None without limits."""
    if not manifest.limits:
        return None
    duts = list(dict.fromkeys(dut for check in manifest.limits for dut in check.measured))
    columns = [Column("Limit on", numeric=False), Column("allowed, °/s")]
    columns += [*(Column(f"{unbroken(dut)}, °/s") for dut in duts), Column("", numeric=False)]
    rows: list[list[str | Cell]] = []
    for check in manifest.limits:
        what = f"{quantity_name(check.quantity)}, {model_name(check.model)}, {split_name(check.split)}"
        measured = [_against_limit(check, dut) for dut in duts]
        rows.append([what, f"≤ {setpoint(check.limit)}", *measured, _judgement(check)])
    return table("Limits of the procedure. A quantity that was not measured is not passed.", columns, rows)


def _against_limit(check: LimitCheck, dut: str) -> Cell:
    value = check.measured.get(dut)
    over = value is not None and check.limit is not None and abs(value) > check.limit
    return Cell(significant(value), kind="bad" if over else "")


def _judgement(check: LimitCheck) -> Cell:
    if check.passed:
        return Cell("passed", kind="good")
    unknown = not check.measured or any(value is None for value in check.measured.values())
    return Cell("not measured" if unknown else "failed", kind="bad")


def quality(data: ReportData) -> Table:
    """One column per DUT: what arrived, what was lost, and how good the points are."""
    lines: list[tuple[str, Callable[[DutData], str]]] = [
        ("frames received", lambda dut: _stream(data, dut, "frames", "frames")),
        ("frames lost (sequence gaps)", lambda dut: _stream(data, dut, "lost", "frames_lost")),
        ("duplicate frames", lambda dut: _stream(data, dut, "duplicates", "duplicates")),
        ("bad checksums", lambda dut: _stream(data, dut, "bad_checksum", "bad_checksum")),
        ("frames with bad status", lambda dut: _stream(data, dut, "bad_status", None)),
        ("resynchronisations", lambda dut: _stream(data, dut, "resyncs", None)),
        ("bytes skipped by them", lambda dut: _stream(data, dut, "skipped_bytes", None)),
        ("frames lost inside points", lambda dut: count(float(dut.points["frames_lost"].sum()))),
        ("outliers taken out", lambda dut: count(float(dut.points["outliers"].sum()))),
        *((f"points with verdict {word}", _counter(word)) for word in ("pass", "marginal", "fail")),
        ("largest standard uncertainty, °/s", lambda dut: significant(_largest(dut.points["rate_mean_u_dps"]), 2)),
        ("steepest temperature slope, °C/min", lambda dut: significant(_largest(dut.points[SLOPE]), 2)),
        ("largest |chamber readback − setpoint|, °C", lambda dut: fixed(_chamber_offset(dut.points), 2)),
        ("largest |table readback − setpoint|, °/s", lambda dut: significant(_table_offset(dut.points), 2)),
    ]
    columns = [Column("Quantity", numeric=False), *(Column(unbroken(dut.name)) for dut in data.duts)]
    caption = (
        "Data quality per DUT. Stream counts are of the whole run as the decoder saw it; the last four lines are the "
        "worst value over all points."
    )
    return _plain_numbers(caption, columns, [[label, *(of(dut) for dut in data.duts)] for label, of in lines])


SLOPE = "dut_temperature_slope_degc_min"


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
    columns = [
        Column("Point"),
        Column("DUT", numeric=False),
        Column("chamber setpoint, °C"),
        Column("rate setpoint, °/s"),
    ]
    columns += [Column("Verdict", numeric=False), Column("Reasons", numeric=False)]
    rows: list[list[str | Cell]] = [
        [
            count(row["point"]),
            Cell(str(row["dut"]), kind="nowrap"),
            setpoint(row["chamber_setpoint_degc"]),
            setpoint(row["rate_setpoint_dps"]),
            Cell(str(row["verdict"]) or "none given", kind="bad" if row["verdict"] == "fail" else ""),
            str(row["reasons"]),
        ]
        for row in points.head(WORST_POINTS_SHOWN).to_dict("records")
    ]
    more = (
        f" The first {WORST_POINTS_SHOWN} are listed; points.csv has all." if len(points) > WORST_POINTS_SHOWN else ""
    )
    caption = f"The {count(len(points))} points whose verdict is not pass, failed ones first.{more}"
    return table(caption, columns, rows)
