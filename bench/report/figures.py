"""One visual style, and matplotlib figures as inline SVG: real text, no fonts, no global ids, no style sheets inside.

matplotlib is imported inside the functions (0.5 s), and never through pyplot: nothing here keeps a figure alive.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

Floats = NDArray[np.float64]

INK, MUTED, HAIRLINE, GRID = "#1d2935", "#5b6875", "#b9c2cb", "#e6eaee"
SETPOINT, FLOOR = "#8a97a3", "#c9a227"
# Okabe and Ito's palette: distinguishable with every common colour-vision deficiency.
DUT_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
VERDICT_COLOURS = {"pass": "#cfe0ec", "marginal": "#e69f00", "fail": "#a3123a"}
HALF = (480, 330)
WIDE = (980, 470)
LEVELS = 31
TIME_STEPS_S = (1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800)

# matplotlib's settings, applied only while the report is drawn.
_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "fogbench",
    "text.parse_math": False,
    "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": False,
    "axes.formatter.useoffset": False,
    "font.size": 12,
    "axes.labelsize": 12,
    "axes.titlesize": 12.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 9,
    "xtick.labelsize": 11.5,
    "ytick.labelsize": 11.5,
    "legend.fontsize": 11.5,
    "legend.frameon": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": HAIRLINE,
    "axes.linewidth": 1.0,
    "xtick.color": HAIRLINE,
    "ytick.color": HAIRLINE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 1.0,
    "lines.linewidth": 1.4,
    "path.simplify": False,
}


@dataclass(frozen=True)
class Figure:
    """One drawn figure: `svg` is safe HTML, `alt` says in words what is seen, `caption` stands below it."""

    svg: str
    alt: str
    caption: str = ""


@contextmanager
def style() -> Iterator[None]:
    """The report's look, for everything drawn inside."""
    import matplotlib

    # Reading or copying the setting 'backend' would import pyplot (0.4 s) and pick a window system.
    plain: dict[Any, Any] = {
        key: matplotlib.rcParamsDefault[key] for key in matplotlib.rcParamsDefault if not key.startswith("backend")
    }
    with matplotlib.rc_context(), warnings.catch_warnings():
        matplotlib.rcParams.update(plain | _SETTINGS)
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def canvas(size: tuple[int, int] = HALF) -> Canvas:
    """An empty figure of `size` in CSS pixels at full width (72 matplotlib dots to the inch)."""
    from matplotlib.figure import Figure as NewCanvas

    drawn = NewCanvas(figsize=(size[0] / 72, size[1] / 72))
    drawn.patch.set_visible(False)
    return drawn


def axes_at(drawn: Canvas, left: float, bottom: float, right: float, top: float, **options: Any) -> Axes:
    """Axes whose edges are given in pixels from the left and the bottom of the figure; `right`, `top` are margins."""
    width, height = drawn.get_size_inches() * 72
    box = (left / width, bottom / height, (width - left - right) / width, (height - bottom - top) / height)
    return drawn.add_axes(box, **options)


def legend_above(axes: Axes, columns: int = 6) -> None:
    """A one-line key above the axes, starting at their left edge."""
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(
        handles,
        labels,
        loc="lower left",
        bbox_to_anchor=(-0.01, 1.0),
        ncols=min(columns, len(labels)),
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.6,
        handletextpad=0.6,
    )


def setpoint_ticks(axis: Any, most: int = 7, setpoints: Floats | None = None) -> None:
    """Ticks where setpoints usually lie: steps of 15 degC over -30..60, of 60 deg/s over -180..180.

    If there are few `setpoints`, the ticks are these and no others.
    """
    from matplotlib.ticker import MaxNLocator

    if setpoints is not None and len(setpoints) <= most:
        axis.set_ticks(setpoints)
        return
    axis.set_major_locator(MaxNLocator(nbins=most, steps=[1, 1.5, 2, 3, 5, 6, 10]))


def decade_ticks(axis: Any) -> None:
    """Plain numbers at the decades of a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axis.set_major_locator(LogLocator(numticks=9))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.9f}".rstrip("0").rstrip(".")))


def dut_colour(number: int) -> str:
    """The colour of the DUT with this number, the same in every figure."""
    return DUT_COLOURS[number % len(DUT_COLOURS)]


def diverging() -> list[str]:
    """LEVELS colours from blue (negative) over near-white (zero) to red (positive), safe for colour-blind readers."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colormaps["RdBu_r"](np.linspace(0.04, 0.96, LEVELS))]


