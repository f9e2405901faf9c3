"""Networks of one hidden layer in a file, however they were trained."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.csapso import CsapsoNetwork
from fitting.network import BackPropagationNetwork
from fitting.network_core import NetworkModel, Shape
from fitting.scaling import Scaling
from fitting.strict_json import Refused, columns_used, matrix, member, number, vector

MOST_HIDDEN = 10_000
_SMALLEST = 1e-30


def describe(estimator: BackPropagationNetwork | CsapsoNetwork) -> dict[str, Any]:
    """Weights on the z-scores of the columns used, with means and deviations in the units of inputs and output."""
    model = estimator.model_
    into, thresholds = model.shape.hidden_weights(model.weights)
    linear = model.weights[model.shape.nonlinear :]
    return {
        "activation": model.shape.activation,
        "columns": model.scaling.columns.tolist(),
        "mean": model.scaling.mean.tolist(),
        "std": model.scaling.std.tolist(),
        "hidden_weights": into.tolist(),
        "thresholds": thresholds.tolist(),
        "output_weights": linear[: model.shape.hidden].tolist(),
        "constant": float(linear[model.shape.hidden]),
        "linear_path": linear[model.shape.hidden + 1 :].tolist() if model.shape.linear_path else None,
        "output_mean": model.target_mean,
        "output_std": model.target_std,
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> NetworkModel:
    """The model; `Refused` for anything that is not one of n_inputs inputs."""
    activation = member(parameters, "activation", str, "parameters.")
    if activation not in ("sigmoid", "tanh"):
        raise Refused(f"parameters.activation is {activation[:40]!r}; allowed: 'sigmoid', 'tanh'")
    columns = columns_used(parameters, n_inputs)
    size, hidden = len(columns), len(member(parameters, "thresholds", list, "parameters."))
    if not 1 <= hidden <= MOST_HIDDEN:
        raise Refused(f"parameters.thresholds has {hidden} hidden units; allowed: 1 to {MOST_HIDDEN}")
    mean, std = (vector(parameters.get(key), size, f"parameters.{key}") for key in ("mean", "std"))
    if (std < _SMALLEST).any():
        raise Refused("parameters.std has a deviation that is not above zero")
    parts = [
        matrix(parameters.get("hidden_weights"), hidden, size, "parameters.hidden_weights").ravel(),
        vector(parameters["thresholds"], hidden, "parameters.thresholds"),
        vector(parameters.get("output_weights"), hidden, "parameters.output_weights"),
        np.array([number(parameters.get("constant"), "parameters.constant")]),
    ]
    path = parameters.get("linear_path") is not None
    if path:
        parts.append(vector(parameters["linear_path"], size, "parameters.linear_path"))
    output = [number(parameters.get(key), f"parameters.{key}") for key in ("output_mean", "output_std")]
    shape = Shape(size, hidden, "sigmoid" if activation == "sigmoid" else "tanh", path)
    return NetworkModel(shape, np.concatenate(parts), Scaling(columns, mean, std), *output)
