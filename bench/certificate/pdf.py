"""The certificate as one page of A4 in PDF: text that can be searched, drawn by matplotlib, no printer needed."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bench.certificate.content import Page, TableOnPage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A4 in points, and the margins.
WIDTH, HEIGHT, SIDE, TOP, BOTTOM = 595.28, 841.89, 42.0, 40.0, 34.0
INK, MUTED, RULE, GOOD, BAD, AMBER = "#1d2935", "#566370", "#cfd6dc", "#1b6b3a", "#a3123a", "#b8860b"
TITLE, HEADING, BODY, SMALL = 17.0, 9.6, 7.8, 6.9
LEADING = 1.36
LARGEST, SMALLEST = 1.2, 0.6
_FACT_PT = 88.0
_CELL_GAP = 8.0
_SETTINGS: dict[Any, Any] = {"pdf.fonttype": 42, "font.family": "DejaVu Sans", "text.parse_math": False}


@dataclass
class _Sheet:
    """What is drawn so far: texts and rules from the top down; `scale` makes all of it smaller."""

    scale: float
    y: float = TOP
    drawn: list[tuple[str, Any]] = field(default_factory=list)

    def text(self, x: float, text: str, size: float, **style: Any) -> None:
        """A line whose top is at y."""
        self.drawn.append(("text", (x, self.y + 0.8 * size * self.scale, text, size * self.scale, style)))

    def rule(self, colour: str = RULE, width: float = 0.5, x: float = SIDE, end: float = WIDTH - SIDE) -> None:
        """A line across the page at y."""
        self.drawn.append(("rule", (x, end, self.y, colour, width)))

    def down(self, points: float) -> None:
        """Go on lower."""
        self.y += points * self.scale

    def paragraph(self, text: str, size: float, x: float = SIDE, **style: Any) -> None:
        """Text broken into lines of the width there is."""
        for line in wrapped(text, size * self.scale, WIDTH - SIDE - x, bool(style.get("weight"))):
            self.text(x, line, size, **style)
            self.down(size * LEADING)


def width_of(text: str, size: float, bold: bool = False) -> float:
    """Width of a text in points."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal", size=size)
    width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    return float(width)


def wrapped(text: str, size: float, width: float, bold: bool = False) -> list[str]:
    """Lines no wider than `width`; a word that is wider itself is cut."""
    lines, line = [], ""
    for word in text.split():
        while width_of(word, size, bold) > width:
            cut = max(1, int(len(word) * width / width_of(word, size, bold)) - 1)
            lines += [line] if line else []
            lines.append(word[:cut])
            line, word = "", word[cut:]
        candidate = f"{line} {word}".strip()
        if width_of(candidate, size, bold) <= width:
            line = candidate
        else:
            lines.append(line)
            line = word
    return [*lines, line] if line else lines


def pdf(page: Page) -> bytes:
    """The page as a file; as large as the page allows, never cut."""
    import matplotlib
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.figure import Figure

    plain: dict[Any, Any] = {
        key: matplotlib.rcParamsDefault[key] for key in matplotlib.rcParamsDefault if not key.startswith("backend")
    }
    with matplotlib.rc_context():
        matplotlib.rcParams.update(plain | _SETTINGS)
        sheet = _fitting(page)
        figure = Figure(figsize=(WIDTH / 72.0, HEIGHT / 72.0))
        _put(figure, sheet)
        buffer = io.BytesIO()
        about = {"Title": f"{page.title} {page.dut}", "Creator": "fogbench", "CreationDate": None}
        FigureCanvasPdf(figure)
        figure.savefig(buffer, format="pdf", metadata=about)
    return buffer.getvalue()


def _fitting(page: Page) -> _Sheet:
    scale = LARGEST
    while True:
        sheet = _Sheet(scale)
        _lay(sheet, page)
        if sheet.y <= HEIGHT - BOTTOM or scale <= SMALLEST:
            return sheet
        scale = max(SMALLEST, scale - 0.03)


