"""Compensation models as JSON files: readable, complete, no pickle, the same predictions to the last bit.

Numbers are written with Python's repr, the shortest text that reads back as the same float64.
"""

import json
import os
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.linear import LinearCompensation, LinearModel
from fitting.rules import Antecedents, RuleModel
from fitting.strict_json import Refused, matrix, member, number, parse_object, read_object, vector
from fitting.takagi_sugeno import TakagiSugeno

FORMAT, VERSION = "fogbench-model", 1
INPUTS = (("temperature", "degC"), ("rate_output", "deg/s"))
OUTPUT = ("rate", "deg/s")
_MOST_RULES = 1000
_NARROWEST = 1e-30


class ModelFileError(Exception):
    """A model file that cannot be written or used: which file, why, and what to do."""

    def __init__(self, path: Path, reason: str, advice: str) -> None:
        super().__init__(f"model file {path}: {reason}. {advice}")
        self.path, self.reason = path, reason


@dataclass(frozen=True)
class Compensation:
    """A model read from a file, ready to be applied.

    input_min, input_max: the training box, [temperature_degc, rate_dps], shape (2,). document: everything in the file.
    """

    model: LinearModel | RuleModel
    input_min: NDArray[np.float64]
    input_max: NDArray[np.float64]
    document: Mapping[str, Any]

    def predict(self, temperature_degc: ArrayLike, rate_dps: ArrayLike) -> NDArray[np.float64]:
        """Compensated rate in deg/s, of the inputs' broadcast shape; a row with a NaN gives NaN."""
        temperature, rate = np.broadcast_arrays(
            np.asarray(temperature_degc, dtype=np.float64), np.asarray(rate_dps, dtype=np.float64)
        )
        predicted = self.model.predict(np.column_stack([temperature.ravel(), rate.ravel()]))
        return predicted.reshape(temperature.shape)

    def inside(self, temperature_degc: ArrayLike, rate_dps: ArrayLike) -> NDArray[np.bool_]:
        """Whether each row lies in the training box, where the model may be trusted; a NaN lies outside."""
        temperature = np.asarray(temperature_degc, dtype=np.float64)
        rate = np.asarray(rate_dps, dtype=np.float64)
        warm = (temperature >= self.input_min[0]) & (temperature <= self.input_max[0])
        return np.asarray(warm & (rate >= self.input_min[1]) & (rate <= self.input_max[1]))


def save_model(
    path: str | Path,
    estimator: LinearCompensation | TakagiSugeno,
    meta: Mapping[str, Any],
    figures_of_merit: Mapping[str, Any] | None = None,
) -> None:
    """Write a fitted estimator of [temperature_degc, rate_dps], replacing the file in one step.

    meta: whatever says where it comes from (DUT, run, when); figures_of_merit: results of validation, kept beside the
    training residuals. Both must be JSON. `ModelFileError` if they are not, if the estimator is not fitted or not one
    of ours, or if the file cannot be written.
    """
    path = Path(path)
    try:
        document = _describe(estimator) | {"meta": dict(meta)}
        document["figures_of_merit"] |= dict(figures_of_merit or {})
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        _compensation(parse_object(text.encode()))
    except (TypeError, ValueError, RecursionError) as error:
        advice = "Fit on finite [temperature, rate] rows, and give meta and figures as finite numbers, texts and lists."
        raise ModelFileError(path, f"this model cannot be saved ({error})", advice) from error
    try:
        _replace(path, text)
    except (OSError, ValueError) as error:
        advice = "Check that the folder exists, is writable and not full."
        raise ModelFileError(path, f"it cannot be written ({error})", advice) from error


def load_model(path: str | Path) -> Compensation:
    """Read a model file; `ModelFileError` with the reason if it is damaged, foreign or of another version."""
    path = Path(path)
    advice = "Fit the model again (fogbench fit RUN) or take the file from its run folder."
    try:
        return _compensation(read_object(path))
    except Refused as error:
        raise ModelFileError(path, str(error), advice) from error
    except (OSError, ValueError) as error:
        raise ModelFileError(path, f"it cannot be read ({error})", advice) from error


