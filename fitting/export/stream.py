"""Code of models of whole temperature records, which keep a state from row to row."""

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitting.cycle_model import ThermalCycleModel
from fitting.export import guard, stream_templates
from fitting.export.form import Label, Operations, Pieces, Table
from fitting.export.forms import NotExported, form_of
from fitting.export.precision import UNITS, Precision
from fitting.export.text import real_array, whole_array
from fitting.lag_bank_history import History
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import Column

_TESTS, _STRIDE = 8, 16
# Where rounding may decide which of two answers is given, the self-test accepts both.
_ANY = 1e30
_SECONDS_PER_MINUTE = 60.0


def pieces(compensation: Compensation, precision: Precision) -> Pieces:
    """What is particular to it; compensation: as `in_precision` gives it, its model a `ThermalCycleModel`."""
    model = _checked(compensation)
    history, period_s = model.history.history, model.history.period_s
    window = max(1, round(history.slope_over_s / period_s))
    ratios = np.array([time / period_s for time in history.time_constants_s])
    columns = _features(history, len(compensation.inputs))
    form = form_of(model.inner, columns, compensation.output)
    lags = len(ratios)
    # lag+ = lag - taken lag + gain (mean+ - mean): `_low_pass` of the history, written for what it lags behind
    taken = -np.expm1(-1.0 / ratios)
    rates = [Label("taken"), Label("gain"), Label("time_constant_rows")]
    table = Table.of("lag_filter", rates, np.column_stack([taken, taken * ratios, ratios]))
    sizes = {**form.sizes, "OUTPUTS": len(columns), "LAGS": lags, "WINDOW": window}
    path = _Path(compensation, window, precision)
    tolerance = _tolerance(compensation, path, columns, ratios, precision)
    words = {
        "STATE": "@NAME@_state *state, ",
        "PASS": "state, ",
        "HOW": stream_templates.HOW,
        "PERIOD": f"{period_s:.9g}",
        "STATE_DECLARED": stream_templates.STATE,
        "SLOTS": str(window + 1),
        "LAG_SLOTS": str(max(lags, 1)),
        "NEEDED": str(window if history.start == "ramp" else 0),
        "EVALUATE": stream_templates.EVALUATE,
        "WAITS": str(int(history.start == "ramp")),
        "SLOPE_FACTOR": precision.literal(_SECONDS_PER_MINUTE / (window * period_s)),
        "SELFTEST_BODY": stream_templates.SELFTEST_BODY,
        **path.words(tolerance, precision),
    }
    k = len(compensation.inputs)
    own = Operations(adds=2 * k + 1 + 2 * lags, multiplies=1 + 2 * lags, divides=1)
    operations = form.operations + guard.operations(compensation) + own
    return Pieces(
        replace(form, sizes=sizes), words, operations, float(tolerance[tolerance < _ANY].max(initial=0.0)), (table,)
    )


def _checked(compensation: Compensation) -> ThermalCycleModel:
    model = compensation.model
    assert isinstance(model, ThermalCycleModel)
    if model.history.record_column is not None:
        raise NotExported(
            "this model has a column of record numbers among its inputs, which a gyro has not; fit it without "
            "record_column, or take the model file itself (json)."
        )
    return model


def _features(history: History, sensors: int) -> tuple[Column, ...]:
    """What the inner model looks at, with names that a column may have."""
    names = [re.sub(r"[^a-z0-9_]", "_", name) for name in history.names(sensors)]
    return tuple(Column(name[:64], "degC/min" if name.startswith("slope") else "degC") for name in names)


class _Path:
    """The record of the self-test: all temperatures up along a line, and down again; checked at some of its rows."""

    def __init__(self, compensation: Compensation, window: int, precision: Precision) -> None:
        reach = compensation.reach
        self.length = window + 1 + _TESTS * _STRIDE
        self.turn = window + _TESTS * _STRIDE // 2
        low, _ = reach.bring_inside((reach.centre - 0.8 * reach.half_range)[np.newaxis])
        high, _ = reach.bring_inside((reach.centre + 0.8 * reach.half_range)[np.newaxis])
        first = (reach.centre + 0.9 * (low[0] - reach.centre)).astype(precision.dtype).astype(np.float64)
        last = reach.centre + 0.9 * (high[0] - reach.centre)
        self.first, self.step = first, ((last - first) / self.turn).astype(precision.dtype).astype(np.float64)
        up = np.minimum(np.arange(self.length), 2 * self.turn - np.arange(self.length))
        self.rows = first + self.step * up[:, np.newaxis]
        self.checked = np.arange(window + _STRIDE, self.length, _STRIDE)
        values, outside = compensation.guarded(*self.rows.T)
        self.expected, self.outside = values[self.checked], outside[self.checked]

    def words(self, tolerance: NDArray[np.float64], precision: Precision) -> dict[str, str]:
        """The words of the self-test."""
        data = [
            real_array("test_first", self.first, precision),
            real_array("test_step", self.step, precision),
            real_array("test_expected", self.expected, precision),
            real_array("test_tolerance", tolerance, precision),
            whole_array("test_outside", self.outside),
        ]
        return {
            "TESTS": f"{len(self.checked)}, TEST_TURN = {self.turn}, TEST_STRIDE = {_STRIDE}",
            "TEST_DATA": "\n".join(data),
        }


def _tolerance(
    compensation: Compensation,
    path: _Path,
    columns: tuple[Column, ...],
    ratios: NDArray[np.float64],
    precision: Precision,
) -> NDArray[np.float64]:
    """Rounding of the inner model, and of its features times its slopes; a lag adds up roundings over its time."""
    model = compensation.model
    assert isinstance(model, ThermalCycleModel)
    form = form_of(model.inner, columns, compensation.output)
    held, _ = compensation.reach.bring_inside(path.rows)
    features = model.history.features(held)[path.checked]
    largest = float(np.abs(held).max())
    period_s = model.history.period_s
    slope = largest * _SECONDS_PER_MINUTE / max(model.history.history.slope_over_s, period_s)
    sizes = np.concatenate([np.full(held.shape[1], largest), [2.0 * slope], largest * (2.0 + ratios)])
    moved = np.zeros(len(features))
    for k, size in enumerate(sizes):
        change = np.zeros(len(sizes))
        change[k] = 1e-6 * max(size, 1e-6)
        difference = model.inner.predict(features + change) - model.inner.predict(features - change)
        moved += np.abs(difference) / (2.0 * change[k]) * size
    tolerance = UNITS * precision.unit * (form.magnitude(features) + moved)
    return np.where(np.isfinite(tolerance), tolerance, _ANY)
