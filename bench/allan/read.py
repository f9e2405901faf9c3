"""One column of rates from a file, or one record of a run, evenly sampled and in deg/h."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analyses.calibration_records import abouts_of, outliers_of
from bench.errors import UserMistake, did_you_mean
from bench.units import DIMENSIONS, parse_quantity

Floats = NDArray[np.float64]

SUFFIXES = (".csv", ".tsv", ".txt", ".parquet", ".npy")
_DELIMITERS = ",;\t"
_TIMES = ("t_s", "time_s", "t", "time", "timestamp_s")
# Steps between time stamps may differ by this share of themselves before the record counts as uneven.
_EVEN = 0.01


@dataclass(frozen=True)
class Rates:
    """Rates (n,) in deg/h every `every_s`, NaN where one is missing, and what they are of."""

    title: str
    rate_dph: Floats
    every_s: float
    outliers: int = 0


def is_recording(argument: str) -> bool:
    """Whether an argument names a file rather than a run."""
    return Path(argument).suffix.lower() in SUFFIXES or Path(argument).is_file()


def factor_of(unit: str) -> float:
    """What a rate in `unit` is multiplied by to be in deg/h. Raises UserMistake.

    >>> factor_of("deg/s"), factor_of("deg/h")
    (3600.0, 1.0)
    """
    try:
        return round(parse_quantity(f"1 {unit}", "dps") * 3600.0, 9)
    except ValueError:
        allowed = DIMENSIONS["dps"].factors
        raise UserMistake(f"--unit '{unit}' is no unit of rate.{did_you_mean(unit, allowed)}") from None


def interval_of(rate: str | None, every: str | None) -> float | None:
    """Time between samples from --rate or --every; None if neither was given. Raises UserMistake."""
    if rate is not None and every is not None:
        raise UserMistake("--rate and --every say the same; give one of them.")
    try:
        if rate is not None:
            hz = parse_quantity(rate if not _is_number(rate) else f"{rate} Hz", "hz")
            return _positive(1.0 / hz if hz > 0.0 else 0.0, "--rate")
        if every is not None:
            return _positive(parse_quantity(every if not _is_number(every) else f"{every} s", "s"), "--every")
    except ValueError as error:
        raise UserMistake(f"--{'rate' if rate else 'every'}: {error}") from None
    return None


def _positive(every_s: float, option: str) -> float:
    if every_s <= 0.0:
        raise UserMistake(f"{option} must be above 0, e.g. {'100 Hz' if option == '--rate' else '0.01 s'}")
    return every_s


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_file(path: Path, column: str | None, every_s: float | None, unit: str) -> Rates:
    """A file as rates; the interval from its time column if it is not given. Raises UserMistake."""
    if not path.is_file():
        raise UserMistake(f"{path}: there is no such file. Allowed: {', '.join(SUFFIXES)}, or a run.")
    columns = _columns(path)
    name = _chosen(path, list(columns), column)
    every_s = _interval(path, columns, name) if every_s is None else every_s
    values = columns[name] * factor_of(unit)
    if len(values) < 9:
        raise UserMistake(f"{path}: {len(values)} samples. An Allan curve takes 9 or more, a useful one thousands.")
    return Rates(f"{path.name}{', ' + name if len(columns) > 1 else ''}", values, every_s)


def _columns(path: Path) -> dict[str, Floats]:
    """All columns of numbers of a file."""
    suffix = path.suffix.lower()
    try:
        found = (
            _from_npy(path) if suffix == ".npy" else _from_parquet(path) if suffix == ".parquet" else _from_text(path)
        )
    except (OSError, UnicodeDecodeError, EOFError) as error:
        raise UserMistake(f"{path}: cannot be read as {suffix or 'text'} ({error}).") from error
    if not found:
        raise UserMistake(f"{path}: it holds no column of numbers.")
    return found


def _from_npy(path: Path) -> dict[str, Floats]:
    try:
        array = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise UserMistake(f"{path}: this is no file of numbers that numpy wrote ({error}).") from error
    if array.dtype.names:
        return {name: np.asarray(array[name], dtype=np.float64) for name in array.dtype.names}
    if array.ndim not in (1, 2) or array.dtype.kind not in "fiu":
        raise UserMistake(
            f"{path}: an array of shape {array.shape} of {array.dtype}. Allowed: numbers, one or two axes."
        )
    flat = array[:, np.newaxis] if array.ndim == 1 else array
    return {str(k + 1): np.asarray(flat[:, k], dtype=np.float64) for k in range(flat.shape[1])}


def _from_parquet(path: Path) -> dict[str, Floats]:
    import pyarrow
    import pyarrow.parquet
    import pyarrow.types

    try:
        table = pyarrow.parquet.read_table(path)
    except pyarrow.ArrowException as error:
        raise UserMistake(f"{path}: this is not a Parquet file ({error}).") from error
    numbers = [
        field.name
        for field in table.schema
        if pyarrow.types.is_floating(field.type) or pyarrow.types.is_integer(field.type)
    ]
    return {name: np.asarray(table[name].to_numpy(), dtype=np.float64) for name in numbers}


def _from_text(path: Path) -> dict[str, Floats]:
    """Text with or without a header; lines that begin with # are comments."""
    import pandas as pd

    header, delimiter, skipped = _layout(path)
    options: dict[str, Any] = {"sep": delimiter or r"\s+", "comment": "#", "skiprows": skipped, "header": None}
    options |= {"names": header, "skip_blank_lines": True, "na_values": ["-", "none", "inf", "-inf"]}
    try:
        table = pd.read_csv(path, dtype=np.float64, **options)
    except ValueError:
        # Not all of it is numbers: a column of texts is left alone, one with a stray text is said below.
        table = pd.read_csv(path, low_memory=False, **options)
    found = {}
    for name in table:
        column = table[name]
        values = pd.to_numeric(column, errors="coerce")
        strays = column.notna() & values.isna()
        if strays.any() and strays.sum() < 0.5 * len(column):
            at = int(np.flatnonzero(strays)[0])
            raise UserMistake(
                f"{path}: row {at + 1} of column '{name}' is {str(column.iloc[at])[:40]!r}. Allowed: a number with a "
                "decimal point, or nothing where there is none."
            )
        if not strays.any():
            found[str(name)] = np.asarray(values, dtype=np.float64)
    return found


