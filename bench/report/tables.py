"""The report's tables of results: what was reached per model, and the limits; and what a table is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from bench.quantities import shown
from bench.report.data import HELD_BACK_SPLIT, UNCOMPENSATED, DutData, ReportData
from bench.report.formats import MISSING, count, decimals_missing, fixed, ratio, setpoint, significant, unbroken
from bench.report.manifest import LimitCheck, Manifest
from bench.report.remarks import remainder
from bench.report.residuals import HEADLINE_SPLIT
from bench.report.wording import model_name, quantity_name, split_name

POINTS_SHOWN = 40
# Split -> its heading, and what its points are.
JUDGED_ON = {
    HEADLINE_SPLIT: ("Leave temperatures out, °/s", "each predicted by a model that never saw its dwell"),
    HELD_BACK_SPLIT: ("Random split, °/s", "held back at random"),
}


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
    """The result of one DUT: before and after, and in words what the error that is left is made of."""

    dut: str
    model: str
    split: str
    std_before: str
    std_after: str
    times_smaller: str
    max_before: str
    max_after: str
    remainder: str


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
        remainder=remainder(dut, split, after),
    )


def results(dut: DutData) -> Table:
    """Largest error and std per model, on the splits that were judged; noise floor below."""
    splits = [split for split in JUDGED_ON if dut.figure(UNCOMPENSATED, split, "n")] or [HEADLINE_SPLIT]
    rows = [_result(dut, model, splits) for model in dut.metrics]
    floor = significant(dut.floor_dps, 2)
    rows.append([Cell("noise floor", kind="floor"), *[MISSING, floor] * len(splits), MISSING])
    judged = [f"{count(dut.figure(UNCOMPENSATED, split, 'n'))} points {JUDGED_ON[split][1]}" for split in splits]
    sides = " (left) and on ".join(judged) + (" (right)" if len(splits) > 1 else "")
    caption = (
        f"DUT {dut.name}: error in °/s per model, on {sides}. Max is the largest magnitude. "
        f"Shown in the figures: {model_name(dut.model or UNCOMPENSATED)} ({dut.chosen_by})."
    )
    labels = ["max", "std"] * len(splits) + ["std smaller by a factor"]
    columns = [Column("Model", numeric=False), *map(Column, labels)]
    return table(caption, columns, rows, [("", 1), *((JUDGED_ON[split][0], 2) for split in splits), ("", 1)])


def _result(dut: DutData, model: str, splits: Sequence[str]) -> list[str | Cell]:
    """A model's figures; the factor is of the first split."""
    kind = "strong" if model == dut.model else ""
    figures = [significant(dut.figure(model, split, name)) for split in splits for name in ("max_abs_dps", "std_dps")]
    before, after = (dut.figure(name, splits[0], "std_dps") for name in (UNCOMPENSATED, model))
    times = MISSING if model == UNCOMPENSATED else ratio(before, after)
    return [Cell(text, kind=kind) for text in (model_name(model), *figures, times)]


def as_measured(data: ReportData) -> Table | None:
    """The points of a run without a model: output, reference and error of each; None without points."""
    points = pd.concat([dut.points for dut in data.duts]) if data.duts else pd.DataFrame()
    if points.empty:
        return None
    named = ("Point", "DUT", "DUT temperature, °C", "rate setpoint", "mean output", "error", "standard uncertainty")
    columns = [Column(label, numeric=label != "DUT") for label in named]
    shown = points.sort_values(["point", "dut"], kind="stable").head(POINTS_SHOWN)
    rows: list[list[str | Cell]] = [
        [
            count(row["point"]),
            Cell(str(row["dut"]), kind="nowrap"),
            fixed(row["dut_temperature_degc"], 2),
            setpoint(row["rate_setpoint_dps"]),
            fixed(row["rate_mean_dps"], 5),
            fixed(row["error_dps"], 5),
            significant(row["rate_mean_u_dps"], 2),
        ]
        for row in shown.to_dict("records")
    ]
    more = f" The first {POINTS_SHOWN} of {count(len(points))}; points.csv has all." if len(points) > len(rows) else ""
    return table(f"Points as measured, rates in °/s. Error is mean output minus reference rate.{more}", columns, rows)


def limits(manifest: Manifest) -> Table | None:
    """The procedure's limits, what was measured, and whether they were kept; None without limits."""
    if not manifest.limits:
        return None
    duts = list(dict.fromkeys(dut for check in manifest.limits for dut in check.measured))
    columns = [Column("Limit on", numeric=False), Column("Unit", numeric=False), Column("allowed")]
    columns += [*(Column(unbroken(dut)) for dut in duts), Column("", numeric=False)]
    rows: list[list[str | Cell]] = []
    for check in manifest.limits:
        what = f"{quantity_name(check.quantity)}, {model_name(check.model)}, {split_name(check.split)}"
        measured = [_against_limit(check, dut) for dut in duts]
        as_shown = shown(check.quantity, check.limit)
        allowed = MISSING if check.limit is None else f"≤ {setpoint(check.limit * as_shown.factor)}"
        rows.append([what, as_shown.unit.replace("deg", "°"), allowed, *measured, _judgement(check)])
    return table("Limits of the procedure. A quantity that was not measured is not passed.", columns, rows)


def _against_limit(check: LimitCheck, dut: str) -> Cell:
    value = check.measured.get(dut)
    over = value is not None and check.limit is not None and abs(value) > check.limit
    factor = shown(check.quantity, check.limit).factor
    return Cell(significant(None if value is None else value * factor), kind="bad" if over else "")


def _judgement(check: LimitCheck) -> Cell:
    if check.passed:
        return Cell("passed", kind="good")
    unknown = not check.measured or any(value is None for value in check.measured.values())
    return Cell("not measured" if unknown else "failed", kind="bad")
