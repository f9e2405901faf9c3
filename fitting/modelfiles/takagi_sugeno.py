"""Takagi-Sugeno rules in a file."""

from collections.abc import Mapping
from typing import Any

from fitting.modelfiles.kinds import known
from fitting.rules import Antecedents, RuleModel
from fitting.strict_json import Refused, columns_used, matrix, member
from fitting.takagi_sugeno import TakagiSugeno

MOST_RULES = 1000
_NARROWEST = 1e-30


def describe(estimator: TakagiSugeno) -> dict[str, Any]:
    """Centres, widths and consequents of the rules, in the units of inputs and output."""
    return {
        "columns": estimator.columns_.tolist(),
        "centres": estimator.centres_.tolist(),
        "widths": estimator.widths_.tolist(),
        "consequents": estimator.consequents_.tolist(),
        "consequents_u": known(estimator.consequents_u_),
    }


def build(parameters: Mapping[str, Any], n_inputs: int) -> RuleModel:
    """The model; `Refused` for anything that is not one of n_inputs inputs."""
    columns = columns_used(parameters, n_inputs)
    n_rules, size = len(member(parameters, "consequents", list, "parameters.")), len(columns)
    if not 1 <= n_rules <= MOST_RULES:
        raise Refused(f"parameters.consequents has {n_rules} rules; allowed: 1 to {MOST_RULES}")
    consequents = matrix(parameters["consequents"], n_rules, size + 1, "parameters.consequents")
    centres = matrix(parameters.get("centres"), n_rules, size, "parameters.centres")
    widths = matrix(parameters.get("widths"), n_rules, size, "parameters.widths")
    if (widths < _NARROWEST).any():
        raise Refused("parameters.widths has a width that is not above zero")
    if parameters.get("consequents_u") is not None:
        matrix(parameters["consequents_u"], n_rules, size + 1, "parameters.consequents_u")
    return RuleModel(Antecedents(centres, widths), consequents, columns)
