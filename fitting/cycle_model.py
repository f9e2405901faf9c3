"""Temperatures of thermal cycles in, bias out: `ThermalHistory` and a regressor on its features, as one estimator."""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.lag_bank import LagBankCompensation
from fitting.lag_bank_history import (
    AVERAGING_S,
    TIME_CONSTANTS_S,
    History,
    HistoryStream,
    RecordHistory,
)
from fitting.training import TrainingRecord

Array = NDArray[np.float64]


class FeatureModel(Protocol):
    """What turns features (n, k) into bias (n,)."""

    def predict(self, inputs: Array) -> Array:
        """Bias for features."""


@dataclass(frozen=True)
class ThermalCycleModel:
    """history: of the training rows and their period; inner: the model of the features."""

    history: RecordHistory
    inner: FeatureModel

    def predict(self, inputs: Array) -> Array:
        """Bias for rows (n, columns) of whole records in the order of time, at the training period: (n,)."""
        if not len(inputs):
            return np.empty(0)
        return np.asarray(self.inner.predict(self.history.features(inputs)))

    def stream(self, period_s: float) -> "CycleStream":
        """For a new record at any period, row by row or in pieces."""
        return CycleStream(HistoryStream(self.history.history, period_s), self.inner)


class CycleStream:
    """The model on line: temperatures in as they come, bias out; the same numbers, whatever the pieces."""

    def __init__(self, history: HistoryStream, inner: FeatureModel) -> None:
        self._history, self._inner = history, inner

    def feed(self, temperatures_degc: Array) -> Array:
        """Take in rows (n, k); bias of the rows that can be answered now, in order (`HistoryStream.feed`)."""
        return self._predict(self._history.feed(temperatures_degc))

    def finish(self) -> Array:
        """Bias of the rows still waiting at the end of a record shorter than the first slope takes."""
        return self._predict(self._history.finish())

    def _predict(self, features: Array) -> Array:
        return np.asarray(self._inner.predict(features)) if len(features) else np.empty(0)


class ThermalCycleCompensation(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Bias from the temperatures of whole records, rows in the order of time.

    X (n, k) holds temperatures in degC (and a record number, if `record_column` says so), sampled every period_s; y,
    shape (n,), is the bias. A row's prediction depends on the rows of its record before it.

    Parameters: regressor on the features, None for `LagBankCompensation`; the others as in `ThermalHistory`.
    Attributes: regressor_, model_, training_ (of X and y as given).
    """

    def __init__(
        self,
        regressor: Any = None,
        period_s: float = AVERAGING_S,
        time_constants_s: tuple[float, ...] = TIME_CONSTANTS_S,
        slope_over_s: float = AVERAGING_S,
        start: Literal["steady", "ramp"] = "ramp",
        record_column: int | None = None,
    ) -> None:
        self.regressor = regressor
        self.period_s = period_s
        self.time_constants_s = time_constants_s
        self.slope_over_s = slope_over_s
        self.start = start
        self.record_column = record_column

    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "ThermalCycleCompensation":
        """Fit to X (n >= 2, k) and y (n,); groups (n,) go to the regressor, which must then know them.

        ValueError for a bad parameter or for values that are not finite.
        """
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        target = np.asarray(target, dtype=np.float64)
        history = History(tuple(self.time_constants_s), self.slope_over_s, self.start)
        records = RecordHistory.of(history, self.period_s, inputs.shape[1], self.record_column)
        features = records.features(inputs)
        chosen: Any = LagBankCompensation() if self.regressor is None else clone(self.regressor)
        self.regressor_ = (
            chosen.fit(features, target) if groups is None else chosen.fit(features, target, groups=groups)
        )
        inner: FeatureModel = getattr(self.regressor_, "model_", self.regressor_)
        self.model_ = ThermalCycleModel(records, inner)
        self.training_ = TrainingRecord.of(inputs, target, self.model_.predict(inputs))
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Bias for whole records X (n, k), shape (n,). ValueError for values that are not finite."""
        check_is_fitted(self, "model_")
        return self.model_.predict(validate_data(self, X, dtype=np.float64, reset=False))

    def inside(self, X: ArrayLike) -> NDArray[np.bool_]:
        """Which rows of whole records X are within what the regressor was trained on, (n,); True if it cannot tell."""
        check_is_fitted(self, "model_")
        features = self.model_.history.features(validate_data(self, X, dtype=np.float64, reset=False))
        if not hasattr(self.regressor_, "inside"):
            return np.ones(len(features), dtype=bool)
        return np.asarray(self.regressor_.inside(features))

    def stream(self, period_s: float | None = None) -> CycleStream:
        """The fitted model on line, for a new record at period_s (None: that of the training rows)."""
        check_is_fitted(self, "model_")
        return self.model_.stream(self.period_s if period_s is None else period_s)


def lag_bank() -> ThermalCycleCompensation:
    """Chebyshev in temperature plus a lag bank, for rows of 100 s."""
    return ThermalCycleCompensation()
