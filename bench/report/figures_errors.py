"""Figures of the result: how large the error is per model, and the error surface before and after compensation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report import figures as fig
from bench.report.data import HELD_BACK_SPLIT, DutData
from bench.report.formats import significant
from bench.report.residuals import HEADLINE_SPLIT
from bench.report.wording import model_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
ELEVATION_DEG, AZIMUTH_DEG = 24, -128
LARGEST_SIDE = 45
LEGEND_COLUMNS = 2
SERIES = (
    (HEADLINE_SPLIT, "leave temperatures out", "#0072b2", 0.13, "o"),
    (HELD_BACK_SPLIT, "random split, held-back points", "#8a97a3", -0.13, "s"),
)


def model_scores(dut: DutData, name: str) -> fig.Figure | None:
    """Std and largest error of every model on a logarithmic axis, noise floor beside; None without figures of merit."""
    models = list(dut.metrics)
    series = [spec for spec in SERIES if any(_drawable(dut, model, spec[0]) for model in models)]
    if not series:
        return None
    legend_rows = math.ceil((len(series) + bool(dut.floor_dps)) / LEGEND_COLUMNS)
    size = (fig.HALF[0], 102 + 19 * legend_rows + 44 * max(len(models), 2))
    drawn = fig.canvas(size)
    axes = fig.axes_at(drawn, 132, 46, 18, 40 + 19 * legend_rows)
    drawn.text(132 / size[0], 1 - 18 / size[1], f"DUT {dut.name}", weight="bold", size=12.5)
    for split, label, colour, shift, marker in series:
        _score_series(axes, dut, models, split, label, colour, shift if len(series) > 1 else 0.0, marker)
    if dut.floor_dps:
        axes.axvline(dut.floor_dps, color=fig.FLOOR, linewidth=1.8, linestyle=(0, (4, 2)), label="noise floor")
    axes.set_xscale("log")
    fig.decade_ticks(axes.xaxis)
    axes.set_yticks(range(len(models)), [model_name(model) for model in models])
    axes.set_ylim(len(models) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0, labelcolor=fig.INK)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("error (°/s), logarithmic")
    fig.legend_above(axes, columns=LEGEND_COLUMNS)
    alt = f"DUT {dut.name}: standard deviation and largest error of each model on a logarithmic axis."
    return fig.finish(drawn, name, alt)


def _drawable(dut: DutData, model: str, split: str) -> bool:
    """Whether both figures are there and not zero, which a logarithmic axis cannot show."""
    return all(dut.figure(model, split, quantity) for quantity in ("std_dps", "max_abs_dps"))


def _score_series(
    axes: Axes, dut: DutData, models: list[str], split: str, label: str, colour: str, shift: float, marker: str
) -> None:
    """A marker at the std and a whisker to the largest error, for every model that was judged on this split."""
    named = False
    for row, model in enumerate(models):
        std, largest = (dut.figure(model, split, quantity) for quantity in ("std_dps", "max_abs_dps"))
        if not std or not largest:
            continue
        y = row - shift
        axes.plot([std, largest], [y, y], color=colour, linewidth=2, solid_capstyle="butt")
        axes.plot([largest], [y], color=colour, marker="|", markersize=10, markeredgewidth=2)
        axes.plot(
            [std], [y], color=colour, marker=marker, markersize=7.5, linestyle="none", label=None if named else label
        )
        named = True


def error_surface(dut: DutData, column: str, name: str) -> fig.Figure | None:
    """The error over temperature and rate as a surface; None if no four neighbouring points were measured.

    `column` is error_dps (as measured) or residual_dps (compensated); both are seen from the same side.
    """
    import mpl_toolkits.mplot3d  # type: ignore[import-untyped]  # noqa: F401  (registers the projection)

    patches = _patches(dut.usable, column)
    if not len(patches):
        return None
    drawn = fig.canvas((fig.HALF[0], 400))
    axes: Any = fig.axes_at(drawn, 0, 0, 6, 30, projection="3d", computed_zorder=False)
    bound = float(np.max(np.abs(patches[..., 2])))
    _surface(axes, patches, bound)
    _frame(axes, patches)
    before = column == "error_dps"
    held_out = ", held out" if dut.held_out else ""
    words = "as measured" if before else f"after {model_name(dut.model or '')}{held_out}"
    drawn.text(0.02, 0.955, f"Error {words}", weight="bold", size=12.5)
    drawn.text(0.02, 0.90, f"z axis: ±{significant(bound, 2)} °/s", size=11.5, color=fig.MUTED)
    low, high = float(np.min(patches[..., 2])), float(np.max(patches[..., 2]))
    alt = (
        f"DUT {dut.name}: surface of the error {words} over temperature and rate, "
        f"from {significant(low)} to {significant(high)} degrees per second."
    )
    return fig.finish(drawn, name, alt)


def surface_bound_dps(dut: DutData, column: str) -> float | None:
    """The largest magnitude on a surface, to say how much finer one z axis is than the other."""
    values = dut.usable[column].to_numpy(dtype=float)
    values = values[np.isfinite(values)]
    return float(np.max(np.abs(values))) if values.size else None


def _patches(points: pd.DataFrame, column: str) -> Floats:
    """Quadrilaterals (n, 4, 3) of temperature, rate and error between neighbouring points of the grid."""
    keys = ["chamber_setpoint_degc", "rate_setpoint_dps"]
    seen = points.dropna(subset=[*keys, column, "dut_temperature_degc"])
    mean = seen.groupby(keys)[["dut_temperature_degc", "rate_reference_dps", column]].mean()
    if mean.empty:
        return np.empty((0, 4, 3))
    layers = [_thinned(mean[name].unstack().to_numpy(dtype=float)) for name in mean.columns]
    grid: Floats = np.stack(layers, axis=-1)
    corners = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2).reshape(-1, 4, 3)
    return np.asarray(corners[np.isfinite(corners).all(axis=(1, 2))])


def _thinned(layer: Floats) -> Floats:
    """At most LARGEST_SIDE rows and columns, evenly chosen with both ends kept."""
    rows, columns = (np.unique(np.linspace(0, n - 1, min(n, LARGEST_SIDE)).round().astype(int)) for n in layer.shape)
    return np.asarray(layer[np.ix_(rows, columns)], dtype=np.float64)


def _surface(axes: Any, patches: Floats, bound: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    palette = np.array(fig.diverging())
    colours = palette[fig.level_of(patches[..., 2].mean(axis=1), bound)]
    axes.add_collection3d(
        Poly3DCollection(patches, facecolors=list(colours), edgecolors=fig.MUTED, linewidths=0.35, clip_on=False)
    )


def _frame(axes: Any, patches: Floats) -> None:
    """Limits, ticks, panes and viewpoint: the same for both surfaces of a DUT but for the z scale."""
    low, high = patches.reshape(-1, 3).min(axis=0), patches.reshape(-1, 3).max(axis=0)
    bound = max(abs(float(low[2])), abs(float(high[2])), math.ulp(1.0))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(-bound, bound))
    axes.view_init(elev=ELEVATION_DEG, azim=AZIMUTH_DEG)
    axes.set_box_aspect((1.15, 1.15, 0.8), zoom=1.07)
    axes.set_xlabel("DUT temperature (°C)", labelpad=6)
    axes.set_ylabel("rate (°/s)", labelpad=6)
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel("error (°/s)", labelpad=8, rotation=90)
    fig.setpoint_ticks(axes.xaxis, 6)
    fig.setpoint_ticks(axes.yaxis, 6)
    axes.locator_params(axis="z", nbins=6, prune="lower")
    axes.tick_params(pad=1)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color("#f7f9fa")
        axis.line.set_color(fig.HAIRLINE)
        axis._axinfo["grid"].update(color=fig.GRID, linewidth=0.8)
