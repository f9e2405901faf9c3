"""North seeking: the error before and after the filter, and what the filter does to the Allan coefficients."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pandas as pd

from bench.report import figures as fig
from bench.report.data import ReportData
from bench.report.formats import MISSING, fault, significant
from bench.report.section import Section
from bench.report.tables import Column, Table, table

PUBLISHED = (
    "Published (J. Chinese Inertial Technol. 24(6), 2016), another seeker: all five Allan coefficients of FOG x below "
    "half after filtering, bias instability 0.0196 → 0.0091 °/h, north error 1.8405 → 1.5160 mil."
)
CAUTION = (
    "A smoother trace is not by itself a better estimate of the mean: Allan coefficients of a filtered trace say how "
    "smooth it is. The north error, against the surveyed azimuth, is the figure that counts."
)
TRACES = {"before": "as measured", "after": "filtered"}


def north(data: ReportData) -> Section | None:
    """The section; None if the run sought no north."""
    path = data.run_dir / "analyses" / "north.json"
    if not path.is_file():
        return None
    remarks: list[str] = []
    try:
        found: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        tables = [made for dut, one in found.items() for made in (_errors(dut, one), _coefficients(dut, one))]
        remarks += [f"DUT {dut}: {one['two_positions']['verdict']}." for dut, one in found.items()]
        about = _about(next(iter(found.values()), None))
    except (OSError, ValueError, AttributeError, TypeError, KeyError, RecursionError) as error:
        text = f"analyses/north.json cannot be read ({fault(error, path)}): nothing of it is shown."
        return Section("north", "North seeking", remarks=(text,))
    drawn = [*_drawn(data, "north.parquet", _seekings, remarks), *_drawn(data, "north_allan.parquet", _curves, remarks)]
    remarks += [CAUTION, PUBLISHED]
    return Section("north", "North seeking", (about,) if about else (), tuple(tables), tuple(drawn), tuple(remarks))


def _about(one: Mapping[str, Any] | None) -> str:
    if one is None:
        return ""
    return (
        f"Heading of the x axis, judged by its surveyed azimuth of {one['azimuth_deg']:g}° at latitude "
        f"{one['latitude_deg']:g}°, over {one['seekings']} seekings of {one['seconds_per_position']:.0f} s in each "
        f"position. Errors in mil, {one['mils_per_circle']:g} mil to the circle. Two positions use both gyros; four "
        "use gyro x alone. Level is taken from the accelerometers."
    )


def _errors(dut: str, one: Mapping[str, Any]) -> Table:
    two, four = one["two_positions"], one["four_positions"]
    columns = [Column("North error", False), Column("rms before, mil"), Column("rms after, mil")]
    columns += [Column("largest before, mil"), Column("largest after, mil")]
    largest = [significant(two["max_before_mil"]), significant(two["max_after_mil"])]
    rows = [
        ["two positions", significant(two["rms_before_mil"]), significant(two["rms_after_mil"]), *largest],
        ["four positions", significant(four["four_before_mil"]), significant(four["four_after_mil"]), MISSING, MISSING],
    ]
    return table(f"DUT {dut}: north error before and after the filter.", columns, rows)


def _coefficients(dut: str, one: Mapping[str, Any]) -> Table:
    columns = [Column("Allan coefficient of FOG x", False), Column("Unit", False)]
    columns += [Column("as measured"), Column("95 %", False), Column("filtered"), Column("95 %", False)]
    rows = []
    for symbol, first in one["allan"]["before"]["coefficients"].items():
        second = one["allan"]["after"]["coefficients"][symbol]
        rows.append([f"{first['name']} {symbol}", first["unit"], *_value(first), *_value(second)])
    minima = [one["allan"][trace]["minimum"] for trace in TRACES]
    cells = [cell for one in minima for cell in (significant(one["deviation_dph"]), f"at {one['tau_s']:.0f} s")]
    rows.append(["Allan minimum (not B)", "deg/h", *cells])
    return table(f"DUT {dut}: Allan coefficients before and after the filter.", columns, rows)


def _value(one: Mapping[str, Any]) -> list[str]:
    if one["low"] <= 0.0:
        return [MISSING, f"below {significant(one['high'])}"]
    return [significant(one["value"]), f"{significant(one['low'])} to {significant(one['high'])}"]


def _drawn(data: ReportData, name: str, draw: Any, remarks: list[str]) -> list[fig.Figure]:
    path = data.run_dir / "analyses" / name
    try:
        rows = pd.read_parquet(path)
        return [draw(own, str(dut), number) for number, (dut, own) in enumerate(rows.groupby("dut", sort=False))]
    except Exception as error:
        remarks.append(f"analyses/{name} cannot be drawn ({fault(error, path)}).")
        return []


def _seekings(rows: pd.DataFrame, dut: str, number: int) -> fig.Figure:
    drawn = fig.canvas((fig.WIDE[0], 300))
    axes = fig.axes_at(drawn, 74, 46, 14, 34)
    for k, (column, label) in enumerate(
        (("two_before_mil", "two positions, as measured"), ("two_after_mil", "two positions, filtered"))
    ):
        axes.plot(
            rows["seeking"],
            rows[column],
            color=fig.dut_colour(k),
            label=label,
            marker="o" if k == 0 else "x",
            markersize=6,
            linestyle="none",
        )
    axes.axhline(0.0, color=fig.INK, linewidth=0.8)
    axes.set_xlabel("seeking")
    axes.set_ylabel("north error (mil)")
    fig.legend_above(axes)
    alt = f"DUT {dut}: north error of every seeking, before and after the filter."
    return fig.finish(drawn, f"north{number}", alt, f"{alt} Zero is the surveyed azimuth.")


def _curves(rows: pd.DataFrame, dut: str, number: int) -> fig.Figure:
    drawn = fig.canvas((fig.WIDE[0], 360))
    axes = fig.axes_at(drawn, 74, 46, 14, 34)
    for k, (trace, own) in enumerate(rows.groupby("trace", sort=False)):
        tau = own["tau_s"].to_numpy(dtype=float)
        axes.fill_between(tau, own["low_dph"], own["high_dph"], color=fig.dut_colour(k), alpha=0.15, linewidth=0)
        axes.plot(tau, own["deviation_dph"], color=fig.dut_colour(k), label=TRACES.get(str(trace), str(trace)))
    axes.set_xscale("log")
    axes.set_yscale("log")
    fig.decade_ticks(axes.xaxis)
    fig.decade_ticks(axes.yaxis)
    axes.set_xlabel("averaging time (s)")
    axes.set_ylabel("Allan deviation (°/h)")
    fig.legend_above(axes)
    alt = f"DUT {dut}: overlapping Allan deviation of FOG x as measured and filtered."
    return fig.finish(drawn, f"allan{number}", alt, f"{alt} Bands are 95 % confidence.")