def _replace(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def _describe(estimator: LinearCompensation | TakagiSugeno) -> dict[str, Any]:
    """The document of a fitted estimator, without meta."""
    if not isinstance(estimator, LinearCompensation | TakagiSugeno):
        raise TypeError(f"{type(estimator).__name__} is not a kind of model that has a file format")
    if not hasattr(estimator, "model_"):
        raise TypeError(f"{type(estimator).__name__} is not fitted")
    training = estimator.training_
    return {
        "format": FORMAT,
        "version": VERSION,
        "kind": "linear" if isinstance(estimator, LinearCompensation) else "takagi_sugeno",
        "inputs": _describe_inputs(estimator),
        "output": {
            "name": OUTPUT[0],
            "unit": OUTPUT[1],
            "mean": estimator.target_mean_,
            "std": estimator.target_std_,
        },
        "parameters": _describe_parameters(estimator),
        "training": {"sha256": training.sha256, "rows": training.rows},
        "figures_of_merit": {
            "training_max_abs_dps": training.max_abs_residual,
            "training_std_dps": training.std_residual,
        },
        "settings": {name: _plain(value) for name, value in estimator.get_params().items()},
        "versions": _versions(),
    }


def _describe_inputs(estimator: LinearCompensation | TakagiSugeno) -> list[dict[str, Any]]:
    training, scaling = estimator.training_, estimator.scaling_
    if len(training.input_min) != len(INPUTS):
        raise ValueError(f"it was fitted on {len(training.input_min)} inputs instead of temperature and rate")
    mean, std = training.input_min.copy(), np.zeros(len(INPUTS))  # of a constant column
    mean[scaling.columns], std[scaling.columns] = scaling.mean, scaling.std
    columns = zip(
        INPUTS, training.input_min.tolist(), training.input_max.tolist(), mean.tolist(), std.tolist(), strict=True
    )
    return [
        {"name": name, "unit": unit, "min": low, "max": high, "mean": centre, "std": spread}
        for (name, unit), low, high, centre, spread in columns
    ]


def _describe_parameters(estimator: LinearCompensation | TakagiSugeno) -> dict[str, Any]:
    if isinstance(estimator, LinearCompensation):
        return {
            "coefficients": estimator.coefficients_.tolist(),
            "coefficients_u": _known(estimator.coefficients_u_),
        }
    return {
        "columns": estimator.columns_.tolist(),
        "centres": estimator.centres_.tolist(),
        "widths": estimator.widths_.tolist(),
        "consequents": estimator.consequents_.tolist(),
        "consequents_u": _known(estimator.consequents_u_),
    }


def _known(uncertainty: NDArray[np.float64]) -> list[Any] | None:
    """Standard uncertainties, or null where there were too few rows to estimate them."""
    return uncertainty.tolist() if np.isfinite(uncertainty).all() else None


def _plain(value: object) -> object:
    return value if isinstance(value, bool | int | float | str | None) else repr(value)


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for package in ("fogbench", "numpy", "scipy", "scikit-learn"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "unknown"
    return versions


def _compensation(document: dict[str, Any]) -> Compensation:
    """Check a document and build what it describes; `Refused` with the reason."""
    if member(document, "format", str) != FORMAT:
        raise Refused(f"its format is {document['format'][:40]!r} instead of {FORMAT!r}")
    if member(document, "version", int) != VERSION:
        raise Refused(f"its format version is {document['version']}; this fogbench reads version {VERSION}")
    low, high = _ranges(member(document, "inputs", list))
    _check_column("output.", member(document, "output", dict), OUTPUT)
    _check_training(member(document, "training", dict))
    for key in ("figures_of_merit", "versions", "meta"):
        member(document, key, dict)
    parameters = member(document, "parameters", dict)
    kind = member(document, "kind", str)
    if kind == "linear":
        model: LinearModel | RuleModel = _linear_model(parameters)
    elif kind == "takagi_sugeno":
        model = _rule_model(parameters)
    else:
        raise Refused(f"its kind is {kind[:40]!r}; known kinds: 'linear', 'takagi_sugeno'")
    return Compensation(model, low, high, document)


def _check_training(training: dict[str, Any]) -> None:
    if not re.fullmatch("[0-9a-f]{64}", member(training, "sha256", str, "training.")):
        raise Refused("training.sha256 is not 64 hexadecimal digits")
    if member(training, "rows", int, "training.") < 1:
        raise Refused("training.rows is not above zero")


def _check_column(where: str, described: dict[str, Any], expected: tuple[str, str]) -> None:
    """Name, unit and scaling of an input or of the output."""
    for key in ("mean", "std"):
        number(described.get(key), f"{where}{key}")
    for key, wanted in zip(("name", "unit"), expected, strict=True):
        if member(described, key, str, where) != wanted:
            raise Refused(f"{where}{key} is {described[key][:40]!r} instead of {wanted!r}")


def _ranges(inputs: list[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if len(inputs) != len(INPUTS) or not all(isinstance(entry, dict) for entry in inputs):
        raise Refused(f"inputs is not a list of {len(INPUTS)} objects")
    limits = np.empty((2, len(INPUTS)))
    for k, (entry, expected) in enumerate(zip(inputs, INPUTS, strict=True)):
        _check_column(f"inputs[{k}].", entry, expected)
        limits[:, k] = [number(entry.get(key), f"inputs[{k}].{key}") for key in ("min", "max")]
        if limits[0, k] > limits[1, k]:
            raise Refused(f"inputs[{k}] has its min above its max")
    return limits[0], limits[1]


def _linear_model(parameters: dict[str, Any]) -> LinearModel:
    if parameters.get("coefficients_u") is not None:
        vector(parameters["coefficients_u"], len(INPUTS) + 1, "parameters.coefficients_u")
    return LinearModel(vector(parameters.get("coefficients"), len(INPUTS) + 1, "parameters.coefficients"))


def _rule_model(parameters: dict[str, Any]) -> RuleModel:
    columns = member(parameters, "columns", list, "parameters.")
    if columns not in ([], [0], [1], [0, 1]) or any(type(column) is not int for column in columns):
        raise Refused("parameters.columns is not one of [], [0], [1], [0, 1]")
    n_rules, size = len(member(parameters, "consequents", list, "parameters.")), len(columns)
    if not 1 <= n_rules <= _MOST_RULES:
        raise Refused(f"parameters.consequents has {n_rules} rules; allowed: 1 to {_MOST_RULES}")
    consequents = matrix(parameters["consequents"], n_rules, size + 1, "parameters.consequents")
    centres = matrix(parameters.get("centres"), n_rules, size, "parameters.centres")
    widths = matrix(parameters.get("widths"), n_rules, size, "parameters.widths")
    if (widths < _NARROWEST).any():
        raise Refused("parameters.widths has a width that is not above zero")
    if parameters.get("consequents_u") is not None:
        matrix(parameters["consequents_u"], n_rules, size + 1, "parameters.consequents_u")
    return RuleModel(Antecedents(centres, widths), consequents, np.array(columns, dtype=np.intp))
