"""The records of a run: what was recorded, and each drawn against time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bench.report import figures as fig
from bench.report.data import ReportData
from bench.report.figures_campaign import envelope
from bench.report.formats import count, duration, fault, significant
from bench.report.section import Section
from bench.report.tables import Cell, Column, Table, table
from bench.series import series_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS = 900
# Records of one kind repeated many times (seekings) would fill pages: this many labels are drawn.
MOST_DRAWN = 6
# More series than this are counted and only those to look at are listed.
MOST_LISTED = 24
DPH_PER_DPS = 3600.0


def records(data: ReportData) -> Section | None:
    """What was recorded; None if the run has no records."""
    series = data.manifest.series
    if not series:
        return None
    remarks: list[str] = []
    drawn = []
    labels = list(dict.fromkeys(str(one.get("label")) for one in series))
    for number, label in enumerate(labels[:MOST_DRAWN]):
        tables = _read(data, label, remarks)
        if tables:
            drawn.append(_figure(label, tables, number))
    if len(labels) > MOST_DRAWN:
        remarks.append(f"Only the first {MOST_DRAWN} of {len(labels)} records are drawn.")
    paragraph = (
        "A record is a time series kept while its steps ran; each row is the mean of the frames of one interval. "
        "The joined series are in the folder series/ of the run."
    )
    return Section("records", "Records", (paragraph,), (_table(series),), tuple(drawn), tuple(remarks))


def _read(data: ReportData, label: str, remarks: list[str]) -> dict[str, pd.DataFrame]:
    """The series of one record, by DUT; what cannot be read is remarked."""
    tables: dict[str, pd.DataFrame] = {}
    for about in data.manifest.series:
        if about.get("label") != label:
            continue
        path = data.run_dir / series_file(about)
        try:
            read = pd.read_parquet(path)
        except Exception as error:
            remarks.append(f"{series_file(about)} cannot be read ({fault(error, path)}): it is not drawn.")
            continue
        if len(read) and {"t_s", "rate_dps"} <= set(read.columns):
            tables[str(about["dut"])] = read
    return tables


def _table(series: tuple[Mapping[str, Any], ...]) -> Table:
    columns = [Column("Record", False), Column("DUT", False), Column("Duration", False), Column("Every, s")]
    columns += [Column("Rows"), Column("Frames lost"), Column("Verdict", False), Column("Why", False)]
    listed = [one for one in series if one.get("verdict") != "pass"] if len(series) > MOST_LISTED else list(series)
    caption = (
        "Records of the run."
        if len(listed) == len(series)
        else (
            f"Records of the run: {count(len(series))} series, of which {count(len(series) - len(listed))} passed and "
            f"{count(len(listed))} are listed; manifest.json has all."
        )
    )
    return table(caption, columns, [_row(one) for one in listed or series[:1]])


def _row(one: Mapping[str, Any]) -> list[str | Cell]:
    verdict = str(one.get("verdict", ""))
    return [
        str(one.get("label")),
        str(one.get("dut")),
        duration(int(one["rows"]) * float(one["every_s"])),
        significant(float(one["every_s"])),
        count(int(one["rows"])),
        count(int(one["losses"]["lost"])),
        Cell(verdict, kind="" if verdict == "pass" else "bad"),
        str(one.get("reasons", "")),
    ]


def _figure(label: str, tables: Mapping[str, pd.DataFrame], number: int) -> fig.Figure:
    drawn = fig.canvas(fig.WIDE)
    height = fig.WIDE[1]
    above = fig.axes_at(drawn, 74, height - 240, 14, 34)
    below = fig.axes_at(drawn, 74, 46, 14, 290)
    began = min(float(rows["t_s"].iloc[0]) for rows in tables.values())
    ended = max(float(rows["t_s"].iloc[-1]) for rows in tables.values())
    unit_s = fig.time_axis(above, ended - began)
    fig.time_axis(below, ended - began, label="time since the record began")
    above.set_xlabel("")
    above.tick_params(labelbottom=False)
    for k, (dut, rows) in enumerate(tables.items()):
        t = (rows["t_s"].to_numpy(dtype=float) - began) / unit_s
        _rate(above, t, rows, dut, k)
        _temperatures(below, t, rows, dut, k)
    above.set_ylabel("rate − mean (°/h)")
    below.set_ylabel("temperature (°C)")
    above.margins(y=0.06)
    below.margins(y=0.08)
    fig.legend_above(above)
    if below.lines:
        fig.legend_above(below)
    alt = f"Record {label}: rate about its mean above, temperatures below, against time."
    caption = (
        f"Record {label}. Above: output of each DUT about its own mean, its "
        "average over a two-hundredth of the record (line) and the range of its rows (pale). Below: its temperatures."
    )
    return fig.finish(drawn, f"record{number}", alt, caption)


def _rate(axes: Axes, t: fig.Floats, rows: pd.DataFrame, dut: str, number: int) -> None:
    rate = rows["rate_dps"].to_numpy(dtype=float)
    known = np.isfinite(rate)
    if known.any():
        x, y = envelope(t[known], (rate[known] - rate[known].mean()) * DPH_PER_DPS, BINS)
        axes.plot(x, y, color=fig.dut_colour(number), linewidth=0.8, alpha=0.35)
        x, y = _averages(t[known], (rate[known] - rate[known].mean()) * DPH_PER_DPS)
        axes.plot(x, y, color=fig.dut_colour(number), label=f"DUT {dut}", linewidth=1.6)


def _averages(t: fig.Floats, y: fig.Floats) -> tuple[fig.Floats, fig.Floats]:
    """Means over a two-hundredth of the record each: what changes slowly, out of the noise."""
    size = max(1, len(t) // 200)
    whole = len(t) // size * size
    return t[:whole].reshape(-1, size).mean(axis=1), y[:whole].reshape(-1, size).mean(axis=1)


def _temperatures(axes: Axes, t: fig.Floats, rows: pd.DataFrame, dut: str, number: int) -> None:
    for k, name in enumerate(column for column in rows.columns if column.endswith("_degc")):
        values = rows[name].to_numpy(dtype=float)
        known = np.isfinite(values)
        if known.any():
            x, y = envelope(t[known], values[known], BINS // 2)
            style = ("-", "--", ":", "-.")[k % 4]
            what = name.removesuffix("_degc").replace("_", " ")
            axes.plot(x, y, color=fig.dut_colour(number), linestyle=style, label=f"{dut} {what}")
