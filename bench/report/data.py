"""A run folder read into one frozen value; what is missing becomes a note in the report, never a crash.

Words (docs/reference): error = what the DUT says minus the reference rate; residual = what is left of the error after
compensation. Both in deg/s.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import UserMistake
from bench.points import COLUMNS, TEXT_COLUMNS
from bench.report.formats import fault
from bench.report.manifest import Manifest
from bench.report.residuals import (
    HEADLINE_SPLIT,
    ModelLoader,
    held_out_residuals,
    load_saved_model,
    read_held_out,
    saved_model_residuals,
)

HELD_BACK_SPLIT = "random"
TRAIN_SPLIT = "random_train"
UNCOMPENSATED = "none"
LARGEST_SOURCE_CHARACTERS = 60_000
FEW_POINTS = 20

NUMBERS = tuple(name for name in COLUMNS if name not in TEXT_COLUMNS)

Floats = NDArray[np.float64]
Metrics = Mapping[str, Mapping[str, Mapping[str, float | None]]]


@dataclass(frozen=True)
class DutData:
    """One DUT: its points in the order measured, and the model shown in its figures.

    `points` has the columns of points.csv and `error_dps`, `residual_dps` (NaN without a model), `dwell` (counted from
    0 in the order measured) and `usable` (a finite error and a verdict other than fail). `held_out`: each residual is
    of a model that never saw the dwell of its point; otherwise of the model fitted on all points.
    """

    name: str
    points: pd.DataFrame
    metrics: Metrics
    model: str | None
    chosen_by: str
    held_out: bool = False

    @property
    def usable(self) -> pd.DataFrame:
        return self.points[self.points["usable"]]

    @property
    def revisited(self) -> bool:
        """Whether a chamber setpoint was measured in more than one dwell."""
        visits = self.usable.groupby("chamber_setpoint_degc")["dwell"].nunique()
        return bool((visits > 1).any())

    @property
    def floor_dps(self) -> float | None:
        """Root mean square of the standard uncertainties of the judged points: the noise floor."""
        for split in (HEADLINE_SPLIT, HELD_BACK_SPLIT):
            floor = self.figure(self.model or UNCOMPENSATED, split, "floor_dps")
            if floor is not None:
                return floor
        u = self.usable["rate_mean_u_dps"].to_numpy(dtype=float)
        u = u[np.isfinite(u)]
        return float(np.sqrt(np.mean(u**2))) if u.size else None

    def figure(self, model: str, split: str, quantity: str) -> float | None:
        """One figure of metrics.json, None where it was not measured."""
        value = self.metrics.get(model, {}).get(split, {}).get(quantity)
        return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


@dataclass(frozen=True)
class ReportData:
    """Everything the report shows, from one run folder."""

    run_dir: Path
    manifest: Manifest
    duts: tuple[DutData, ...]
    timeline: pd.DataFrame | None
    sources: Mapping[str, str]
    notes: tuple[str, ...]


def read_run(run_dir: Path, load_model: ModelLoader | None = None) -> ReportData:
    """Read `run_dir`; models are loaded with `load_model` (default: fitting.modelfile.load_model).

    Raises UserMistake if the folder is not a run folder (neither manifest.json nor points.csv in it).
    """
    if not any((run_dir / name).is_file() for name in ("manifest.json", "points.csv")):
        raise UserMistake(
            f"{run_dir}: not a run folder: neither manifest.json nor points.csv is in it. "
            "Give the folder of a run, results/<run-id>; 'fogbench list' shows them."
        )
    notes: list[str] = []
    manifest = Manifest.from_mapping(_json(run_dir / "manifest.json", notes), run_dir.resolve().name)
    notes += manifest.notes
    points = _points(run_dir / "points.csv", notes)
    fitted = (run_dir / "metrics.json").exists() or (run_dir / "models").exists()
    metrics = _json(run_dir / "metrics.json", notes) if fitted else {}
    held_out = read_held_out(run_dir, notes) if fitted else None
    duts = tuple(
        _dut(
            run_dir,
            name,
            points,
            metrics.get(name),
            held_out,
            load_model or load_saved_model,
            notes,
            manifest.points_planned,
        )
        for name in dict.fromkeys([*manifest.duts, *points["dut"]])
    )
    _note_unfitted(duts, notes)
    _note_unfinished(manifest, notes)
    return ReportData(
        run_dir=run_dir,
        manifest=manifest,
        duts=duts,
        timeline=_timeline(run_dir / "timeline.parquet", notes),
        sources=dict(_sources(run_dir)),
        notes=tuple(notes),
    )


def _json(path: Path, notes: list[str]) -> dict[str, Any]:
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        notes.append(f"{path.name} is missing: what it holds is not shown.")
    except (OSError, ValueError, RecursionError) as error:
        notes.append(f"{path.name} cannot be read ({fault(error, path)}): what it holds is not shown.")
    else:
        if isinstance(value, dict):
            return value
        notes.append(f"{path.name} is not a JSON object: what it holds is not shown.")
    return {}


def _points(path: Path, notes: list[str]) -> pd.DataFrame:
    try:
        points = pd.read_csv(path, dtype=dict.fromkeys(TEXT_COLUMNS, "str"), keep_default_na=False, na_values={"": ""})
    except FileNotFoundError:
        notes.append("points.csv is missing: no points are shown.")
        points = pd.DataFrame()
    except (OSError, ValueError) as error:
        notes.append(f"points.csv cannot be read ({fault(error, path)}): no points are shown.")
        points = pd.DataFrame()
    columns = {name: _numeric(points, name) for name in NUMBERS}
    texts = {name: _textual(points, name) for name in TEXT_COLUMNS}
    return pd.DataFrame({**columns, **texts})


def _numeric(points: pd.DataFrame, name: str) -> pd.Series[float]:
    if name not in points:
        return pd.Series(math.nan, index=points.index, dtype=float)
    return pd.to_numeric(points[name], errors="coerce").astype(float)


def _textual(points: pd.DataFrame, name: str) -> pd.Series[str]:
    if name not in points:
        return pd.Series("", index=points.index, dtype=object)
    return points[name].fillna("").astype(object)


def _dut(
    run_dir: Path,
    name: str,
    points: pd.DataFrame,
    metrics: Any,
    held_out: pd.DataFrame | None,
    load_model: ModelLoader,
    notes: list[str],
    points_planned: int | None,
) -> DutData:
    own = points[points["dut"] == name].reset_index(drop=True)
    own["error_dps"] = own["rate_mean_dps"] - own["rate_reference_dps"]
    own["dwell"] = _dwells(own)
    own["usable"] = np.isfinite(own["error_dps"]) & (own["verdict"] != "fail")
    own["residual_dps"] = math.nan
    models = run_dir / "models" / name
    dut = DutData(name, own, _figures_of_merit(metrics), *_best_model(_figures_of_merit(metrics), models))
    if own.empty and points_planned != 0:
        notes.append(f"{name}: no point was measured.")
    if own.empty or dut.model is None:
        return dut
    std_dps, saved = dut.figure(dut.model, HEADLINE_SPLIT, "std_dps"), models / f"{dut.model}.json"
    found = held_out_residuals(held_out, own, name, dut.model, std_dps, notes)
    if found and not saved.is_file():
        notes.append(f"models/{name}/{saved.name} is missing: its figures are shown, but nothing can be compensated.")
    found = found or saved_model_residuals(saved, own, load_model, notes)
    own["residual_dps"] = found.residual_dps
    return replace(dut, held_out=found.held_out)


def _dwells(own: pd.DataFrame) -> NDArray[np.int64]:
    """Dwells counted from 0 in the order measured; where the file has no numbers, by changes of chamber setpoint."""
    given = own["dwell"]
    changes = (own["chamber_setpoint_degc"].diff().fillna(0.0) != 0).cumsum()
    return np.asarray(pd.factorize(given if given.notna().all() else changes)[0], dtype=np.int64)


def _figures_of_merit(raw: Any) -> Metrics:
    """Model -> split -> quantity, leaving out what does not have this shape."""

    def inner(value: Any) -> dict[str, Any]:
        return value if isinstance(value, dict) else {}

    return {
        model: {split: inner(quantities) for split, quantities in inner(splits).items()}
        for model, splits in inner(raw).items()
    }


def _best_model(metrics: Metrics, folder: Path) -> tuple[str | None, str]:
    """The model with the lowest std, judged on temperatures it never saw if there is such a figure."""
    for split, words in ((HEADLINE_SPLIT, "leave-temperatures-out"), (HELD_BACK_SPLIT, "random-split")):
        scores = {
            model: splits[split]["std_dps"]
            for model, splits in metrics.items()
            if model != UNCOMPENSATED and isinstance(splits.get(split, {}).get("std_dps"), int | float)
        }
        if scores:
            return min(scores, key=lambda model: scores[model] or 0.0), f"lowest {words} std"
    saved = sorted(path.stem for path in folder.glob("*.json")) if folder.is_dir() else []
    return (saved[0], "the first saved model; metrics.json names no best one") if saved else (None, "")


def _timeline(path: Path, notes: list[str]) -> pd.DataFrame | None:
    try:
        timeline = pd.read_parquet(path).apply(pd.to_numeric, errors="coerce")
    except FileNotFoundError:
        notes.append("timeline.parquet is missing: the timeline is not shown.")
    except Exception as error:  # pyarrow raises several kinds; a damaged file must not cost the lab its report
        notes.append(f"timeline.parquet cannot be read ({fault(error, path)}): the timeline is not shown.")
    else:
        known = timeline[timeline["t_s"].notna()] if "t_s" in timeline else timeline.iloc[:0]
        if len(known) > 1:
            ordered: pd.DataFrame = known.sort_values("t_s", kind="stable").reset_index(drop=True)
            return ordered
        notes.append("timeline.parquet holds no time series: the timeline is not shown.")
    return None


def _sources(run_dir: Path) -> Iterator[tuple[str, str]]:
    for name in ("procedure.yaml", "bench.yaml"):
        path = run_dir / name
        if path.is_file():
            text = path.read_text(encoding="utf-8", errors="replace")
            cut = "\n… (cut; the whole file is in the run folder)" if len(text) > LARGEST_SOURCE_CHARACTERS else ""
            yield name, text[:LARGEST_SOURCE_CHARACTERS] + cut


def _note_unfitted(duts: Sequence[DutData], notes: list[str]) -> None:
    unfitted = [dut.name for dut in duts if dut.model is None and len(dut.points)]
    if unfitted and len(unfitted) == len(duts):
        notes.append("No model was fitted in this run, so nothing is compensated: the points are shown as measured.")
    else:
        notes += [f"{name}: no model was fitted, so nothing is compensated." for name in unfitted]
    if any(dut.model and len(dut.points) < FEW_POINTS for dut in duts):
        notes.append(f"Fewer than {FEW_POINTS} points were measured: figures of merit rest on very little.")


def _note_unfinished(manifest: Manifest, notes: list[str]) -> None:
    planned, measured = manifest.points_planned, manifest.points_measured
    if planned is not None and measured is not None and measured < planned:
        notes.insert(0, f"The run ended early: {measured} of {planned} planned points were measured.")
    if manifest.outcome == "UNKNOWN":
        notes.insert(0, "The run did not record an outcome: it may still be running, or it was cut off.")
