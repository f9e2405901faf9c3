"""Models of whole temperature records in a file: how the history is computed, and the model of its features.

The model that is read has `stream(period_s)` beside `predict`, so that it can be applied to a new record on line.
"""

from collections.abc import Mapping
from typing import Any

from fitting.cycle_model import ThermalCycleCompensation, ThermalCycleModel
from fitting.lag_bank_history import History, RecordHistory
from fitting.modelfiles.kinds import codec_of, kind_of
from fitting.strict_json import Refused, member, number, vector

MOST_LAGS = 64
# Keeps the samples a stream must hold in bounds: a slope is taken over so many.
MOST_SLOPE_ROWS = 1_000_000
_TIMES_S = (1e-6, 1e12)


def describe(estimator: ThermalCycleCompensation) -> dict[str, Any]:
    """Times in s, and the regressor's kind and parameters. TypeError for a regressor without a file format."""
    records = estimator.model_.history
    kind = kind_of(estimator.regressor_)
    return {
        "period_s": records.period_s,
        "time_constants_s": list(records.history.time_constants_s),
        "slope_over_s": records.history.slope_over_s,
        "start": records.history.start,
        "record_column": records.record_column,
        "regressor": {"kind": kind, "parameters": codec_of(kind).describe(estimator.regressor_)},
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> ThermalCycleModel:
    """The model; `Refused` for anything that is not one of n_inputs columns."""
    lags = member(parameters, "time_constants_s", list, "parameters.")
    if len(lags) > MOST_LAGS:
        raise Refused(f"parameters.time_constants_s has {len(lags)} entries; allowed: up to {MOST_LAGS}")
    times = vector(lags, len(lags), "parameters.time_constants_s").tolist()
    period_s, slope_s = (number(parameters.get(key), f"parameters.{key}") for key in ("period_s", "slope_over_s"))
    if not all(_TIMES_S[0] <= time <= _TIMES_S[1] for time in (*times, period_s, slope_s)):
        raise Refused(f"parameters has a time outside {_TIMES_S[0]:g} to {_TIMES_S[1]:g} s")
    if slope_s > MOST_SLOPE_ROWS * period_s:
        raise Refused(f"parameters.slope_over_s is more than {MOST_SLOPE_ROWS} periods")
    start = member(parameters, "start", str, "parameters.")
    if start not in ("steady", "ramp"):
        raise Refused(f"parameters.start is {start[:40]!r}; allowed: 'steady', 'ramp'")
    history = History(tuple(times), slope_s, "steady" if start == "steady" else "ramp")
    column = parameters.get("record_column")
    if column is not None and type(column) is not int:
        raise Refused("parameters.record_column is not a whole number or null")
    try:
        records = RecordHistory.of(history, period_s, n_inputs, column)
    except ValueError as error:
        raise Refused(str(error)) from None
    return ThermalCycleModel(records, _inner(parameters, len(history.names(len(records.columns)))))


def _inner(parameters: Mapping[str, Any], n_features: int) -> Any:
    regressor = member(parameters, "regressor", dict, "parameters.")
    kind = member(regressor, "kind", str, "parameters.regressor.")
    if kind == "thermal_cycle":
        raise Refused("parameters.regressor is a model of records; allowed: a model of features")
    return codec_of(kind).build(member(regressor, "parameters", dict, "parameters.regressor."), n_features)
