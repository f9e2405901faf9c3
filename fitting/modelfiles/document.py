"""The document around a model's parameters: what it is, of which inputs, where it may be trusted, where it is from."""

import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.modelfiles.columns import (
    CAMPAIGN_INPUTS,
    MOST_INPUTS,
    OUTPUTS,
    RATE,
    RATE_INPUT,
    Column,
    figure_name,
    read_column,
)
from fitting.modelfiles.kinds import Model, codec_of, kind_of
from fitting.reach import MOST_PAIRED, Reach
from fitting.strict_json import Refused, matrix, member, number
from fitting.training import TrainingRecord

FORMAT, VERSION = "fogbench-model", 2
READABLE = (1, 2)


@dataclass(frozen=True)
class Described:
    """What a document holds. rate_slope: see `Compensation`; 1 in files of version 1."""

    model: Model
    inputs: tuple[Column, ...]
    output: Column
    reach: Reach
    rate_slope: float


def describe(estimator: Any, inputs: tuple[Column, ...], output: Column) -> dict[str, Any]:
    """The document of a fitted estimator, without meta. TypeError for one that has no file format or is not fitted."""
    chosen = getattr(estimator, "best_estimator_", estimator)  # of a search: what it found
    kind = kind_of(chosen)
    if not hasattr(chosen, "model_"):
        raise TypeError(f"{type(estimator).__name__} is not fitted")
    training: TrainingRecord = chosen.training_
    return {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "inputs": _describe_inputs(training, inputs),
        "output": {
            "name": output.name,
            "unit": output.unit,
            "mean": training.target_mean,
            "std": training.target_std,
        },
        "guard": _describe_guard(training, inputs),
        "parameters": codec_of(kind).describe(chosen),
        "training": {"sha256": training.sha256, "rows": training.rows},
        "figures_of_merit": {
            figure_name("training_max_abs", output): training.max_abs_residual,
            figure_name("training_std", output): training.std_residual,
        },
        "settings": {name: _plain(value) for name, value in chosen.get_params().items()},
        "versions": _versions(),
    }


def _describe_inputs(training: TrainingRecord, inputs: tuple[Column, ...]) -> list[dict[str, Any]]:
    figures = (training.input_min, training.input_max, training.input_mean, training.input_std)
    columns = zip(inputs, *(values.tolist() for values in figures), strict=True)
    return [
        {"name": column.name, "unit": column.unit, "min": low, "max": high, "mean": mean, "std": std}
        for column, low, high, mean, std in columns
    ]


def _describe_guard(training: TrainingRecord, inputs: tuple[Column, ...]) -> dict[str, Any]:
    reach = training.reach
    slopes = [slope for column, slope in zip(inputs, training.slopes.tolist(), strict=True) if column == RATE_INPUT]
    return {
        "centre": reach.centre.tolist(),
        "sums": None if reach.sums is None else reach.sums.tolist(),
        "differences": None if reach.differences is None else reach.differences.tolist(),
        "rate_slope": slopes[0] if slopes else None,
    }


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


def read(document: Mapping[str, Any]) -> Described:
    """Check a document and build what it describes; `Refused` with the reason."""
    if member(document, "format", str) != FORMAT:
        raise Refused(f"its format is {document['format'][:40]!r} instead of {FORMAT!r}")
    if member(document, "version", int) not in READABLE:
        wanted = " and ".join(map(str, READABLE))
        raise Refused(f"its format version is {document['version']}; this fogbench reads versions {wanted}")
    inputs, low, high = _read_inputs(member(document, "inputs", list))
    output = read_column("output.", member(document, "output", dict))
    _check_names(document["version"], inputs, output)
    _check_training(member(document, "training", dict))
    for key in ("figures_of_merit", "versions", "meta"):
        member(document, key, dict)
    parameters = member(document, "parameters", dict)
    kind = member(document, "kind", str)
    model = codec_of(kind).build(parameters, len(inputs))
    if document["version"] == 1:
        return Described(model, inputs, output, Reach(low, high, 0.5 * (low + high)), 1.0)
    return Described(model, inputs, output, *_read_guard(member(document, "guard", dict), low, high))


def _read_inputs(inputs: list[Any]) -> tuple[tuple[Column, ...], NDArray[np.float64], NDArray[np.float64]]:
    if not 1 <= len(inputs) <= MOST_INPUTS or not all(isinstance(entry, dict) for entry in inputs):
        raise Refused(f"inputs is not a list of 1 to {MOST_INPUTS} objects")
    columns = tuple(read_column(f"inputs[{k}].", entry) for k, entry in enumerate(inputs))
    if len({column.name for column in columns}) != len(columns):
        raise Refused("inputs has two of the same name")
    limits = np.empty((2, len(inputs)))
    for k, entry in enumerate(inputs):
        limits[:, k] = [number(entry.get(key), f"inputs[{k}].{key}") for key in ("min", "max")]
        if limits[0, k] > limits[1, k]:
            raise Refused(f"inputs[{k}] has its min above its max")
    return columns, limits[0], limits[1]


def _check_names(format_version: int, inputs: tuple[Column, ...], output: Column) -> None:
    """Version 1 knew the inputs of the campaign only; every version states an output it can compensate with."""
    allowed = (RATE,) if format_version == 1 else OUTPUTS
    if output not in allowed:
        wanted = ", ".join(f"{column.name} in {column.unit}" for column in allowed)
        raise Refused(f"its output is {output.name!r} in {output.unit!r}; allowed: {wanted}")
    if format_version == 1 and inputs != CAMPAIGN_INPUTS:
        raise Refused("its inputs are not temperature in degC and rate_output in deg/s, as in every file of version 1")
    if output == RATE and RATE_INPUT not in inputs:
        raise Refused("its output is a rate and no input is rate_output in deg/s")


def _check_training(training: dict[str, Any]) -> None:
    if not re.fullmatch("[0-9a-f]{64}", member(training, "sha256", str, "training.")):
        raise Refused("training.sha256 is not 64 hexadecimal digits")
    if member(training, "rows", int, "training.") < 1:
        raise Refused("training.rows is not above zero")


def _read_guard(guard: dict[str, Any], low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[Reach, float]:
    centre = matrix([guard.get("centre")], 1, len(low), "guard.centre")[0]
    if (centre < low).any() or (centre > high).any():
        raise Refused("guard.centre is outside the ranges of the inputs")
    slope = 1.0 if guard.get("rate_slope") is None else number(guard["rate_slope"], "guard.rate_slope")
    if guard.get("sums") is None and guard.get("differences") is None:
        return Reach(low, high, centre), slope
    if len(low) > MOST_PAIRED:
        raise Refused(f"guard.sums is given for {len(low)} inputs; allowed: for up to {MOST_PAIRED}")
    pairs = len(low) * (len(low) - 1) // 2
    sums, differences = (matrix(guard.get(key), 2, pairs, f"guard.{key}") for key in ("sums", "differences"))
    for name, limits in (("sums", sums), ("differences", differences)):
        if (limits[0] > limits[1]).any():
            raise Refused(f"guard.{name} has a lower limit above its upper one")
    return Reach(low, high, centre, sums, differences), slope
