"""Compensation models as JSON files: readable, complete, no pickle, the same predictions to the last bit.

Numbers are written with Python's repr, the shortest text that reads back as the same float64. What is in a file, and
how another kind of model gets a format, says `fitting.modelfiles`.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.modelfiles.columns import OUTPUTS, RATE, RATE_INPUT, Column, checked_inputs
from fitting.modelfiles.document import describe, read
from fitting.modelfiles.kinds import Model
from fitting.reach import Reach
from fitting.strict_json import Refused, parse_object, read_object

_DPS_PER = {"deg/s": 1.0, "deg/h": 1.0 / 3600.0}


class ModelFileError(Exception):
    """A model file that cannot be written or used: which file, why, and what to do."""

    def __init__(self, path: Path, reason: str, advice: str) -> None:
        super().__init__(f"model file {path}: {reason}. {advice}")
        self.path, self.reason = path, reason


@dataclass(frozen=True)
class Compensation:
    """A model read from a file, ready to be applied.

    inputs, output: what goes in, in this order, and what comes out: a rate, or the error of a gyro at rest.
    reach: the training range. rate_slope: slope of the plain linear fit of the training data on the rate that went in.
    document: everything in the file.

    Inputs are given by position in the order of `inputs`, or by name.
    """

    model: Model
    inputs: tuple[Column, ...]
    output: Column
    reach: Reach
    rate_slope: float
    document: Mapping[str, Any]

    @property
    def input_min(self) -> NDArray[np.float64]:
        """Lower edge of the training box, (k,)."""
        return self.reach.low

    @property
    def input_max(self) -> NDArray[np.float64]:
        """Upper edge of the training box, (k,)."""
        return self.reach.high

    def predict(self, *columns: ArrayLike, **named: ArrayLike) -> NDArray[np.float64]:
        """The model's output as it is, anywhere, of the inputs' broadcast shape; a row with a NaN gives NaN."""
        rows, shape = self._rows(columns, named)
        return self.model.predict(rows).reshape(shape)

    def inside(self, *columns: ArrayLike, **named: ArrayLike) -> NDArray[np.bool_]:
        """Whether each row lies in the training range, where the model may be trusted; a NaN lies outside."""
        rows, shape = self._rows(columns, named)
        return ~self.reach.bring_inside(rows)[1].reshape(shape)

    def guarded(self, *columns: ArrayLike, **named: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The model's output with the guard: values, and which rows were outside the training range.

        Outside, temperatures and their kin are held at the edge of the range (`Reach.bring_inside`), and the rate
        that went in goes on from the edge with the slope of the plain linear fit: a saturating rate would be worse
        than no compensation, and the model's own bend beyond its data means nothing.
        """
        rows, shape = self._rows(columns, named)
        held, outside = self.reach.bring_inside(rows)
        values = self.model.predict(held)
        if self.output == RATE:
            rate = self.inputs.index(RATE_INPUT)
            values = np.where(outside, values + self.rate_slope * (rows[:, rate] - held[:, rate]), values)
        return values.reshape(shape), outside.reshape(shape)

    def compensate(
        self, *columns: ArrayLike, rate_dps: ArrayLike | None = None, **named: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Compensated rate in deg/s, and which rows the guard held (`guarded`).

        rate_dps: what the gyro gave, for a model whose output is an error, which is taken off it; a model whose output
        is a rate has it among its inputs. ValueError if it is missing or given in vain.
        """
        values, outside = self.guarded(*columns, **named)
        if self.output == RATE:
            if rate_dps is not None:
                raise ValueError("this model has the rate among its inputs; leave rate_dps out.")
            return values, outside
        if rate_dps is None:
            raise ValueError("this model gives an error; pass the gyro's output as rate_dps to take it off.")
        given = np.asarray(rate_dps, dtype=np.float64)
        return np.asarray(given - values * _DPS_PER[self.output.unit]), np.broadcast_to(
            outside, np.shape(given - values)
        )

    def _rows(
        self, columns: tuple[ArrayLike, ...], named: Mapping[str, ArrayLike]
    ) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        """Inputs by position or name as rows (n, k), and their broadcast shape."""
        names = [column.name for column in self.inputs]
        given = [*columns, *(named[name] for name in names[len(columns) :] if name in named)]
        if len(given) != len(names) or len(columns) + len(named) != len(names):
            wanted = ", ".join(f"{column.name} ({column.unit})" for column in self.inputs)
            raise ValueError(f"this model takes {len(names)} inputs: {wanted}; by position or by these names.")
        arrays = np.broadcast_arrays(*(np.asarray(values, dtype=np.float64) for values in given))
        return np.column_stack([array.ravel() for array in arrays]), arrays[0].shape


def save_model(
    path: str | Path,
    estimator: Any,
    meta: Mapping[str, Any],
    figures_of_merit: Mapping[str, Any] | None = None,
    *,
    inputs: Sequence[Column] | None = None,
    output: Column = RATE,
) -> None:
    """Write a fitted estimator (of a kind in `fitting.modelfiles.kinds`), replacing the file in one step.

    meta: whatever says where it comes from (DUT, run, when); figures_of_merit: results of validation, kept beside the
    training residuals. Both must be JSON. inputs: names and units of the columns it was fitted on; without them, the
    campaign's [temperature_degc, rate_dps]. output: what y was: the true rate (then one input is the rate the gyro
    gave), or the bias error in deg/s or deg/h. `ModelFileError` if anything of this does not fit, if the estimator is
    not fitted or not one of ours, or if the file cannot be written.
    """
    path = Path(path)
    try:
        columns = checked_inputs(inputs, _n_inputs(estimator))
        if output not in OUTPUTS:
            raise ValueError(f"the output {output} is not one of {', '.join(map(str, OUTPUTS))}")
        document = describe(estimator, columns, output) | {"meta": dict(meta)}
        document["figures_of_merit"] |= dict(figures_of_merit or {})
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        read(parse_object(text.encode()))
    except (TypeError, ValueError, RecursionError) as error:
        advice = "Fit on finite rows, name all inputs, and give meta and figures as finite numbers, texts and lists."
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
        document = read_object(path)
        found = read(document)
    except Refused as error:
        raise ModelFileError(path, str(error), advice) from error
    except (OSError, ValueError) as error:
        raise ModelFileError(path, f"it cannot be read ({error})", advice) from error
    return Compensation(found.model, found.inputs, found.output, found.reach, found.rate_slope, document)


def _n_inputs(estimator: Any) -> int:
    """Columns a fitted estimator was fitted on; those of the campaign for anything that `describe` will refuse."""
    return int(getattr(estimator, "n_features_in_", 2))


def _replace(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
