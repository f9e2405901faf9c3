"""The figure of a comparison: std of every model, median and worst, over the noise floor, one panel per split."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.compare.line import Line
from bench.report import figures as fig
from bench.report.wording import model_name, split_name
from bench.runfolder import write_atomic

ROW_PX, HEAD_PX, FOOT_PX, LABEL_PX = 26, 44, 46, 150


def draw(lines: Sequence[Line], path: Path) -> None:
    """Write the figure as a standalone SVG file."""
    splits = [split for split in dict.fromkeys(line.split for line in lines) if split != "random_train"]
    models = list(dict.fromkeys(line.model for line in lines))
    owners = list(dict.fromkeys((line.run, line.dut) for line in lines))
    height = HEAD_PX + FOOT_PX + ROW_PX * len(models)
    with fig.style():
        drawn = fig.canvas((fig.WIDE[0], height))
        width = (fig.WIDE[0] - LABEL_PX - 20) // max(1, len(splits))
        for k, split in enumerate(splits):
            left = LABEL_PX + k * width
            axes = fig.axes_at(drawn, left, FOOT_PX, fig.WIDE[0] - left - width + 24, HEAD_PX)
            for number, owner in enumerate(owners):
                mine = [line for line in lines if (line.run, line.dut) == owner and line.split == split]
                offset = (number - 0.5 * (len(owners) - 1)) * 0.5 / max(1, len(owners))
                rows = np.array([models.index(line.model) for line in mine]) + offset
                median = np.array([float(np.median(line.std_dps)) for line in mine])
                worst = np.array([float(np.max(line.std_dps)) for line in mine])
                colour = fig.dut_colour(number)
                axes.hlines(rows, median, worst, color=colour, linewidth=1.4)
                axes.plot(median, rows, "o", color=colour, markersize=5, label=f"{owner[1]} ({owner[0]})")
                if mine:
                    axes.axvline(mine[0].floor_dps, color=fig.FLOOR, linewidth=1.0, linestyle="--")
            axes.set_xscale("log")
            fig.decade_ticks(axes.xaxis)
            axes.set_yticks(range(len(models)), [model_name(model) for model in models] if k == 0 else [])
            axes.set_ylim(len(models) - 0.5, -0.5)
            axes.set_xlabel("std of the error (°/s)")
            axes.set_title(split_name(split))
        drawn.axes[0].legend(loc="best", fontsize=9)
        figure = fig.finish(drawn, "compare", "Standard deviation of the error of every model, median and worst seed.")
    write_atomic(path, fig.standalone(figure))
