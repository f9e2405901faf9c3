"""Models of temperature history applied to a recording that comes in pieces."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from bench.errors import UserMistake
from bench.userdata.tables import Chunk
from fitting.cycle_model import ThermalCycleModel
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import RATE, RATE_INPUT

Row = tuple[list[str], float, bool, bool]
_DPS_PER = {"deg/s": 1.0, "deg/h": 1.0 / 3600.0}


def has_history(compensation: Compensation) -> bool:
    """Whether a row's output depends on the rows before it."""
    return isinstance(compensation.model, ThermalCycleModel)


def compensated(
    compensation: Compensation, chunks: Iterable[Chunk], columns: Mapping[str, str], period_s: float | None
) -> Iterator[Row]:
    """Rows in order: cells, compensated rate, whether a temperature was outside, whether a value was missing.

    period_s: between rows of the file, None for that of the training rows. A row without a temperature counts for the
    history as one without change. Raises UserMistake for a model that cannot be applied to a file.
    """
    model = compensation.model
    assert isinstance(model, ThermalCycleModel)
    if model.history.record_column is not None or compensation.output == RATE:
        raise UserMistake("this model was fitted to numbered records; a file can be compensated with one that was not.")
    stream = model.stream(model.history.period_s if period_s is None else period_s)
    factor, last = _DPS_PER[compensation.output.unit], None
    waiting: deque[tuple[list[str], float, bool, bool]] = deque()

    def answered(errors: NDArray[np.float64]) -> Iterator[Row]:
        for error in errors.tolist():
            cells, rate, outside, missing = waiting.popleft()
            yield cells, np.nan if missing else rate - factor * error, outside, missing

    for chunk in chunks:
        rows = np.column_stack([chunk.numbers(columns[column.name]) for column in compensation.inputs])
        rates = chunk.numbers(columns[RATE_INPUT.name])
        held, outside = compensation.reach.bring_inside(rows)
        lost = np.asarray(np.isnan(rows).any(axis=1))
        known, begun = _carried_on(held, lost, last)
        for number, cells in enumerate(chunk.cells):
            row = cells, float(rates[number]), bool(outside[number]), bool(lost[number] or np.isnan(rates[number]))
            if begun[number]:
                waiting.append(row)
            else:  # before the first temperature
                yield cells, np.nan, True, True
        last = known[-1] if begun[-1] else last
        yield from answered(stream.feed(known[begun]))
    yield from answered(stream.finish())


def _carried_on(
    held: NDArray[np.float64], lost: NDArray[np.bool_], last: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Rows (n, k) with the one before in place of each lost one, and which rows (n,) have one, given the last known."""
    source = np.maximum.accumulate(np.where(lost, -1, np.arange(len(held))))
    begun = np.asarray((source >= 0) | (last is not None))
    earlier = np.zeros(held.shape[1]) if last is None else last
    return np.where(source[:, np.newaxis] >= 0, held[source], earlier), begun