def _put(figure: Figure, sheet: _Sheet) -> None:
    from matplotlib.lines import Line2D

    for kind, about in sheet.drawn:
        if kind == "text":
            x, y, text, size, style = about
            figure.text(x / WIDTH, 1.0 - y / HEIGHT, text, fontsize=size, va="baseline", **({"color": INK} | style))
        else:
            x, end, y, colour, width = about
            level = 1.0 - y / HEIGHT
            figure.add_artist(Line2D([x / WIDTH, end / WIDTH], [level, level], color=colour, linewidth=width))


def _lay(sheet: _Sheet, page: Page) -> None:
    right = WIDTH - SIDE
    sheet.text(SIDE, page.title, TITLE, weight="bold")
    good = page.outcome == "PASS"
    sheet.text(right, page.outcome, TITLE * 0.8, weight="bold", ha="right", color=GOOD if good else BAD)
    sheet.down(TITLE * 1.3)
    sheet.text(SIDE, page.dut, HEADING * 1.15, color=MUTED)
    sheet.text(right, page.outcome_words, BODY, ha="right", color=MUTED)
    sheet.down(HEADING * 1.6)
    sheet.rule(INK, 1.2)
    sheet.down(6.0)
    if page.virtual:
        sheet.rule(AMBER, 1.0)
        sheet.down(3.0)
        sheet.paragraph(page.statements[-1], BODY, weight="bold")
        sheet.down(1.0)
        sheet.rule(AMBER, 1.0)
        sheet.down(5.0)
    for name, text in page.facts:
        sheet.text(SIDE, name, BODY, color=MUTED)
        sheet.paragraph(text, BODY, SIDE + _FACT_PT * sheet.scale)
    for table in (page.figures, page.compensated, *page.budgets):
        if table is not None:
            _table(sheet, table)
    sheet.down(7.0)
    sheet.rule()
    sheet.down(4.0)
    for text in page.statements[: -1 if page.virtual else None]:
        sheet.paragraph(text, SMALL, color=MUTED)
        sheet.down(2.0)


def _table(sheet: _Sheet, table: TableOnPage) -> None:
    sheet.down(9.0)
    sheet.text(SIDE, table.title, HEADING, weight="bold")
    sheet.down(HEADING * 1.5)
    size, edges = _edges(table, SMALL * 1.04 * sheet.scale)
    _row(sheet, table, table.columns, (size, edges), weight="bold")
    sheet.rule(INK, 0.7)
    sheet.down(2.0)
    for number, row in enumerate(table.rows):
        total = row[0].startswith(("combined", "expanded"))
        if total and not table.rows[number - 1][0].startswith("combined"):
            sheet.rule(INK, 0.7)
            sheet.down(1.5)
        _row(sheet, table, row, (size, edges), **({"weight": "bold"} if total else {}))
    if table.note:
        sheet.down(1.0)
        sheet.paragraph(table.note, SMALL, color=MUTED)


def _edges(table: TableOnPage, size: float) -> tuple[float, list[tuple[float, float]]]:
    """Size of the text, and left and right edge of each column: as wide as its widest cell, what is left shared out.

    Text of a table that is too wide for the page is made smaller.
    """
    cells = [table.columns, *table.rows]
    wide = [max(width_of(row[k], 10.0, bold=True) for row in cells) / 10.0 for k in range(len(table.columns))]
    room, gaps = WIDTH - 2.0 * SIDE, max(1, len(wide) - 1)
    size = min(size, (room - _CELL_GAP * gaps) / sum(wide))
    gap = (room - size * sum(wide)) / gaps
    edges, x = [], SIDE
    for width in wide:
        edges.append((x, x + size * width))
        x += size * width + gap
    return size, edges


def _row(
    sheet: _Sheet,
    table: TableOnPage,
    row: Sequence[str],
    layout: tuple[float, Sequence[tuple[float, float]]],
    **style: Any,
) -> None:
    size, edges = layout
    for text, (left, end), numeric in zip(row, edges, table.numeric, strict=True):
        if text:
            sheet.text(end if numeric else left, text, size / sheet.scale, ha="right" if numeric else "left", **style)
    sheet.down(SMALL * 1.5)
