"""The Allan curve with its limits, the fit and its terms, as an SVG: of its own, or in the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bench.report import figures as fig

HEIGHT_PX = 420


def draw(curves: Sequence[tuple[str, Mapping[str, Any]]], name: str, caption: str = "") -> fig.Figure:
    """Curves as `bench.analyses.calibration_parts.allan_table` makes them, each with its label."""
    drawn = fig.canvas((fig.WIDE[0], HEIGHT_PX))
    axes = fig.axes_at(drawn, 84, 50, 16, 36)
    for k, (label, one) in enumerate(curves):
        tau, colour = np.asarray(one["tau_s"]), fig.dut_colour(k)
        axes.fill_between(tau, one["low_dph"], one["high_dph"], color=colour, alpha=0.18, linewidth=0)
        axes.plot(tau, one["deviation_dph"], color=colour, linewidth=1.6, label=label)
        axes.plot(tau, one["fit_dph"], color=colour, linewidth=1.0, linestyle="--")
        lowest = int(np.argmin(one["deviation_dph"]))
        axes.plot(
            [tau[lowest]], [one["deviation_dph"][lowest]], "o", color=colour, markersize=6, markerfacecolor="white"
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    fig.decade_ticks(axes.xaxis)
    fig.decade_ticks(axes.yaxis)
    axes.set_xlabel("averaging time τ (s)")
    axes.set_ylabel("Allan deviation (°/h)")
    fig.legend_above(axes)
    alt = "Overlapping Allan deviation against averaging time, with 95 % limits, the fit and the minimum."
    return fig.finish(drawn, name, alt, caption)


def standalone(curves: Sequence[tuple[str, Mapping[str, Any]]]) -> bytes:
    """The figure as a file."""
    with fig.style():
        figure = draw(curves, "allan")
    return fig.standalone(figure)