def _layout(path: Path) -> tuple[list[str], str | None, int]:
    """Names of the columns, the delimiter (None: blanks), and how many lines come before the first row."""
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file):
            text = line.strip()
            if not text or text.startswith("#"):
                continue
            delimiter = max(_DELIMITERS, key=text.count)
            cells = text.split(delimiter) if delimiter in text else text.split()
            separator = delimiter if delimiter in text else None
            if all(_is_number(cell) or not cell.strip() for cell in cells):
                return [str(k + 1) for k in range(len(cells))], separator, number
            return [cell.strip().strip('"') for cell in cells], separator, number + 1
    raise UserMistake(f"{path}: the file is empty.")


def _chosen(path: Path, names: list[str], column: str | None) -> str:
    if column is not None:
        if column not in names:
            raise UserMistake(f"{path}: there is no column '{column}' of numbers.{did_you_mean(column, names)}")
        return column
    rates = [name for name in names if name.lower() not in _TIMES]
    named = [name for name in rates if "rate" in name.lower() or "gyro" in name.lower()]
    if len(rates) == 1 or len(named) == 1:
        return (named or rates)[0]
    raise UserMistake(f"{path}: there are {len(names)} columns. Say which with --column: {', '.join(names[:12])}")


def _interval(path: Path, columns: dict[str, Floats], rate: str) -> float:
    """The interval of an evenly stamped time column."""
    name = next((name for name in columns if name.lower() in _TIMES and name != rate), None)
    if name is None:
        raise UserMistake(f"{path}: nothing says how often it was sampled. Give --rate 100 or --every '10 ms'.")
    steps = np.diff(columns[name])
    every = float(np.median(steps)) if len(steps) else 0.0
    if not every > 0.0 or not np.all(np.abs(steps - every) <= _EVEN * every):
        odd = int(np.count_nonzero(~(np.abs(steps - every) <= _EVEN * every)))
        raise UserMistake(
            f"{path}: {odd} of {len(steps)} steps of column '{name}' are not the usual {every:g} s. The Allan "
            "deviation takes an even record: put nan where samples are missing, or give --every."
        )
    return every


def read_run(folder: Path, dut: str | None, record: str | None, column: str | None) -> list[Rates]:
    """One record of one DUT or of each: the one named, or the longest. Raises UserMistake, or what reading does."""
    from bench.journal import load_journal
    from bench.series import finished_series

    entries = load_journal(folder / "journal.jsonl")
    duts, series = list(entries[0]["duts"]), finished_series(entries)
    if dut is not None and dut not in duts:
        raise UserMistake(f"there is no DUT '{dut}' in this run.{did_you_mean(dut, duts)}")
    if not series:
        raise UserMistake(
            f"{folder}: this run has no record of a time series, only points. Run procedures/static.yaml."
        )
    return [_of_record(folder, _record_of(series, name, record), column) for name in ([dut] if dut else duts)]


def _record_of(series: list[dict[str, Any]], dut: str, record: str | None) -> dict[str, Any]:
    mine = [one for one in series if one["dut"] == dut]
    if record is None:
        return max(mine, key=lambda one: float(one["rows"] * one["every_s"]))
    labels = [str(one["label"]) for one in mine]
    if record in labels:
        return mine[labels.index(record)]
    try:
        return dict(abouts_of(mine, dut, record)[0])
    except ValueError:
        raise UserMistake(f"there is no record '{record}' of {dut}.{did_you_mean(record, labels)}") from None


def _of_record(folder: Path, about: dict[str, Any], column: str | None) -> Rates:
    from bench.series import read_parts

    series = read_parts(folder, about)
    name = column or "rate_dps"
    rates = [other for other in series if other.endswith("_dps")]
    if name not in rates:
        raise UserMistake(f"record '{about['label']}' has no rate '{name}'.{did_you_mean(name, rates)}")
    values = np.asarray(series[name], dtype=np.float64) * 3600.0
    far = outliers_of(values)
    title = f"{about['dut']}, record {about['label']} of {folder.name}"
    return Rates(title, np.where(far, np.nan, values), float(about["every_s"]), int(far.sum()))
