"""What a compensation model is worth: the paper's random split, and whole temperature dwells left out.

Real campaigns have errors common to a dwell; a model can learn them from a random split and look far better than it
is (fitting notes, section 5). So both are reported, with the noise floor beside them.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from inspect import signature
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from fitting.reach import Reach
from fitting.splits import SplitNotPossible, SplitPlan

UNCOMPENSATED = "none"
RANDOM_TRAIN, RANDOM, LEFT_OUT = "random_train", "random", "leave_temperatures_out"

Metrics = dict[str, dict[str, dict[str, float | int | None]]]


class Estimator(Protocol):
    """The part of scikit-learn's regressors that is used here."""

    def fit(self, X: NDArray[np.float64], y: NDArray[np.float64]) -> Any:
        """Learn from X (n, k) and y (n,)."""

    def predict(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compensated rate, shape (n,)."""


class ValidationError(ValueError):
    """Data that cannot be judged, or a model that could not be fitted; the message says which and what to do."""


@dataclass(frozen=True)
class Evaluation:
    """Results of `evaluate`.

    metrics: model -> split -> {max_abs_dps, std_dps, floor_dps, n, guarded, fit_s}; splits random_train, random (the
        rows held back) and leave_temperatures_out; a split that was not possible is missing. The error is compensated
        minus reference; std_dps has divisor n; floor_dps is the rms of u over the rows judged; guarded is the share of
        the rows judged that lie outside the range the fit was made on (`fitting.reach`), where the compensation would
        fall back: their errors are counted as the model gives them; fit_s is the time of one fit (mean over the folds),
        None without a timer. Both are None for 'none', the uncompensated output.
    unavailable: split -> why it was not possible.
    residuals: one row per row judged: row, model, split, predicted_dps, residual_dps.
    fitted: model -> the model fitted on all rows; fit_s: model -> the time of that fit.
    """

    metrics: Metrics
    residuals: pd.DataFrame
    fitted: dict[str, Estimator]
    fit_s: dict[str, float | None]
    unavailable: dict[str, str]


@dataclass(frozen=True)
class _Data:
    inputs: NDArray[np.float64]
    reference: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    groups: NDArray[np.int64]


@dataclass(frozen=True)
class _Part:
    """One fit and what it is judged on: split name -> rows."""

    training: NDArray[np.bool_]
    judged: Mapping[str, NDArray[np.bool_]]


@dataclass
class _Judged:
    """What one model did on one split, gathered over folds."""

    rows: list[NDArray[np.intp]] = field(default_factory=list)
    predicted: list[NDArray[np.float64]] = field(default_factory=list)
    guarded: list[NDArray[np.bool_]] = field(default_factory=list)
    fit_s: list[float] = field(default_factory=list)


def evaluate(
    model_factories: Mapping[str, Callable[[], Estimator]],
    X: ArrayLike,
    y: ArrayLike,
    u: ArrayLike,
    groups: ArrayLike,
    splits: SplitPlan,
    seed: int = 0,
    timer: Callable[[], float] | None = None,
) -> Evaluation:
    """Judge models on both splits, and fit them on all rows.

    X: (n, 2), temperature_degc and the rate the gyro gave, in deg/s (any number of inputs before that last column is
    allowed). y: (n,), the true rate, deg/s. u: (n,), standard uncertainty of each output, deg/s. groups: (n,), the
    dwell of each row (rows measured at the same temperature at different times may share one); estimators whose fit
    takes groups get those of their rows. seed: becomes the
    random_state of estimators that have one. timer: seconds, to measure fits with.
    `ValidationError` for values that are not finite, lengths that differ, or a model that fails.
    """
    if UNCOMPENSATED in model_factories:
        raise ValidationError(
            f"a model is called {UNCOMPENSATED!r}, which stands for the uncompensated output; rename it."
        )
    data = _checked(X, y, u, groups)
    parts, unavailable = _parts(data, splits)
    rates = data.inputs[:, -1]
    outside = [Reach.of(data.inputs[part.training]).bring_inside(data.inputs)[1] for part in parts]
    judged = {UNCOMPENSATED: _gather((part, rates, None, None) for part in parts)}
    fitted: dict[str, Estimator] = {}
    fit_s: dict[str, float | None] = {}
    everything = np.ones(len(rates), dtype=bool)
    for name, factory in model_factories.items():
        fit = _Fitter(name, factory, data, seed, timer)
        predictions = ((part, *fit.predict(part.training), far) for part, far in zip(parts, outside, strict=True))
        judged[name] = _gather(predictions)
        fitted[name], fit_s[name] = fit(everything)
    metrics = {name: {split: _metrics(data, one) for split, one in by.items()} for name, by in judged.items()}
    return Evaluation(metrics, _table(data, judged), fitted, fit_s, unavailable)


def _checked(X: ArrayLike, y: ArrayLike, u: ArrayLike, groups: ArrayLike) -> _Data:
    inputs = np.asarray(X, dtype=np.float64)
    if inputs.ndim != 2 or inputs.shape[1] < 1 or len(inputs) < 2:
        raise ValidationError(
            f"{len(inputs)} usable points (shape {inputs.shape}); it takes at least 2 rows of [temperature, rate]."
        )
    columns = {"y": np.asarray(y, dtype=np.float64), "u": np.asarray(u, dtype=np.float64), "groups": np.asarray(groups)}
    for name, column in columns.items():
        if column.shape != (len(inputs),):
            raise ValidationError(
                f"{name} has shape {column.shape}; expected one value per row of X, ({len(inputs)},)."
            )
    for name, values in {"X": inputs, "y": columns["y"][:, np.newaxis], "u": columns["u"][:, np.newaxis]}.items():
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            shown = ", ".join(map(str, bad[:5])) + (", ..." if bad.size > 5 else "")
            raise ValidationError(
                f"{name} is not finite in {bad.size} row(s): {shown}. Drop or repeat these points first."
            )
    if (columns["u"] < 0).any():
        raise ValidationError("u is negative in some rows; a standard uncertainty is zero or more.")
    numbers = np.unique(columns["groups"], return_inverse=True)[1].astype(np.int64)
    return _Data(inputs, columns["y"], columns["u"], numbers)


def _parts(data: _Data, splits: SplitPlan) -> tuple[list[_Part], dict[str, str]]:
    """All fits to make, and the splits that are not possible with the reason."""
    parts: list[_Part] = []
    unavailable: dict[str, str] = {}
    try:
        training = splits.random_training_rows(len(data.reference))
        parts.append(_Part(training, {RANDOM_TRAIN: training, RANDOM: ~training}))
    except SplitNotPossible as error:
        unavailable |= {RANDOM_TRAIN: str(error), RANDOM: str(error)}
    try:
        folds = splits.fold_of_rows(data.groups, data.inputs[:, 0])
        parts += [_Part(folds != fold, {LEFT_OUT: folds == fold}) for fold in range(splits.folds)]
    except SplitNotPossible as error:
        unavailable[LEFT_OUT] = str(error)
    return parts, unavailable


class _Fitter:
    """Fits one model on any rows."""

    def __init__(
        self,
        name: str,
        factory: Callable[[], Estimator],
        data: _Data,
        seed: int,
        timer: Callable[[], float] | None,
    ) -> None:
        self.name, self.factory, self.data, self.seed, self.timer = name, factory, data, seed, timer

    def _fresh(self) -> Estimator:
        estimator: Any = self.factory()
        if "random_state" in getattr(estimator, "get_params", dict)():
            estimator.set_params(random_state=self.seed)
        fresh: Estimator = estimator
        return fresh

    def __call__(self, rows: NDArray[np.bool_]) -> tuple[Estimator, float | None]:
        """The model fitted on the rows, and the seconds it took."""
        estimator: Any = self._fresh()
        groups = self.data.groups[rows]
        takes_groups = "groups" in signature(estimator.fit).parameters and len(np.unique(groups)) > 1
        more = {"groups": groups} if takes_groups else {}
        started = self.timer() if self.timer else None
        try:
            estimator.fit(self.data.inputs[rows], self.data.reference[rows], **more)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise ValidationError(f"model {self.name!r} could not be fitted to {rows.sum()} rows: {error}") from error
        return estimator, None if started is None or self.timer is None else self.timer() - started

    def predict(self, training: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float | None]:
        """Fit on the training rows and predict every row."""
        estimator, seconds = self(training)
        predicted = np.asarray(estimator.predict(self.data.inputs), dtype=np.float64)
        if predicted.shape != self.data.reference.shape or not np.isfinite(predicted).all():
            raise ValidationError(
                f"model {self.name!r} did not give one finite prediction per row; its predict() must return shape (n,)."
            )
        return predicted, seconds


def _gather(
    results: Iterable[tuple[_Part, NDArray[np.float64], float | None, NDArray[np.bool_] | None]],
) -> dict[str, _Judged]:
    """Predictions of all rows by each fit, its time, rows outside its range -> those of the rows judged, by split."""
    judged: dict[str, _Judged] = {}
    for part, predicted, seconds, outside in results:
        for split, rows in part.judged.items():
            one = judged.setdefault(split, _Judged())
            one.rows.append(np.flatnonzero(rows))
            one.predicted.append(predicted[rows])
            one.guarded += [] if outside is None else [outside[rows]]
            one.fit_s += [] if seconds is None else [seconds]
    return judged


def _metrics(data: _Data, judged: _Judged) -> dict[str, float | int | None]:
    rows = np.concatenate(judged.rows)
    error = np.concatenate(judged.predicted) - data.reference[rows]
    return {
        "max_abs_dps": float(np.abs(error).max()),
        "std_dps": float(error.std()),
        "floor_dps": float(np.sqrt(np.mean(data.uncertainty[rows] ** 2))),
        "n": len(rows),
        "guarded": float(np.concatenate(judged.guarded).mean()) if judged.guarded else None,
        "fit_s": float(np.mean(judged.fit_s)) if judged.fit_s else None,
    }


def _table(data: _Data, judged: Mapping[str, Mapping[str, _Judged]]) -> pd.DataFrame:
    columns = ["row", "model", "split", "predicted_dps", "residual_dps"]
    blocks = []
    for model, by in judged.items():
        for split, one in by.items():
            rows, predicted = np.concatenate(one.rows), np.concatenate(one.predicted)
            residual = predicted - data.reference[rows]
            blocks.append(pd.DataFrame(dict(zip(columns, (rows, model, split, predicted, residual), strict=True))))
    table = pd.concat(blocks, ignore_index=True) if blocks else pd.DataFrame(columns=columns)
    return table.sort_values(["model", "split", "row"], kind="stable", ignore_index=True)