def warmth(n: int) -> list[str]:
    """`n` colours from cold (dark blue) to warm (orange), even in lightness."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colormaps["plasma"](np.linspace(0.0, 0.84, max(n, 2)))][:n]


def level_of(values: Floats, bound: float) -> NDArray[np.int64]:
    """The level 0..LEVELS-1 of each value on a scale from -bound to +bound."""
    scaled = (np.clip(values / bound, -1, 1) + 1) / 2 if bound > 0 else np.full(values.shape, 0.5)
    return np.minimum((scaled * LEVELS).astype(np.int64), LEVELS - 1)


def cells(axes: Axes, boxes: Floats, colours: Sequence[str], **options: Any) -> None:
    """Fill the boxes (n, 4: left, bottom, right, top), one SVG path for all boxes of one colour.

    The caller sets the limits of the axes: finding them from the paths would take longer than drawing.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    named = np.array(colours)
    for colour in dict.fromkeys(colours):
        left, bottom, right, top = boxes[named == colour].T
        corners = np.stack([left, bottom, right, bottom, right, top, left, top, left, bottom], axis=1).reshape(-1, 2)
        codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(left))
        patch = PathPatch(Path(corners, codes), facecolor=colour, **{"edgecolor": "white", "linewidth": 0.6, **options})
        axes.add_artist(patch)


def dots(axes: Axes, x: Floats, y: Floats, colour: str, size: float = 3.4, **options: Any) -> None:
    """Round dots as one path of zero-length strokes: a tenth of the size of one SVG element per dot."""
    gap = np.full(len(x), math.nan)
    xs, ys = np.stack([x, x, gap], axis=1).ravel(), np.stack([y, y, gap], axis=1).ravel()
    axes.plot(xs, ys, color=colour, linewidth=size, solid_capstyle="round", **options)


def time_axis(axes: Axes, last_s: float, first_s: float = 0.0, label: str = "bench time") -> float:
    """Label the x axis in the unit that suits the span; returns the seconds in that unit (plot t_s divided by it)."""
    from matplotlib.ticker import MultipleLocator

    span = max(last_s - first_s, 1e-9)
    unit_s, unit = (3600.0, "h") if span > 2 * 3600 else (60.0, "min") if span > 180 else (1.0, "s")
    step_s = next((step for step in TIME_STEPS_S if span / step <= 15), TIME_STEPS_S[-1])
    axes.xaxis.set_major_locator(MultipleLocator(step_s / unit_s))
    axes.set_xlim(first_s / unit_s, last_s / unit_s)
    axes.set_xlabel(f"{label} ({unit})")
    return unit_s


def finish(drawn: Canvas, name: str, alt: str, caption: str = "") -> Figure:
    """The figure as an SVG element that can stand in a page beside others; `name` keeps its ids apart."""
    buffer = io.StringIO()
    drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return Figure(_inline(buffer.getvalue(), name, alt), alt, caption)


def standalone(figure: Figure) -> bytes:
    """The figure as an SVG file of its own."""
    return figure.svg.replace("<svg ", _FILE_HEAD, 1).encode("utf-8")


# What an SVG element needs to be a file.
_FILE_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'font-family="sans-serif" style="background:white" '
)
_NOISE = re.compile(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", re.DOTALL)
_FAMILY = re.compile(r"font-family: [^;\"]*;? ?")
_TAG = re.compile(r"<[^>]*>")
_GEOMETRY = re.compile(r' (d|x|y|points|transform)="([^"]*)"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{2,}")
_ID = re.compile(r' id="([^"]*)"')
_REFERENCE = re.compile(r"(href=\"#|url\(#)([^\")]*)")


def _inline(document: str, name: str, alt: str) -> str:
    """Cut the document down to its <svg>: page fonts, coordinates to a tenth of a pixel, only used ids, prefixed."""
    body = _NOISE.sub("", document[document.index("<svg") :])
    body = _FAMILY.sub("", body)
    body = _TAG.sub(lambda tag: _GEOMETRY.sub(_shortened, tag[0]), body)
    used = {match[2] for match in _REFERENCE.finditer(body)}
    body = _ID.sub(lambda match: f' id="{name}-{match[1]}"' if match[1] in used else "", body)
    body = _REFERENCE.sub(lambda match: f"{match[1]}{name}-{match[2]}", body)
    body = re.sub(r">\s+<", "><", body)
    view = re.search(r'viewBox="[^"]*"', body)
    start = f'<svg {view[0] if view else ""} role="img" aria-label="{escape(alt)}">'
    return start + body[body.index(">") + 1 :].strip()


def _shortened(attribute: re.Match[str]) -> str:
    short = _LONG_NUMBER.sub(lambda number: f"{float(number[0]):.1f}".removesuffix(".0"), attribute[2])
    return f' {attribute[1]}="{" ".join(short.split())}"'
