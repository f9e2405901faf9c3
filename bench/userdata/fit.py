"""A model from a user's recording: chosen, judged, fitted to all rows, written with where it came from."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analyses.models import model_factories
from bench.errors import UserMistake
from bench.userdata.judging import LEFT_OUT, RANDOM, Figures, Folds, Make, figures, is_better, judge
from bench.userdata.recording import Recording, read_recording
from fitting.linear import LinearCompensation
from fitting.modelfile import ModelFileError, save_model
from fitting.modelfiles.columns import RATE
from fitting.polynomial import PolynomialCompensation

# The first of these that is installed, for a rate that depends on temperature, and for a gyro at rest.
DEFAULTS = {True: ("automatic", "ts_joint"), False: ("automatic", "polynomial", "linear")}


@dataclass(frozen=True)
class Fitted:
    """One model: what it got wrong on rows held back, and whether it looks at the temperature."""

    name: str
    make: Make
    columns: NDArray[np.intp]
    judged: dict[str, Figures]


@dataclass(frozen=True)
class Outcome:
    """The recording, its errors as they were, all models judged with the best first, notes, and the file written."""

    recording: Recording
    before: Figures
    models: list[Fitted]
    notes: list[str]
    path: Path

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "model": str(self.path),
            "name": self.models[0].name,
            "rows": self.recording.rows,
            "usable": len(self.recording.target),
            "missing": dict(self.recording.missing),
            "before": self.before.as_dict(),
            "models": {one.name: {key: value.as_dict() for key, value in one.judged.items()} for one in self.models},
            "notes": self.notes,
        }


def fit_recording(path: Path, options: tuple[str, ...], names: tuple[str, ...], out: Path) -> Outcome:
    """Fit models to a file and write the best at groups left out. Raises UserMistake for anything that cannot be."""
    if out.exists() and out.samefile(path):
        raise UserMistake(f"-o {out} is the data itself; it is never overwritten. Give another file.")
    recording = read_recording(path, options)
    folds = Folds.of(recording)
    makes = model_factories(names) if names else _defaults(recording)
    models, notes = [], list[str]()
    for name, make in makes.items():
        fitted, note = _fitted(name, make, recording, folds, chosen=bool(names))
        models.append(fitted)
        notes += [note] if note else []
    models.sort(key=lambda one: one.judged[LEFT_OUT].std_dps)
    before = figures([recording.before])
    _save(out, models[0], recording, before)
    return Outcome(recording, before, models, notes, out)


def _defaults(recording: Recording) -> dict[str, Any]:
    if recording.output == RATE and not recording.temperatures:
        return {"linear": LinearCompensation}
    installed = {item.name for item in entry_points(group="fogbench.models")}
    name = next(name for name in DEFAULTS[recording.output == RATE] if name in installed)
    found: dict[str, Any] = model_factories([name])
    return found


def _fitted(name: str, make: Make, recording: Recording, folds: Folds, chosen: bool) -> tuple[Fitted, str | None]:
    """A model judged with and without the temperature, which it keeps if that helps, or if the user chose the model."""
    everything = np.arange(len(recording.columns))
    full = Fitted(name, make, everything, _judge(name, make, recording, folds, everything))
    if not recording.temperatures:
        return full, None
    plain = _without_temperature(name, make, recording, folds)
    if is_better(full.judged[LEFT_OUT], plain.judged[LEFT_OUT]):
        return full, None
    with_it, without = (one.judged[LEFT_OUT].std_dps for one in (full, plain))
    found = (
        f"{name}: no temperature effect: std left out is {with_it:.3g} deg/s with temperature, {without:.3g} without"
    )
    if chosen:
        return full, f"{found}; it is kept because the model was named with --model"
    return plain, f"{found}; the model has no temperature term"


def _without_temperature(name: str, make: Make, recording: Recording, folds: Folds) -> Fitted:
    """The same model of the rate alone; of a gyro at rest, its mean error."""
    if recording.output == RATE:
        columns = np.arange(recording.temperatures, len(recording.columns))
        return Fitted(name, make, columns, _judge(name, make, recording, folds, columns))
    columns = np.arange(len(recording.columns))
    return Fitted("mean", _mean, columns, _judge("mean", _mean, recording, folds, columns))


def _mean() -> PolynomialCompensation:
    return PolynomialCompensation(degree=0)


def _judge(name: str, make: Make, recording: Recording, folds: Folds, columns: NDArray[np.intp]) -> dict[str, Figures]:
    try:
        return judge(make, recording, folds, columns)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise UserMistake(f"{recording.path}: model '{name}' could not be fitted: {error}") from error


def _save(out: Path, best: Fitted, recording: Recording, before: Figures) -> None:
    model = best.make()
    model.fit(recording.inputs[:, best.columns], recording.target)
    held = {split: best.judged[split].as_dict() for split in (RANDOM, LEFT_OUT)}
    try:
        save_model(
            out,
            model,
            {"model": best.name, "data": recording.meta()},
            {"before": before.as_dict(), **held},
            inputs=[recording.columns[k] for k in best.columns],
            output=recording.output,
        )
    except ModelFileError as error:
        raise UserMistake(str(error)) from error
