"""Cycle models applied to what was not averaged: every frame of a record the model has not seen.

The models learn from averages; a gyro's user applies them to the stream. The prediction is made for every row of the
record, from the temperatures up to that row, and taken off every frame of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.rawstore import meaning_of, read_parquet
from bench.reduction import intervals_of
from bench.series import Columns, part_name, read_parts

Floats = NDArray[np.float64]


def unsmoothed(
    folder: Path,
    about: Mapping[str, Any],
    names: list[str],
    truth_dps: float,
    models: Mapping[str, tuple[Any, Any]],
) -> dict[str, dict[str, float | int]]:
    """Spread of the error of every frame of a record, as measured and after each model.

    names: columns of the temperatures. models: name -> (cycle model, fitted estimator). Returns model -> {std_dps, n,
    rate_hz}; 'none' is the output as it was. Without frames kept, of the rows of the record.
    """
    series = read_parts(folder, about)
    temperatures = np.stack([_filled(np.asarray(series[name], dtype=np.float64)) for name in names], axis=1)
    predicted = {"none": np.zeros(len(temperatures))}
    for name, (model, fitted) in models.items():
        predicted[name] = np.asarray(fitted.predict(model.features(temperatures, about["every_s"])))
    sums = {name: np.zeros(3) for name in predicted}
    rate_hz = 0.0
    for row, error, data_rate_hz in _blocks(folder, about, series, truth_dps):
        rate_hz = data_rate_hz
        for name, values in predicted.items():
            left = error - values[row]
            sums[name] += (len(left), float(left.sum()), float(left @ left))
    return {
        name: {"std_dps": float(np.sqrt(max(0.0, square / n - (total / n) ** 2))), "n": int(n), "rate_hz": rate_hz}
        for name, (n, total, square) in sums.items()
        if n
    }


def _blocks(
    folder: Path, about: Mapping[str, Any], series: Columns, truth_dps: float
) -> Iterator[tuple[NDArray[np.int64], Floats, float]]:
    """Row number, error and rate of the frames, part by part; of the rows themselves if no frames were kept."""
    for part in range(1, about["parts"] + 1):
        path = folder / "raw" / part_name(about["record"], about["dut"], part, "frames")
        if not path.is_file():
            rate = np.asarray(series["rate_dps"], dtype=np.float64)
            known = np.isfinite(rate)
            yield np.flatnonzero(known), rate[known] - truth_dps, 1.0 / about["every_s"]
            return
        raw = read_parquet(path)
        columns = dict(raw.columns)
        index = columns.pop("index")
        frames = meaning_of(raw.metadata).batch(columns, index)
        data_rate_hz = float(raw.metadata["data_rate_hz"])
        offset = index - raw.metadata["first_index"]
        row = intervals_of(offset, about["every_s"] * data_rate_hz)
        use = frames.good & (row < about["rows"])
        yield row[use], frames.rate_dps[use] - truth_dps, data_rate_hz


def _filled(values: Floats) -> Floats:
    """A gap holds the value before it: a thermometer does not jump."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), np.argmax(known)))
    return np.asarray(values[last])
