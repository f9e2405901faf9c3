"""CSV and Parquet files in pieces, every row with its place, so that a file of any size takes little memory."""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from bench.errors import InvalidFiles, Mark, Problem, UserMistake, did_you_mean

CHUNK_ROWS = 20_000
MOST_PROBLEMS = 20
SUFFIXES = (".csv", ".tsv", ".txt", ".parquet")
# How loggers write that there is no value; an infinite value is one of them, since no sensor measures it.
MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "inf", "-inf", "+inf"})
_DELIMITERS = ",;\t"


@dataclass(frozen=True)
class Chunk:
    """Some rows of a file: cells as text, and the line (Parquet: row) of each."""

    path: Path
    header: tuple[str, ...]
    cells: list[list[str]]
    lines: list[int]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A column as numbers, (n,); NaN where there is no value. Raises InvalidFiles with all places of other text."""
        k = self.header.index(name)
        try:
            values = np.array([float(row[k]) for row in self.cells], dtype=np.float64)
        except ValueError:
            values = self._one_by_one(name, k)
        values[~np.isfinite(values)] = np.nan
        return values

    def texts(self, name: str) -> list[str]:
        """A column as it is."""
        k = self.header.index(name)
        return [row[k] for row in self.cells]

    def _one_by_one(self, name: str, k: int) -> NDArray[np.float64]:
        values, problems = np.empty(len(self.cells)), []
        for number, row in enumerate(self.cells):
            text = row[k].strip()
            try:
                values[number] = math.nan if text.lower() in MISSING else float(text)
            except ValueError:
                mark = Mark(str(self.path), self.lines[number], k + 1)
                problems.append(Problem(mark, f"column '{name}' has {_shown(text)}{_advice(text)}"))
        if problems:
            raise InvalidFiles(problems[:MOST_PROBLEMS])
        return values


def _shown(text: str) -> str:
    return f"'{text[:30]}…'" if len(text) > 30 else f"'{text}'"


def _advice(text: str) -> str:
    if "," in text:
        return "; write a decimal point, as in 12.5, and no thousands separator."
    return "; allowed: a number such as -12.5 or 1e-3, or nothing (or nan) where there is no value."


@dataclass
class Table:
    """A file that has a header; `chunks` gives its rows. comments: lines with # above the header, as they are."""

    path: Path
    header: tuple[str, ...]
    delimiter: str = ","
    comments: list[str] = field(default_factory=list)
    header_line: int = 1

    def chunks(self, rows: int = CHUNK_ROWS) -> Iterator[Chunk]:
        """All rows, so many at a time. Raises InvalidFiles for a row with too many or too few cells."""
        return self._parquet_chunks(rows) if is_parquet(self.path) else self._csv_chunks(rows)

    def column(self, wanted: str, what: str) -> str:
        """`wanted` if the file has it. Raises UserMistake with the columns there are."""
        if wanted not in self.header:
            raise UserMistake(
                f"{self.path}:{self.header_line}: there is no column '{wanted}' for the {what}."
                f"{did_you_mean(wanted, self.header)}"
            )
        return wanted

    def _csv_chunks(self, rows: int) -> Iterator[Chunk]:
        with _opened(self.path) as file:
            for _ in range(self.header_line - 1):
                file.readline()
            reader = csv.reader(file, delimiter=self.delimiter)
            next(reader)
            cells: list[list[str]] = []
            lines: list[int] = []
            for row in _rows_of(reader, self.path):
                if not row:  # a blank line
                    continue
                line = self.header_line - 1 + reader.line_num
                if len(row) != len(self.header):
                    raise InvalidFiles([Problem(Mark(str(self.path), line, len(row)), _uneven(row, self))])
                cells.append(row)
                lines.append(line)
                if len(cells) == rows:
                    yield Chunk(self.path, self.header, cells, lines)
                    cells, lines = [], []
            if cells:
                yield Chunk(self.path, self.header, cells, lines)

    def _parquet_chunks(self, rows: int) -> Iterator[Chunk]:
        import pyarrow.parquet

        done = 0
        with pyarrow.parquet.ParquetFile(self.path) as file:
            for batch in file.iter_batches(batch_size=rows):
                columns = [["" if cell is None else str(cell) for cell in column.to_pylist()] for column in batch]
                cells = [list(row) for row in zip(*columns, strict=True)]
                yield Chunk(self.path, self.header, cells, list(range(done + 1, done + 1 + len(cells))))
                done += len(cells)


def _rows_of(reader: Any, path: Path) -> Iterator[list[str]]:
    try:
        yield from reader
    except (csv.Error, UnicodeDecodeError) as error:
        raise InvalidFiles([Problem(Mark(str(path), reader.line_num + 1, 1), f"cannot be read: {error}")]) from error


def _uneven(row: list[str], table: Table) -> str:
    names = len(table.header)
    return (
        f"this row has {len(row)} cells and the header has {names} names. Every row needs one cell a name, separated "
        f"by {table.delimiter!r}; a number with a decimal comma makes two cells."
    )


def is_parquet(path: Path) -> bool:
    """Whether a file is Parquet, by its name."""
    return path.suffix.lower() == ".parquet"


def is_table(path: Path) -> bool:
    """Whether an argument names a recording rather than a run."""
    return path.suffix.lower() in SUFFIXES or path.is_file()


def open_table(path: Path) -> Table:
    """Look at a file's header. Raises UserMistake if there is none that can be used."""
    if not path.is_file():
        raise UserMistake(f"{path}: there is no such file. Allowed: a CSV file with a header, or a Parquet file.")
    table = _open_parquet(path) if is_parquet(path) else _open_csv(path)
    twice = sorted({name for name in table.header if table.header.count(name) > 1})
    if twice:
        raise UserMistake(f"{path}:{table.header_line}: the column '{twice[0]}' is there twice; rename one of them.")
    return table


def _open_parquet(path: Path) -> Table:
    import pyarrow
    import pyarrow.parquet

    try:
        return Table(path, tuple(pyarrow.parquet.read_schema(path).names))
    except (pyarrow.ArrowException, OSError) as error:
        raise UserMistake(f"{path}: this is not a Parquet file ({error}). A CSV file must end in .csv.") from error


def _open_csv(path: Path) -> Table:
    """The header is the first line that is not a comment; the delimiter is the one it has most of."""
    comments: list[str] = []
    try:
        with _opened(path) as file:
            for line in file:
                if not line.startswith("#"):
                    break
                comments.append(line.rstrip("\r\n"))
            else:
                raise UserMistake(f"{path}: the file is empty. The first line must name the columns.")
    except UnicodeDecodeError as error:
        raise UserMistake(f"{path}: this is not text in UTF-8 ({error}). Save it as CSV in UTF-8.") from error
    delimiter = max(_DELIMITERS, key=line.count)
    names = tuple(name.strip() for name in next(csv.reader([line], delimiter=delimiter), []))
    if names and all(_is_number(name) for name in names):
        raise UserMistake(f"{path}:{len(comments) + 1}: the first line holds numbers; it must name the columns.")
    return Table(path, names, delimiter, comments, len(comments) + 1)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _opened(path: Path) -> TextIO:
    return path.open(encoding="utf-8-sig", newline="")


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
