"""A model from a user's recording: chosen, judged, fitted to all rows, written with where it came from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.errors import UserMistake
from bench.userdata.candidates import Fitted, judged_models
from bench.userdata.judging import LEFT_OUT, RANDOM, Figures, Folds, figures
from bench.userdata.recording import Recording, read_recording
from fitting.modelfile import ModelFileError, save_model


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
    models, notes = judged_models(recording, folds, names)
    models.sort(key=lambda one: one.left_out_dps)
    before = figures([recording.before])
    _save(out, models[0], recording, before)
    return Outcome(recording, before, models, notes, out)


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
