"""What a gyro's thermometer says about its past: temperature, its slope, and what a bank of low-passes lags behind.

A coil's bias depends on the state of a thermal chain, not on the temperature alone (fitting notes, section 6). The
state of any chain of first-order lags is, to good accuracy, a sum of a few fixed ones: T minus its low-pass at
several time constants. Everything here is causal, so it can run on line.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

Array = NDArray[np.float64]

# Reference experiments `bp` and `rlg`: rows are means over 100 s. Fitting notes, section 6: lags of 2, 5, 10, 20 rows.
AVERAGING_S = 100.0
TIME_CONSTANTS_S = (200.0, 500.0, 1000.0, 2000.0)
_SLOPE_UNIT_S = 60.0  # degC/min, as chambers are set


@dataclass(frozen=True)
class History:
    """How features are computed from a uniformly sampled record; the time constants need not be those of the gyro.

    slope_over_s: the slope is the difference over this time back. start: what came before the first sample: 'steady',
    a constant temperature, or 'ramp', the slope of the first slope_over_s, held for ever (it is zero if the record
    begins in a dwell, and right if it begins at the end of a long ramp, as in `bp`).
    """

    time_constants_s: tuple[float, ...] = TIME_CONSTANTS_S
    slope_over_s: float = AVERAGING_S
    start: Literal["steady", "ramp"] = "ramp"

    def __post_init__(self) -> None:
        times = (*self.time_constants_s, self.slope_over_s)
        if not all(0.0 < time < np.inf for time in times):
            raise ValueError(
                f"thermal history: time_constants_s is {self.time_constants_s!r} and slope_over_s "
                f"{self.slope_over_s!r}; allowed: finite times above 0 s."
            )
        if self.start not in ("steady", "ramp"):
            raise ValueError(f"thermal history: start is {self.start!r}; allowed: 'steady', 'ramp'.")

    def names(self, sensors: int) -> list[str]:
        """Names of the features of so many temperatures, with units."""
        differences = [f"temperature_{j}_minus_{j - 1}_degc" for j in range(1, sensors)]
        lags = [f"lag_{time:g}s_degc" for time in self.time_constants_s]
        return ["temperature_degc", *differences, "slope_degc_min", *lags]

    def features(self, temperatures_degc: Array, period_s: float) -> Array:
        """Features of one whole record (n, k), sampled every period_s: shape (n, k + 1 + time constants).

        Columns as in `names`: the mean of the k temperatures; the differences between neighbours; the slope of the
        mean; the mean minus its low-passes. ValueError for a period that is not above zero.
        """
        stream = HistoryStream(self, period_s)
        return np.vstack([stream.feed(temperatures_degc), stream.finish()])


class HistoryStream:
    """The same features of a record that comes in pieces: the same numbers, whatever the pieces.

    With start='ramp' the rows of the first slope_over_s are answered together, once it is over (or by `finish`).
    """

    def __init__(self, history: History, period_s: float) -> None:
        if not 0.0 < period_s < np.inf:
            raise ValueError(f"thermal history: period_s is {period_s!r}; allowed: a finite time above 0 s.")
        self._history, self._period_s = history, period_s
        self._window = max(1, round(history.slope_over_s / period_s))
        self._filters = [_low_pass(time, period_s) for time in history.time_constants_s]
        self._waiting: list[Array] = []
        self._past: Array | None = None  # the mean temperature over the last window, oldest first
        self._states: list[Array] = []

    def feed(self, temperatures_degc: Array) -> Array:
        """Take in rows (n, k) and give the features that are known now, (m, k + 1 + time constants)."""
        if self._past is None:
            self._waiting.append(temperatures_degc)
            enough = self._window + 1 if self._history.start == "ramp" else 1
            if sum(map(len, self._waiting)) < enough:
                return self._continue(temperatures_degc[:0])
            return self._begin()
        return self._continue(temperatures_degc)

    def finish(self) -> Array:
        """The features of rows still waiting, at the end of a record shorter than the first slope takes."""
        if self._past is None and any(map(len, self._waiting)):
            return self._begin()
        width = self._waiting[0].shape[1] if self._waiting else 1
        return np.empty((0, width + 1 + len(self._filters)))

    def _begin(self) -> Array:
        rows, self._waiting = np.vstack(self._waiting), self._waiting[:1]
        mean = _mean(rows)
        step = _first_step(mean[: self._window + 1]) if self._history.start == "ramp" else 0.0
        self._past = mean[0] - step * np.arange(self._window, 0, -1)
        for numerator, denominator, ratio in self._filters:
            steady_ramp = mean[0] - step * ratio  # a low-pass lags a ramp by slope x time constant
            before = mean[0] - step
            self._states.append(numerator[1] * before - denominator[1] * (steady_ramp - step))
        return self._continue(rows)

    def _continue(self, rows: Array) -> Array:
        mean = _mean(rows)
        if self._past is None or not len(rows):
            return np.empty((0, rows.shape[1] + 1 + len(self._filters)))
        padded = np.concatenate([self._past, mean])
        slope = (mean - padded[: len(mean)]) * (_SLOPE_UNIT_S / (self._window * self._period_s))
        self._past = padded[len(mean) :]
        lags = np.empty((len(mean), len(self._filters)))
        for j, (numerator, denominator, _) in enumerate(self._filters):
            slow, state = lfilter(numerator, denominator, mean, zi=np.reshape(self._states[j], 1))
            self._states[j] = state
            lags[:, j] = mean - slow
        return np.column_stack([mean, np.diff(rows, axis=1), slope, lags])


def _mean(rows: Array) -> Array:
    """Mean over the sensors, the same for a row wherever it stands."""
    total = np.zeros(len(rows))
    for column in rows.T:
        total += column
    return np.asarray(total / rows.shape[1])


def _first_step(values: Array) -> float:
    """Least-squares slope of values (m,) per sample; 0 for a single one."""
    steps = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return float(steps @ (values - values[0]) / (float(steps @ steps) or 1.0))


def _low_pass(time_constant_s: float, period_s: float) -> tuple[Array, Array, float]:
    """Numerator and denominator of a first-order lag, exact for straight lines between samples, and tau / period.

    simulation_models.md, section 2: y+ = Phi y + G1 u0 + G2 (u1 - u0) with Phi = exp(-dt/tau).
    """
    ratio = time_constant_s / period_s
    taken = -np.expm1(-1.0 / ratio)
    new = 1.0 - taken * ratio
    return np.array([new, taken - new]), np.array([1.0, taken - 1.0]), ratio


@dataclass(frozen=True)
class RecordHistory:
    """`History` for rows of one or more records: columns (k,) of the temperatures, and of the record number, if any."""

    history: History
    period_s: float
    columns: NDArray[np.intp]
    record_column: int | None = None

    @classmethod
    def of(cls, history: History, period_s: float, n_columns: int, record_column: int | None) -> "RecordHistory":
        """For rows of n_columns; ValueError for a period or a record column that cannot be."""
        HistoryStream(history, period_s)
        columns = np.arange(n_columns)
        if record_column is None:
            return cls(history, period_s, columns)
        if not isinstance(record_column, int | np.integer) or not 0 <= record_column < n_columns or n_columns < 2:
            raise ValueError(
                f"thermal history: record_column is {record_column!r}; X has {n_columns} columns, numbered from 0, and "
                "one of them at least must be a temperature."
            )
        return cls(history, period_s, columns[columns != record_column], int(record_column))

    def features(self, inputs: Array) -> Array:
        """Features of rows (n, columns) in the order of time; the history begins anew where the record changes."""
        edges = np.array([0, len(inputs)])
        if self.record_column is not None:
            changes = np.flatnonzero(np.diff(inputs[:, self.record_column])) + 1
            edges = np.concatenate([[0], changes, [len(inputs)]])
        temperatures = inputs[:, self.columns]
        return np.vstack(
            [self.history.features(temperatures[first:last], self.period_s) for first, last in pairwise(edges)]
        )


class ThermalHistory(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Temperatures of uniformly sampled records to causal features of their past, for `LagBankCompensation`.

    X (n, k) holds one or more temperatures in degC, rows in the order of time. A row's features depend on the rows
    before it, so that a record must be given whole, from its start; within a stream use `HistoryStream`.

    Parameters: period_s between rows; time_constants_s, slope_over_s, start as in `History`; record_column: index of
    a column of X that holds record numbers (the history begins anew where it changes), None for one record.
    """

    def __init__(
        self,
        period_s: float = AVERAGING_S,
        time_constants_s: tuple[float, ...] = TIME_CONSTANTS_S,
        slope_over_s: float = AVERAGING_S,
        start: Literal["steady", "ramp"] = "ramp",
        record_column: int | None = None,
    ) -> None:
        self.period_s = period_s
        self.time_constants_s = time_constants_s
        self.slope_over_s = slope_over_s
        self.start = start
        self.record_column = record_column

    def fit(self, X: ArrayLike, y: Any = None) -> "ThermalHistory":
        """Check the parameters and count the columns; nothing is learned. ValueError for values not finite."""
        inputs = validate_data(self, X, dtype=np.float64)
        history = History(tuple(self.time_constants_s), self.slope_over_s, self.start)
        self.history_ = RecordHistory.of(history, self.period_s, inputs.shape[1], self.record_column)
        return self

    def transform(self, X: ArrayLike) -> Array:
        """Features of the records in X, shape (n, k + 1 + time constants)."""
        check_is_fitted(self, "history_")
        return self.history_.features(validate_data(self, X, dtype=np.float64, reset=False))

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Names of the features, with units."""
        check_is_fitted(self, "history_")
        return np.asarray(self.history_.history.names(len(self.history_.columns)), dtype=object)
