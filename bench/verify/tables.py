"""Points and timeline: the files against the folds of the journal that they should be."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.points import COLUMNS, TEXT_COLUMNS, timeline_of
from bench.verify.findings import Check, Finding, collect
from bench.verify.record import Record

if TYPE_CHECKING:
    import pandas as pd

# Cells of a column that are listed one by one.
MOST_CELLS = 5


def check_tables(record: Record) -> Check:
    """points.csv, points.parquet and timeline.parquet."""
    findings: list[Finding] = []
    points = record.points
    collect(findings, "points.csv", _csv, record.folder / "points.csv", points)
    timeline = timeline_of(record.entries)
    collect(findings, "points.parquet", _parquet, record.folder / "points.parquet", points)
    collect(findings, "timeline.parquet", _parquet, record.folder / "timeline.parquet", timeline)
    return Check("points and timeline", f"{len(points)} points, {len(timeline)} readbacks folded again", findings)


def read_table(path: Path, most_rows: int) -> pd.DataFrame:
    """A small Parquet table. Raises ValueError, OSError or an error of pyarrow's if it is damaged."""
    import pyarrow.parquet as pq

    if not path.is_file():
        raise FileNotFoundError("it is missing, or not a regular file")
    with pq.ParquetFile(path) as file:
        if not 0 <= file.metadata.num_rows <= most_rows:
            raise ValueError(f"it says it has {file.metadata.num_rows} rows; expected at most {most_rows}")
        table: pd.DataFrame = file.read(use_threads=False).to_pandas()
    return table


def _csv(path: Path, points: pd.DataFrame) -> Iterator[Finding]:
    """What in the text differs from the text the points would be written as."""
    if not path.is_file():
        raise FileNotFoundError("it is missing, or not a regular file")
    expected, found = points.to_csv(index=False, lineterminator="\n").encode(), path.read_bytes()
    if found == expected:
        return
    cells: list[Finding] = []
    collect(cells, path.name, _text_cells, path.name, points, found)
    line = next(
        (n for n, (a, b) in enumerate(zip(expected.split(b"\n"), found.split(b"\n"), strict=False), start=1) if a != b),
        min(expected.count(b"\n"), found.count(b"\n")) + 1,
    )
    yield from cells or [Finding("its text is not what the points are written as", f"{path.name}:{line}")]


def _parquet(path: Path, expected: pd.DataFrame) -> Iterator[Finding]:
    return cells(path.name, expected, read_table(path, len(expected)))


def _text_cells(name: str, points: pd.DataFrame, text: bytes) -> Iterator[Finding]:
    import pandas as pd

    empty = {column: [""] for column in COLUMNS if column not in TEXT_COLUMNS}
    table = pd.read_csv(
        io.BytesIO(text), dtype=dict.fromkeys(TEXT_COLUMNS, str), keep_default_na=False, na_values=empty
    )
    return cells(name, points, table)


def cells(name: str, expected: pd.DataFrame, found: pd.DataFrame) -> Iterator[Finding]:
    """Cells that differ, to the last bit; a missing value equals a missing value."""
    if list(expected.columns) != list(found.columns):
        columns = sorted(map(str, set(expected.columns) ^ set(found.columns)))
        yield Finding(f"its columns are others: {', '.join(columns) or 'in another order'}", name)
        return
    if len(expected) != len(found):
        yield Finding("it has another number of rows", name, None, None, "rows", len(expected), len(found))
        return
    for column in expected.columns:
        wanted, got = expected[column], found[column]
        rows = np.flatnonzero(_differ(wanted, got))
        for row in rows[:MOST_CELLS]:
            point = int(expected["point"].iloc[row]) if "point" in expected else None
            dut = str(expected["dut"].iloc[row]) if "dut" in expected else None
            text = f"row {row + 1}, {column}, is not what the journal has"
            yield Finding(text, name, point, dut, column, _plain(wanted.iloc[row]), _plain(got.iloc[row]))
        if len(rows) > MOST_CELLS:
            yield Finding(f"and {len(rows) - MOST_CELLS} more rows of {column}", name)


def _differ(expected: pd.Series[Any], found: pd.Series[Any]) -> np.ndarray[Any, Any]:
    if expected.dtype.kind in "if":
        if found.dtype != expected.dtype:
            return np.ones(len(expected), bool)
        wanted, got = expected.to_numpy(), found.to_numpy()
        return np.asarray((wanted != got) & ~((wanted != wanted) & (got != got)))
    return np.array([a != b for a, b in zip(expected, found, strict=True)], bool)


def _plain(value: Any) -> str | int | float:
    return value.item() if hasattr(value, "item") else str(value)
