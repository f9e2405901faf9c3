"""Figures of the campaign over time: chamber, DUT temperatures and table rate; all of it, and one dwell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report import figures as fig
from bench.report.data import ReportData
from bench.report.formats import duration, setpoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
BINS = 900
# Up to here each readback is marked: the line between two of them was not measured.
FEW_READBACKS = 40
# Over a readback three times as wide, so that both are seen where they agree.
DASHES = (0, (4, 3))


def timeline(data: ReportData) -> fig.Figure | None:
    """The whole run; None without a timeline."""
    if data.timeline is None:
        return None
    last_s = float(data.timeline["t_s"].iloc[-1])
    dense = len(data.timeline) > 2 * BINS
    drawn_as = (
        f" Drawn as minimum and maximum of every {duration(last_s / BINS)}; no excursion is lost." if dense else ""
    )
    swept = any(dut.points["dwell"].max() > 0 for dut in data.duts if len(dut.points))
    staircase = "; each staircase is one sweep of the rate at one temperature" if swept else ""
    caption = (
        f"The whole run, {duration(last_s)} of bench time. Above: {_temperatures_seen(data.timeline)}. "
        f"Below: table rate{staircase}.{drawn_as}"
    )
    alt = "Time series of chamber setpoint, chamber readback and DUT temperatures above, table rate below."
    return _drawn(data, data.timeline, 0.0, last_s, "timeline", alt, caption)


def _temperatures_seen(rows: pd.DataFrame) -> str:
    """What the upper axes show, in words."""
    own = "the DUTs' own temperature sensors"
    if not _has(rows, "chamber_readback_degc"):
        return own
    over = ", its setpoint (dashed) over it," if _has(rows, "chamber_setpoint_degc") else ""
    return f"chamber readback{over} and {own}"


def one_dwell(data: ReportData) -> fig.Figure | None:
    """The middle dwell with the ramp and soak before it; None if fewer than two dwells were measured."""
    points = data.duts[0].points if data.duts else pd.DataFrame()
    if data.timeline is None or points.empty or points["dwell"].iloc[-1] < 1:
        return None
    last = points.groupby("dwell")["ended_at_s"].max()
    number = int(last.index[len(last) // 2])
    first_s, last_s = float(last[number - 1]), float(last[number])
    inside = data.timeline[data.timeline["t_s"].between(first_s, last_s)]
    if not last_s > first_s or len(inside) < 3:
        return None
    own = points[points["dwell"] == number]
    temperature, before = (
        float(points.loc[points["dwell"] == k, "chamber_setpoint_degc"].iloc[0]) for k in (number, number - 1)
    )
    caption = (
        f"One dwell in detail: from {setpoint(before)} to {setpoint(temperature)} °C, soak, then {len(own)} rates. "
        f"The acquisitions begin {duration(float(own['started_at_s'].iloc[0]) - first_s)} after the dwell before ended."
    )
    alt = f"Time series of one dwell at {setpoint(temperature)} °C: chamber and DUT temperatures above, rate below."
    return _drawn(data, inside, first_s, last_s, "dwell", alt, caption)


def _drawn(
    data: ReportData, rows: pd.DataFrame, first_s: float, last_s: float, name: str, alt: str, caption: str
) -> fig.Figure:
    drawn = fig.canvas(fig.WIDE)
    height = fig.WIDE[1]
    above = fig.axes_at(drawn, 64, height - 240, 14, 34)
    below = fig.axes_at(drawn, 64, 46, 14, 268)
    unit_s = fig.time_axis(above, last_s, first_s)
    fig.time_axis(below, last_s, first_s)
    above.set_xlabel("")
    above.tick_params(labelbottom=False)
    _temperatures(above, data, rows, unit_s)
    _rates(below, data, rows, unit_s)
    fig.legend_above(above)
    fig.legend_above(below)
    return fig.finish(drawn, name, alt, caption)


def _temperatures(axes: Axes, data: ReportData, rows: pd.DataFrame, unit_s: float) -> None:
    for number, dut in enumerate(data.duts):
        column = f"temperature_degc:{dut.name}"
        style = "-" if number % 2 == 0 else (0, (5, 2))
        _line(axes, rows, column, unit_s, f"DUT {dut.name}", fig.dut_colour(number), linestyle=style)
    _line(axes, rows, "chamber_readback_degc", unit_s, "chamber readback", fig.SETPOINT, linewidth=3.0, zorder=1.8)
    _line(axes, rows, "chamber_setpoint_degc", unit_s, "chamber setpoint", fig.INK, linewidth=1.0, linestyle=DASHES)
    axes.set_ylabel("temperature (°C)")
    axes.margins(y=0.06)


def _rates(axes: Axes, data: ReportData, rows: pd.DataFrame, unit_s: float) -> None:
    read = _has(rows, "rate_readback_dps")
    column, label = ("rate_readback_dps", "table readback") if read else ("rate_setpoint_dps", "table setpoint")
    _line(axes, rows, column, unit_s, label, fig.INK, linewidth=1.0)
    _verdict_marks(axes, data, unit_s)
    axes.set_ylabel("rate (°/s)")
    axes.margins(y=0.08)


def _verdict_marks(axes: Axes, data: ReportData, unit_s: float) -> None:
    """A mark on the time axis for every point that is not 'pass'."""
    for verdict in ("marginal", "fail"):
        starts = [dut.points.loc[dut.points["verdict"] == verdict, "started_at_s"].to_numpy() for dut in data.duts]
        at = np.concatenate(starts) if starts else np.empty(0)
        at = at[np.isfinite(at)] / unit_s
        left, right = axes.get_xlim()
        at = at[(at >= left) & (at <= right)]
        if at.size:
            axes.plot(
                at,
                np.zeros(at.size),
                transform=axes.get_xaxis_transform(),
                clip_on=False,
                linestyle="none",
                marker="^" if verdict == "marginal" else "X",
                markersize=7,
                markeredgecolor="white",
                color=fig.VERDICT_COLOURS[verdict],
                label=f"point with verdict {verdict}",
            )


def _line(
    axes: Axes, rows: pd.DataFrame, column: str, unit_s: float, label: str, colour: str, **options: object
) -> None:
    if not _has(rows, column):
        return
    values = rows[column].to_numpy(dtype=float)
    known = np.isfinite(values)
    t, y = envelope(rows["t_s"].to_numpy(dtype=float)[known] / unit_s, values[known], BINS)
    marked = {"marker": "o", "markersize": 4, "clip_on": False} if len(t) <= FEW_READBACKS else {}
    axes.plot(t, y, color=colour, label=label, solid_joinstyle="round", **marked, **options)  # type: ignore[arg-type]


def _has(rows: pd.DataFrame, column: str) -> bool:
    return column in rows and bool(np.isfinite(rows[column].to_numpy(dtype=float)).any())


def envelope(t: Floats, y: Floats, bins: int) -> tuple[Floats, Floats]:
    """At most 2 * `bins` of the samples: the smallest and largest of each of `bins` equal times, in order of time.

    `t` must not decrease. Extremes keep their own time, so a sweep shows its true height; flat stretches cost two dots.
    """
    if len(t) <= 2 * bins:
        return t, y
    bin_of = np.minimum(((t - t[0]) / (t[-1] - t[0]) * bins).astype(int), bins - 1)
    starts = np.flatnonzero(np.diff(bin_of, prepend=-1))
    lowest = starts + [int(np.argmin(part)) for part in np.split(y, starts[1:])]
    highest = starts + [int(np.argmax(part)) for part in np.split(y, starts[1:])]
    keep = np.unique(np.concatenate([[0], lowest, highest, [len(t) - 1]]))
    return t[keep], y[keep]
