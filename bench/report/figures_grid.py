"""Figures of the grid: one cell for every pair of chamber setpoint and rate setpoint, holes left visible."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report import figures as fig
from bench.report.data import DutData
from bench.report.formats import significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
KEYS = ["chamber_setpoint_degc", "rate_setpoint_dps"]
WORST_LAST = ("pass", "marginal", "fail")
MISSING = "#ffffff"


def residual_map(dut: DutData, name: str) -> fig.Figure | None:
    """The residual of every cell, blue below and red above zero; None without residuals."""
    points = dut.usable.dropna(subset=[*KEYS, "residual_dps"])
    if points.empty:
        return None
    mean = points.groupby(KEYS)["residual_dps"].mean()
    bound = float(np.max(np.abs(mean.to_numpy())))
    palette = np.array(fig.diverging())
    drawn = fig.canvas()
    axes = fig.axes_at(drawn, 66, 48, 92, 34)
    colours = list(palette[fig.level_of(mean.to_numpy(dtype=float), bound)])
    missing = _grid(axes, dut, mean.index, colours)
    axes.set_title("Residual of each point")
    _scale(drawn, bound, palette)
    alt = (
        f"DUT {dut.name}: map of the residual over rate and chamber setpoint, "
        f"within ±{significant(bound)} degrees per second, {missing} cells without a value."
    )
    return fig.finish(drawn, name, alt)


def verdict_map(dut: DutData, name: str) -> fig.Figure | None:
    """The worst quality verdict of every cell; None without points."""
    from matplotlib.patches import Patch

    points = dut.points.dropna(subset=KEYS)
    if points.empty:
        return None
    rank = points["verdict"].map({verdict: rank for rank, verdict in enumerate(WORST_LAST)}).fillna(len(WORST_LAST) - 1)
    worst = points.assign(rank=rank.astype(int)).groupby(KEYS)["rank"].max()
    verdicts = [WORST_LAST[rank] for rank in worst]
    drawn = fig.canvas()
    axes = fig.axes_at(drawn, 66, 48, 18, 58)
    missing = _grid(axes, dut, worst.index, [fig.VERDICT_COLOURS[verdict] for verdict in verdicts])
    _signs(axes, worst.index, verdicts)
    counts = {verdict: int((points["verdict"] == verdict).sum()) for verdict in WORST_LAST}
    keys = [Patch(facecolor=fig.VERDICT_COLOURS[word], label=f"{word} {counts[word]}") for word in WORST_LAST]
    if missing:
        keys.append(Patch(facecolor=MISSING, edgecolor=fig.HAIRLINE, hatch="////", label=f"not measured {missing}"))
    axes.legend(
        handles=keys, loc="lower left", bbox_to_anchor=(-0.02, 0.985), ncols=4, handlelength=1, columnspacing=1.3
    )
    drawn.text(66 / fig.HALF[0], 1 - 25 / fig.HALF[1], "Quality verdict of each point", weight="bold", size=12.5)
    words = ", ".join(f"{counts[word]} {word}" for word in WORST_LAST)
    alt = f"DUT {dut.name}: map of the quality verdicts: {words}, {missing} cells not measured."
    return fig.finish(drawn, name, alt)


def _grid(axes: Axes, dut: DutData, index: pd.Index[Any], colours: list[str]) -> int:
    """Draw the cells of `index` in their colours and the others as empty; returns how many are empty.

    The grid spans all setpoints seen by this DUT, so a point that was left out shows as a hole.
    """
    known = dut.points.dropna(subset=KEYS)
    temperatures, rates = (np.unique(known[key].to_numpy(dtype=float)) for key in KEYS)
    t_edges, r_edges = _edges(temperatures), _edges(rates)
    row = np.searchsorted(temperatures, index.get_level_values(0).to_numpy(dtype=float))
    column = np.searchsorted(rates, index.get_level_values(1).to_numpy(dtype=float))
    empty = np.ones((len(temperatures), len(rates)), dtype=bool)
    empty[row, column] = False
    hole_row, hole_column = np.nonzero(empty)
    if len(hole_row):
        holes = _boxes(hole_row, hole_column, t_edges, r_edges)
        fig.cells(axes, holes, [MISSING] * len(holes), edgecolor=fig.HAIRLINE, hatch="////")
    fig.cells(axes, _boxes(row, column, t_edges, r_edges), colours)
    axes.set(xlim=(r_edges[0], r_edges[-1]), ylim=(t_edges[0], t_edges[-1]))
    axes.set(xlabel="rate setpoint (°/s)", ylabel="chamber setpoint (°C)")
    fig.setpoint_ticks(axes.xaxis, setpoints=rates)
    fig.setpoint_ticks(axes.yaxis, setpoints=temperatures)
    axes.grid(visible=False)
    return int(empty.sum())


def _boxes(row: NDArray[np.intp], column: NDArray[np.intp], t_edges: Floats, r_edges: Floats) -> Floats:
    return np.stack([r_edges[column], t_edges[row], r_edges[column + 1], t_edges[row + 1]], axis=1)


def _edges(values: Floats) -> Floats:
    """Cell edges half-way between neighbouring setpoints; a single setpoint gets a cell of width 1."""
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = (values[1:] + values[:-1]) / 2
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def _signs(axes: Axes, index: pd.Index[Any], verdicts: list[str]) -> None:
    """A sign in each cell that is not 'pass', so that colour is not the only difference."""
    for verdict, marker in (("marginal", "^"), ("fail", "x")):
        at = [cell for cell, word in zip(index, verdicts, strict=True) if word == verdict]
        if at:
            temperature, rate = np.array(at, dtype=float).T
            axes.plot(rate, temperature, marker, color="white", markersize=5, markeredgewidth=1.4)


def _scale(drawn: Any, bound: float, palette: NDArray[np.str_]) -> None:
    """The colour scale of the residual as a narrow ladder beside the axes."""
    axes = fig.axes_at(drawn, fig.HALF[0] - 78, 48, 64, 56)
    edges = np.linspace(-bound, bound, len(palette) + 1)
    boxes = np.stack([np.zeros(len(palette)), edges[:-1], np.ones(len(palette)), edges[1:]], axis=1)
    fig.cells(axes, boxes, list(palette), edgecolor="none")
    axes.set(xlim=(0, 1), ylim=(-bound, bound) if bound else (-1, 1))
    axes.set_xticks([])
    axes.locator_params(axis="y", nbins=6)
    axes.yaxis.tick_right()
    axes.tick_params(length=0, pad=4)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_title("°/s", fontsize=11.5, fontweight="normal", color=fig.MUTED, pad=6)
