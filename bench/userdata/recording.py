"""A user's recording as arrays for a fit, with everything that could be wrong with it said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import UserMistake
from bench.userdata.columns import columns_named, one_column, parse_map, unmapped
from bench.userdata.tables import Table, open_table, sha256_of
from fitting.modelfiles.columns import BIAS_ERROR_DPS, RATE, RATE_INPUT, TEMPERATURE, Column

QUANTITIES = ("temperature", "rate", "truth", "group", "time")
# How much the steps of a time column may differ, as a share of their median, to count as even.
_EVEN = 0.01
LEAST_ROWS = 8


@dataclass(frozen=True)
class Recording:
    """What a model is fitted to; rows without a value somewhere are left out already.

    inputs: (n, k), temperatures first, then the rate if the output is a rate. target: (n,), the true rate, or the error
    of a gyro at rest. before: (n,), the error without compensation, deg/s. groups: (n,) labels, None if none were
    mapped. period_s: between rows of a gyro at rest whose time was mapped, else None. rows: in the file; missing: of
    them, how many have no value, by column.
    """

    path: Path
    columns: tuple[Column, ...]
    output: Column
    inputs: NDArray[np.float64]
    target: NDArray[np.float64]
    before: NDArray[np.float64]
    groups: NDArray[np.intp] | None
    period_s: float | None
    rows: int
    missing: Mapping[str, int]
    mapped: Mapping[str, str]
    sha256: str

    @property
    def temperatures(self) -> int:
        """How many of the inputs are temperatures; they come first."""
        return len(self.columns) - (self.output == RATE)

    def meta(self) -> dict[str, Any]:
        """Where the rows came from, for the model file."""
        return {"file": self.path.name, "sha256": self.sha256, "map": dict(self.mapped)}


@dataclass(frozen=True)
class _Chosen:
    """Columns of the file by quantity; truth_dps: the number given instead of a column."""

    temperature: list[str]
    rate: str
    truth: str | None
    truth_dps: float
    group: str | None
    time: str | None

    @property
    def numeric(self) -> list[str]:
        more = (self.time if self.truth is None else None, self.truth)
        return [*self.temperature, self.rate, *(name for name in more if name is not None)]

    def mapped(self) -> dict[str, str]:
        truth = self.truth if self.truth is not None else f"{self.truth_dps:g}"
        found = {
            "temperature": "+".join(self.temperature),
            "rate": self.rate,
            "truth": truth,
            "group": self.group,
            "time": self.time,
        }
        return {key: text for key, text in found.items() if text}


def read_recording(path: Path, options: tuple[str, ...]) -> Recording:
    """Read a file with the columns of --map options. Raises UserMistake, or InvalidFiles with every bad cell."""
    table = open_table(path)
    chosen = _choose(table, parse_map(options, QUANTITIES))
    values, groups = _read(table, chosen)
    usable = np.asarray(np.isfinite(values).all(axis=1))
    missing = {name: int(np.isnan(column).sum()) for name, column in zip(chosen.numeric, values.T, strict=True)}
    n_temperatures = len(chosen.temperature)
    rows = values[usable]
    rate = rows[:, n_temperatures]
    truth = rows[:, -1] if chosen.truth is not None else np.full(len(rows), chosen.truth_dps)
    is_rate = chosen.truth is not None
    recording = Recording(
        path,
        _columns(n_temperatures, is_rate),
        RATE if is_rate else BIAS_ERROR_DPS,
        rows[:, : n_temperatures + is_rate],
        truth if is_rate else rate - truth,
        rate - truth,
        _numbered(groups, usable),
        _period_s(path, chosen, values, usable),
        len(values),
        {name: count for name, count in missing.items() if count},
        chosen.mapped(),
        sha256_of(path),
    )
    _check(recording, chosen, rate)
    return recording


def _choose(table: Table, mapped: Mapping[str, str]) -> _Chosen:
    temperature, rate, truth, group = (unmapped(table, quantity, mapped) for quantity in QUANTITIES[:-1])
    time = mapped.get("time")
    if rate is None or truth is None:
        what, hint = ("rate", "rate=COL") if rate is None else ("truth", "truth=COL (or truth=0 for a gyro at rest)")
        raise UserMistake(
            f"{table.path}: which column is the {what}? Say it with --map {hint}. Columns: {', '.join(table.header)}."
        )
    number = None if truth in table.header else _number(truth)
    chosen = _Chosen(
        [] if temperature is None else columns_named(table, temperature, "temperature"),
        one_column(table, rate, "rate"),
        None if number is not None else one_column(table, truth, "truth"),
        number or 0.0,
        None if group is None else one_column(table, group, "group"),
        None if time is None else one_column(table, time, "time"),
    )
    twice = [name for name in chosen.numeric if chosen.numeric.count(name) > 1]
    if twice:
        raise UserMistake(f"--map: the column '{twice[0]}' is mapped twice; each quantity needs a column of its own.")
    return chosen


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None


def _read(table: Table, chosen: _Chosen) -> tuple[NDArray[np.float64], list[str] | None]:
    """The numeric columns of all rows, (n, columns), and the labels of groups."""
    blocks, groups = [np.empty((0, len(chosen.numeric)))], list[str]()
    for chunk in table.chunks():
        blocks.append(np.column_stack([chunk.numbers(name) for name in chosen.numeric]))
        groups += chunk.texts(chosen.group) if chosen.group is not None else []
    return np.vstack(blocks), groups if chosen.group is not None else None


def _numbered(groups: list[str] | None, usable: NDArray[np.bool_]) -> NDArray[np.intp] | None:
    if groups is None:
        return None
    return np.asarray(np.unique(np.array(groups)[usable], return_inverse=True)[1], dtype=np.intp)


def _period_s(path: Path, chosen: _Chosen, values: NDArray[np.float64], usable: NDArray[np.bool_]) -> float | None:
    """Seconds between rows. Raises UserMistake if a time is given and they are not even, or rows are missing."""
    if chosen.time is None or chosen.truth is not None or not chosen.temperature or len(values) < LEAST_ROWS:
        return None
    if not usable.all():
        raise UserMistake(
            f"{path}: {int((~usable).sum())} rows have a value missing, so that the history of the temperature is not "
            "known. Fill them in, or leave time out of --map."
        )
    steps = np.diff(values[:, len(chosen.temperature) + 1])
    period = float(np.median(steps))
    uneven = np.flatnonzero(~(np.abs(steps - period) <= _EVEN * period))
    if not period > 0.0 or uneven.size:
        found = f"between rows {uneven[0] + 1} and {uneven[0] + 2} {steps[uneven[0]]:g} s pass" if uneven.size else ""
        raise UserMistake(
            f"{path}: the time '{chosen.time}' must rise evenly, in seconds; its steps are {period:g} s, {found}. "
            "Resample the record, or leave time out of --map."
        )
    return period


def _columns(n_temperatures: int, is_rate: bool) -> tuple[Column, ...]:
    several = [Column(f"temperature_{k}", "degC") for k in range(1, n_temperatures + 1)]
    temperatures = [TEMPERATURE] if n_temperatures == 1 else several
    return (*temperatures, *([RATE_INPUT] if is_rate else []))


def _check(recording: Recording, chosen: _Chosen, rate: NDArray[np.float64]) -> None:
    """Raise UserMistake for data that no model can be fitted to."""
    path, usable = recording.path, len(recording.target)
    if usable < LEAST_ROWS:
        lost = ", ".join(f"{count} without a value in '{name}'" for name, count in recording.missing.items())
        raise UserMistake(
            f"{path}: {usable} usable rows of {recording.rows}{f' ({lost})' if lost else ''}; a fit and its check take "
            f"at least {LEAST_ROWS}."
        )
    if chosen.truth is not None and np.ptp(recording.target) == 0.0:
        raise UserMistake(
            f"{path}: the truth '{chosen.truth}' is {recording.target[0]:g} deg/s in every row, so that nothing can be "
            f"learned about the rate. For a gyro at rest say --map truth={recording.target[0]:g}"
        )
    if np.ptp(rate) == 0.0:
        raise UserMistake(f"{path}: the rate '{chosen.rate}' is {rate[0]:g} in every row; is it the right column?")
    if chosen.truth is None and not chosen.temperature:
        mean, spread = float(recording.before.mean()), float(recording.before.std())
        raise UserMistake(
            f"{path}: without a temperature only the mean error can be known: {mean:.6g} deg/s (std {spread:.3g} "
            f"deg/s, {usable} rows). Map a temperature: --map temperature=COL"
        )
