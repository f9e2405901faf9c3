"""Figures of what is left after compensation: against rate, against temperature, as a histogram, and over the grid."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report import figures as fig
from bench.report.data import DutData
from bench.report.formats import setpoint, significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
BINS = 41
# A single dwell drifts by millikelvins, which an axis fitted to it would blow up.
NARROWEST_DEGC = 2.0
FLOOR_BAND = {"color": fig.FLOOR, "alpha": 0.35, "linewidth": 0}


def against_rate(dut: DutData, name: str) -> fig.Figure | None:
    """Residual against rate, one line per dwell from cold (blue) to warm (orange); None without residuals."""
    points = _judged(dut)
    if points.empty:
        return None
    drawn = fig.canvas()
    axes = fig.axes_at(drawn, 72, 48, 82, 34)
    dwells = [dwell for _, dwell in points.groupby("dwell")]
    temperatures = np.array([float(dwell["dut_temperature_degc"].mean()) for dwell in dwells])
    order = np.argsort(temperatures, kind="stable")
    colours = fig.warmth(len(dwells))
    for colour, index in zip(colours, order, strict=True):
        line = dwells[index].sort_values("rate_reference_dps")
        marker = "o" if len(line) < 4 else None
        axes.plot(line["rate_reference_dps"], line["residual_dps"], color=colour, linewidth=1.1, marker=marker)
    _floor_band(axes, dut, horizontal=True)
    fig.setpoint_ticks(axes.xaxis)
    axes.set(xlabel="rate (°/s)", ylabel="residual (°/s)", title="Residual against rate")
    _temperature_key(drawn, temperatures[order], colours)
    alt = f"DUT {dut.name}: residual against rate, one line for each of {len(dwells)} dwells."
    return fig.finish(drawn, name, alt)


def against_temperature(dut: DutData, number: int, name: str) -> fig.Figure | None:
    """Residual against DUT temperature, every point, with the mean of each dwell; None without residuals."""
    points = _judged(dut)
    if points.empty:
        return None
    drawn = fig.canvas()
    axes = fig.axes_at(drawn, 72, 48, 18, 34)
    x, y = (points[name].to_numpy(dtype=float) for name in ("dut_temperature_degc", "residual_dps"))
    fig.dots(axes, x, y, fig.dut_colour(number), alpha=0.45)
    mean = points.groupby("dwell")[["dut_temperature_degc", "residual_dps"]].mean()
    axes.plot(
        mean["dut_temperature_degc"],
        mean["residual_dps"],
        linestyle="none",
        marker="_",
        markersize=15,
        markeredgewidth=2.2,
        color=fig.INK,
    )
    _floor_band(axes, dut, horizontal=True)
    middle, half = (x.min() + x.max()) / 2, (x.max() - x.min()) / 2
    if half < NARROWEST_DEGC / 2:
        axes.set_xlim(middle - NARROWEST_DEGC / 2, middle + NARROWEST_DEGC / 2)
    fig.setpoint_ticks(axes.xaxis)
    axes.set(xlabel="DUT temperature (°C)", ylabel="residual (°/s)", title="Residual against temperature")
    alt = f"DUT {dut.name}: residual against DUT temperature, {len(points)} points, bar at the mean of each dwell."
    return fig.finish(drawn, name, alt)


def histogram(dut: DutData, number: int, name: str) -> fig.Figure | None:
    """How the residuals are distributed, with plus and minus one noise floor and one std; None without residuals."""
    residual = _judged(dut)["residual_dps"].to_numpy(dtype=float)
    if len(residual) < 2:
        return None
    drawn = fig.canvas()
    axes = fig.axes_at(drawn, 72, 48, 18, 34)
    bound = float(np.max(np.abs(residual))) or math.ulp(1.0)
    bins = min(BINS, 2 * math.isqrt(len(residual)) + 1)
    counts, edges = np.histogram(residual, bins=bins, range=(-bound, bound))
    axes.stairs(counts, edges, fill=True, color=fig.dut_colour(number), alpha=0.75)
    _floor_band(axes, dut, horizontal=False)
    std, mean = float(np.std(residual)), float(np.mean(residual))
    for edge in (mean - std, mean + std):
        axes.axvline(edge, color=fig.INK, linewidth=1.1, linestyle=(0, (4, 3)))
    axes.locator_params(axis="x", nbins=7)
    axes.locator_params(axis="y", integer=True)
    stated = f"±1 std = {significant(std)} °/s"
    axes.set_title(stated, loc="right", fontsize=11.5, fontweight="normal", color=fig.MUTED)
    axes.set(xlabel="residual (°/s)", ylabel="points", title="Distribution of the residual")
    alt = f"DUT {dut.name}: histogram of {len(residual)} residuals, std {significant(std)} degrees per second."
    return fig.finish(drawn, name, alt)


def magnitudes(dut: DutData, number: int, name: str) -> fig.Figure | None:
    """Share of points below each magnitude, before and after, beside the noise; None without residuals."""
    points = _judged(dut)
    if len(points) < 2:
        return None
    drawn = fig.canvas()
    axes = fig.axes_at(drawn, 72, 48, 18, 58)
    series = (
        ("rate_mean_u_dps", "noise", fig.FLOOR, (0, (4, 2))),
        ("residual_dps", "compensated", fig.dut_colour(number), "-"),
        ("error_dps", "not compensated", fig.SETPOINT, "-"),
    )
    for column, label, colour, line in series:
        values = np.sort(np.abs(points[column].to_numpy(dtype=float)))
        values = values[values > 0]
        if values.size:
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axes.plot(values, share, color=colour, label=label, linestyle=line, linewidth=2)
    axes.set_xscale("log")
    axes.set_xlim(left=float(np.median(points["rate_mean_u_dps"])) / 10 or None)
    fig.decade_ticks(axes.xaxis)
    axes.set(xlabel="magnitude (°/s), logarithmic", ylabel="points below (%)", ylim=(0, 100))
    fig.legend_above(axes)
    drawn.text(72 / fig.HALF[0], 1 - 25 / fig.HALF[1], "Magnitude of the error", weight="bold", size=12.5)
    alt = f"DUT {dut.name}: cumulative share of points by magnitude of noise, residual and uncompensated error."
    return fig.finish(drawn, name, alt)


def _judged(dut: DutData) -> pd.DataFrame:
    return dut.usable.dropna(subset=["residual_dps"])


def _floor_band(axes: Axes, dut: DutData, *, horizontal: bool) -> None:
    """Plus and minus one noise floor, and a line at zero."""
    line, span = (axes.axhline, axes.axhspan) if horizontal else (axes.axvline, axes.axvspan)
    line(0, color=fig.HAIRLINE, linewidth=1.0, zorder=1.2)
    if dut.floor_dps:
        span(-dut.floor_dps, dut.floor_dps, zorder=1.1, **FLOOR_BAND)  # type: ignore[arg-type]


def _temperature_key(drawn: object, temperatures: Floats, colours: list[str]) -> None:
    """The dwells' colours as a narrow ladder beside the axes, a few of them labelled."""
    n = len(temperatures)
    axes = fig.axes_at(drawn, fig.HALF[0] - 62, 48, 46, 56)  # type: ignore[arg-type]
    rows = np.arange(n, dtype=float)
    boxes = np.stack([np.zeros(n), rows, np.ones(n), rows + 1], axis=1)
    fig.cells(axes, boxes, colours, edgecolor="none")
    axes.set(xlim=(0, 1), ylim=(0, n))
    axes.set_xticks([])
    shown = np.unique(np.linspace(0, n - 1, min(n, 5)).round().astype(int))
    axes.set_yticks(shown + 0.5, [setpoint(round(float(temperatures[index]))) for index in shown])
    axes.yaxis.tick_right()
    axes.tick_params(length=0, pad=4)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_title("DUT °C", fontsize=11.5, fontweight="normal", color=fig.MUTED, pad=6)
