"""Polynomials in a file."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.modelfiles.kernel import positive, powers_of
from fitting.modelfiles.kinds import known
from fitting.polynomial import PolynomialCompensation, PolynomialModel
from fitting.strict_json import columns_used, vector


def describe(estimator: PolynomialCompensation) -> dict[str, Any]:
    """Ranges the inputs are scaled by, powers and coefficients, in the units of inputs and output."""
    model = estimator.model_
    return {
        "columns": model.columns.tolist(),
        "middle": model.middle.tolist(),
        "half": model.half.tolist(),
        "powers": model.powers.tolist(),
        "coefficients": model.coefficients.tolist(),
        "coefficients_u": known(estimator.coefficients_u_),
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> PolynomialModel:
    """The model; `Refused` for anything that is not one of n_inputs inputs."""
    columns = columns_used(parameters, n_inputs)
    middle = vector(parameters.get("middle"), len(columns), "parameters.middle")
    half = positive(parameters, "half", len(columns))
    powers = powers_of(parameters, len(columns))
    coefficients = vector(parameters.get("coefficients"), len(powers), "parameters.coefficients")
    if parameters.get("coefficients_u") is not None:
        vector(parameters["coefficients_u"], len(powers), "parameters.coefficients_u")
    return PolynomialModel(columns, middle, half, np.asarray(powers), coefficients)
