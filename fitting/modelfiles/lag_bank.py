"""Lag banks in a file: terms and coefficients, the guard, and the fallback outside it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.lag_bank import LagBankCompensation
from fitting.lag_bank_model import Guard, LagBankModel, LagBankTerms
from fitting.linear import LinearModel
from fitting.modelfiles.kinds import known
from fitting.strict_json import Refused, matrix, member, number, vector

MOST_DEGREE = 100
_SMALLEST = 1e-30


def describe(estimator: LagBankCompensation) -> dict[str, Any]:
    """Terms in the units of the features, coefficients in the unit of the output."""
    model = estimator.model_
    terms, guard = model.terms, model.guard
    return {
        "middle": terms.middle,
        "half_range": terms.half_range,
        "degree": terms.degree,
        "columns": terms.columns.tolist(),
        "mean": terms.mean.tolist(),
        "std": terms.std.tolist(),
        "cross": terms.cross,
        "constant": model.constant,
        "coefficients": model.coefficients.tolist(),
        "coefficients_u": known(estimator.coefficients_u_),
        "guard": {
            "low": guard.low.tolist(),
            "high": guard.high.tolist(),
            "centre": guard.centre.tolist(),
            "whitening": guard.whitening.tolist(),
        },
        "fallback": model.fallback.coefficients.tolist(),
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> LagBankModel:
    """The model; `Refused` for anything that is not one of n_inputs features."""
    terms = _terms(parameters, n_inputs)
    if parameters.get("coefficients_u") is not None:
        vector(parameters["coefficients_u"], terms.count, "parameters.coefficients_u")
    return LagBankModel(
        terms,
        number(parameters.get("constant"), "parameters.constant"),
        vector(parameters.get("coefficients"), terms.count, "parameters.coefficients"),
        _guard(member(parameters, "guard", dict, "parameters."), n_inputs, terms.count),
        LinearModel(vector(parameters.get("fallback"), n_inputs + 1, "parameters.fallback")),
    )


def _terms(parameters: Mapping[str, Any], n_inputs: int) -> LagBankTerms:
    degree = member(parameters, "degree", int, "parameters.")
    if not 0 <= degree <= MOST_DEGREE:
        raise Refused(f"parameters.degree is {degree}; allowed: 0 to {MOST_DEGREE}")
    columns = member(parameters, "columns", list, "parameters.")
    rising = all(type(k) is int and 1 <= k < n_inputs for k in columns) and sorted(set(columns)) == columns
    if not rising:
        raise Refused(f"parameters.columns is not a rising list of whole numbers from 1 to {n_inputs - 1}")
    middle, half_range = (number(parameters.get(key), f"parameters.{key}") for key in ("middle", "half_range"))
    mean, std = (vector(parameters.get(key), len(columns), f"parameters.{key}") for key in ("mean", "std"))
    if (std < _SMALLEST).any() or not (half_range == 0.0 or half_range >= _SMALLEST):
        raise Refused("parameters.std or parameters.half_range has a value that is not above zero")
    cross = member(parameters, "cross", bool, "parameters.")
    return LagBankTerms(middle, half_range, degree, np.array(columns, dtype=np.intp), mean, std, cross)


def _guard(guard: Mapping[str, Any], n_inputs: int, size: int) -> Guard:
    low, high = (vector(guard.get(key), n_inputs, f"parameters.guard.{key}") for key in ("low", "high"))
    if (low > high).any():
        raise Refused("parameters.guard has a low above its high")
    centre = vector(guard.get("centre"), size, "parameters.guard.centre")
    return Guard(low, high, centre, matrix(guard.get("whitening"), size, size, "parameters.guard.whitening"))
