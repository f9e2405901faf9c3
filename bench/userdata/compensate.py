"""A recording with its rate compensated, row by row, in pieces of bounded size."""

from __future__ import annotations

import codecs
import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import UserMistake
from bench.runfolder import atomic_file
from bench.userdata.columns import columns_named, one_column, parse_map
from bench.userdata.history import Row, compensated, has_history
from bench.userdata.tables import CHUNK_ROWS, Chunk, Table, is_parquet, open_table
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import RATE, RATE_INPUT

COMPENSATED, GUARDED = "compensated_dps", "guarded"
_SUFFIXES = {"deg/s": "dps", "deg/h": "dph", "degC": "degc", "degC/min": "degc_min"}
_RATES = ("rate", "rate_output")


@dataclass
class Counts:
    """Rows of a file: all, those outside the training range, those without a value in some column."""

    rows: int = 0
    outside: int = 0
    missing: int = 0


@dataclass(frozen=True)
class Applied:
    """What was written where, and how much of it may be trusted. columns: those of the file, by the model's input."""

    out: Path
    columns: Mapping[str, str]
    counts: Counts

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        counts = self.counts
        return {
            "out": str(self.out), "columns": dict(self.columns), "rows": counts.rows, "outside": counts.outside,
            "missing": counts.missing,
        }  # fmt: skip


def compensate_file(
    compensation: Compensation,
    path: Path,
    options: tuple[str, ...],
    out: Path,
    period_s: float | None = None,
    chunk_rows: int = CHUNK_ROWS,
) -> Applied:
    """Write a copy of a file as CSV with the columns `compensated_dps` (nan where a value is missing) and `guarded`.

    period_s: between rows, of a model that looks at the history of the temperatures, if it is not that of its training.
    Raises UserMistake, or InvalidFiles with the places of what is no number; then nothing is written.
    """
    _check_out(path, out)
    if period_s is not None and not has_history(compensation):
        raise UserMistake("--period is for models that look at the history of the temperatures; this one does not.")
    table = open_table(path)
    for name in (COMPENSATED, GUARDED):
        if name in table.header:
            raise UserMistake(f"{path}: there is a column '{name}' already; rename it, or give the original file.")
    columns = find_columns(compensation, table, options)
    counts = Counts()
    with atomic_file(out) as binary:
        file = codecs.getwriter("utf-8")(binary)
        file.writelines(f"{comment}\n" for comment in table.comments)
        writer = csv.writer(file, delimiter=table.delimiter, lineterminator="\n")
        writer.writerow([*table.header, COMPENSATED, GUARDED])
        chunks = table.chunks(chunk_rows)
        by_rows = _by_rows(compensation, chunks, columns)
        rows = compensated(compensation, chunks, columns, period_s) if has_history(compensation) else by_rows
        for cells, value, outside, missing in rows:
            counts.rows += 1
            counts.missing += missing
            counts.outside += outside and not missing
            writer.writerow([*cells, repr(value), int(outside or missing)])
    return Applied(out, columns, counts)


def find_columns(compensation: Compensation, table: Table, options: tuple[str, ...]) -> dict[str, str]:
    """The column of the file for each input, and for the rate. Raises UserMistake naming what is not there.

    Taken are, in this order: what --map says; columns of an input's name, with or without its unit; the columns that
    the model was fitted to.
    """
    names = [column.name for column in compensation.inputs]
    wanted = [*names, *([] if compensation.output == RATE else [RATE_INPUT.name])]
    mapped = _mapped(table, names, parse_map(options, [*dict.fromkeys([*wanted, "temperature", "rate"])]))
    fitted = _fitted_to(compensation, table)
    found = {}
    for name in wanted:
        column = mapped.get(name) or next(
            (c for c in _usual(compensation, name) if c in table.header), fitted.get(name)
        )
        if column is None:
            raise UserMistake(
                f"{table.path}:{table.header_line}: which column is the model's input '{name}'? Looked for "
                f"{' and '.join(_usual(compensation, name))}; there are {', '.join(table.header)}. "
                f"Say it with --map {'rate' if name in _RATES else name}=COL"
            )
        found[name] = column
    return found


def _mapped(table: Table, names: list[str], chosen: Mapping[str, str]) -> dict[str, str]:
    """--map by the names of inputs: rate stands for rate_output, temperature=T1+T2 for all temperatures in turn."""
    found = dict[str, str]()
    temperatures = [name for name in names if name.startswith("temperature")]
    for quantity, text in chosen.items():
        if quantity == "temperature" and temperatures:
            columns = columns_named(table, text, quantity)
            if len(columns) != len(temperatures):
                raise UserMistake(
                    f"--map temperature={text}: these are {len(columns)} columns and the model has "
                    f"{len(temperatures)} temperatures: {', '.join(temperatures)}."
                )
            found |= dict(zip(temperatures, columns, strict=True))
        else:
            found[RATE_INPUT.name if quantity in _RATES else quantity] = one_column(table, text, quantity)
    return found


def _usual(compensation: Compensation, name: str) -> list[str]:
    """Names that a column for an input may have without being mapped."""
    units = {column.name: column.unit for column in compensation.inputs} | {RATE_INPUT.name: RATE_INPUT.unit}
    suffix = _SUFFIXES.get(units[name])
    stems = [RATE_INPUT.name, "rate"] if name == RATE_INPUT.name else [name]
    return [text for stem in stems for text in ([stem, f"{stem}_{suffix}"] if suffix else [stem])]


def _fitted_to(compensation: Compensation, table: Table) -> dict[str, str]:
    """Columns of the file that have the names of those that the model was fitted to (`fogbench fit DATA`)."""
    data = compensation.document["meta"].get("data")
    known = data.get("map") if isinstance(data, dict) else None
    if not isinstance(known, dict):
        return {}
    temperatures = [column.name for column in compensation.inputs if column.name.startswith("temperature")]
    text = str(known.get("temperature", ""))
    columns = [text] if len(temperatures) == 1 else text.split("+")
    found = dict(zip(temperatures, columns, strict=False)) | {RATE_INPUT.name: str(known.get("rate", ""))}
    return {name: column for name, column in found.items() if column in table.header}


def _by_rows(compensation: Compensation, chunks: Iterator[Chunk], columns: Mapping[str, str]) -> Iterator[Row]:
    """Rows of a model that looks at each by itself, as `compensated` gives them."""
    for chunk in chunks:
        given = {name: chunk.numbers(column) for name, column in columns.items()}
        missing = np.asarray(np.isnan(np.vstack(list(given.values()))).any(axis=0))
        rate = None if compensation.output == RATE else given.pop(RATE_INPUT.name)
        values, outside = compensation.compensate(rate_dps=rate, **given)
        values = np.where(missing, np.nan, values)
        yield from zip(chunk.cells, values.tolist(), outside.tolist(), missing.tolist(), strict=True)


def _check_out(path: Path, out: Path) -> None:
    if out.exists() and path.exists() and out.samefile(path):
        raise UserMistake(f"-o {out} is the input itself, which is never overwritten. Give another file.")
    if is_parquet(out):
        raise UserMistake(f"-o {out}: the result is written as CSV; give a name that ends in .csv")
    if not out.absolute().parent.is_dir():
        raise UserMistake(f"-o {out}: there is no folder {out.parent}. Make it, or give another.")
