"""Linear models in a file."""

from collections.abc import Mapping
from typing import Any

from fitting.linear import LinearCompensation, LinearModel
from fitting.modelfiles.kinds import known
from fitting.strict_json import vector


def describe(estimator: LinearCompensation) -> dict[str, Any]:
    """Coefficients and their standard uncertainties, in the units of inputs and output."""
    return {
        "coefficients": estimator.coefficients_.tolist(),
        "coefficients_u": known(estimator.coefficients_u_),
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> LinearModel:
    """The model; `Refused` for anything that is not one of n_inputs inputs."""
    if parameters.get("coefficients_u") is not None:
        vector(parameters["coefficients_u"], n_inputs + 1, "parameters.coefficients_u")
    return LinearModel(vector(parameters.get("coefficients"), n_inputs + 1, "parameters.coefficients"))
