"""Kernel models in a file: LS-SVM, support vector regression, Gaussian process and radial basis spline."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.estimator import CompensationEstimator
from fitting.kernels import KERNELS, KernelModel
from fitting.strict_json import Refused, columns_used, matrix, member, number, vector

MOST_SUPPORTS, MOST_TERMS, HIGHEST_POWER = 5000, 2000, 30
_NARROWEST = 1e-30


def describe(estimator: CompensationEstimator) -> dict[str, Any]:
    """Everything of `KernelModel`: scaling, supports and weights (scaled), polynomial, and the scale of the output."""
    model = estimator.model_
    assert isinstance(model, KernelModel)
    return {
        "columns": model.columns.tolist(),
        "shift": model.shift.tolist(),
        "scale": model.scale.tolist(),
        "kernel": model.kernel,
        "supports": model.supports.tolist(),
        "weights": model.weights.tolist(),
        "powers": model.powers.tolist(),
        "coefficients": model.coefficients.tolist(),
        "output_shift": model.output_shift,
        "output_scale": model.output_scale,
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> KernelModel:
    """The model; `Refused` for anything that is not one of n_inputs inputs."""
    columns = columns_used(parameters, n_inputs)
    size = len(columns)
    kernel = member(parameters, "kernel", str, "parameters.")
    if kernel not in KERNELS:
        raise Refused(f"parameters.kernel is {kernel[:40]!r}; known kernels: {', '.join(map(repr, KERNELS))}")
    count = len(member(parameters, "supports", list, "parameters."))
    if count > MOST_SUPPORTS:
        raise Refused(f"parameters.supports has {count} rows; allowed: up to {MOST_SUPPORTS}")
    powers = powers_of(parameters, size)
    return KernelModel(
        columns,
        vector(parameters.get("shift"), size, "parameters.shift"),
        positive(parameters, "scale", size),
        kernel,
        matrix(parameters["supports"], count, size, "parameters.supports"),
        vector(parameters.get("weights"), count, "parameters.weights"),
        powers,
        vector(parameters.get("coefficients"), len(powers), "parameters.coefficients"),
        number(parameters.get("output_shift"), "parameters.output_shift"),
        number(parameters.get("output_scale"), "parameters.output_scale"),
    )


def positive(parameters: Mapping[str, Any], key: str, size: int) -> NDArray[np.float64]:
    """A list of size numbers above zero."""
    values = vector(parameters.get(key), size, f"parameters.{key}")
    if (values < _NARROWEST).any():
        raise Refused(f"parameters.{key} has a value that is not above zero")
    return values


def powers_of(parameters: Mapping[str, Any], size: int) -> NDArray[np.intp]:
    """Powers of the terms of a polynomial of size inputs, (terms, size)."""
    count = len(member(parameters, "powers", list, "parameters."))
    if not 1 <= count <= MOST_TERMS:
        raise Refused(f"parameters.powers has {count} terms; allowed: 1 to {MOST_TERMS}")
    powers = matrix(parameters["powers"], count, size, "parameters.powers")
    if not ((powers >= 0) & (powers <= HIGHEST_POWER) & (powers == np.floor(powers))).all():
        raise Refused(f"parameters.powers has one that is not a whole number from 0 to {HIGHEST_POWER}")
    return powers.astype(np.intp)
