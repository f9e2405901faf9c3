"""Points to compensation models, their metrics and a judgement of the limits."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd

from bench.analyses.context import Analysed, Context, Judged
from bench.clock import stopwatch
from bench.errors import UserMistake, did_you_mean
from bench.points import usable, write_table
from bench.procedure.analyses import Analysis
from fitting.modelfile import ModelFileError, save_model
from fitting.splits import SplitPlan
from fitting.validation import UNCOMPENSATED, Evaluation, evaluate

INPUT_COLUMNS = {
    "dut_temperature": "dut_temperature_degc",
    "chamber_temperature": "chamber_readback_degc",
    "rate": "rate_mean_dps",
}


def model_factories(names: Sequence[str]) -> dict[str, Any]:
    """Model names to estimator factories. Raises UserMistake for an unknown name."""
    known = {item.name: item for item in entry_points(group="fogbench.models")}
    for name in names:
        if name not in known:
            raise UserMistake(f"unknown model '{name}'.{did_you_mean(name, known)}")
    return {name: known[name].load() for name in names}


def analyse(context: Context) -> Analysed:
    """Fit every model to every DUT's points; write their models and held-out errors into the run folder.

    If models are named that the procedure does not ask for, figures of models fitted before stay beside the new ones.
    Without an `analysis` block, and no model named, nothing is done.
    """
    asked = context.head.analysis
    analysis = _wanted(asked, context.models)
    if analysis is None:
        return Analysed()
    folder, notes = context.folder, []
    metrics, residuals = _kept(folder, analysis.models) if context.models else ({}, [])
    for dut in context.duts:
        table = usable(context.points, dut)
        try:
            evaluation = _evaluate(table, analysis)
        except ValueError as error:
            notes.append(f"{dut}: no fit: {error}")
            continue
        metrics[dut] = metrics.get(dut, {}) | evaluation.metrics
        notes += [f"{dut}: {reason}" for reason in dict.fromkeys(evaluation.unavailable.values())]
        residuals.append(_residuals(evaluation, table, dut))
        about = {"run_id": context.run_id, "dut": dut, "inputs": list(analysis.inputs)}
        notes += [f"{dut}: {failure}" for failure in _save_models(folder / "models" / dut, evaluation, about)]
    if residuals:
        write_table(folder / "residuals.parquet", pd.concat(residuals, ignore_index=True))
    judged = judge_limits(asked, metrics, context.duts) if asked else []
    return Analysed(metrics, judged, notes, counts=asked is not None)


def _wanted(analysis: Analysis | None, models: Sequence[str]) -> Analysis | None:
    """What to fit now: the procedure's models, or those named with everything else as the procedure has it."""
    if not models:
        return analysis
    if analysis is None:
        return Analysis.model_validate({"models": list(models)})
    return analysis.model_copy(update={"models": list(models)})


def _kept(folder: Path, fitted_again: Sequence[str]) -> tuple[dict[str, Any], list[pd.DataFrame]]:
    """Metrics and residuals of the models that are not fitted again now."""
    try:
        metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        residuals = pd.read_parquet(folder / "residuals.parquet")
    except (OSError, ValueError, RecursionError):
        return {}, []
    return metrics, [residuals[~residuals["model"].isin([*fitted_again, UNCOMPENSATED])]]


def _evaluate(table: pd.DataFrame, analysis: Analysis) -> Evaluation:
    random, held_out = analysis.splits.random, analysis.splits.leave_temperatures_out
    return evaluate(
        model_factories(analysis.models),
        table[[INPUT_COLUMNS[name] for name in analysis.inputs]].to_numpy(dtype=np.float64),
        table["rate_reference_dps"].to_numpy(dtype=np.float64),
        u=table["rate_mean_u_dps"].to_numpy(dtype=np.float64),
        # A temperature that is visited twice is left out whole.
        groups=pd.factorize(table["chamber_setpoint_degc"])[0],
        splits=SplitPlan(random.share, random.train, random.seed, held_out.folds),
        seed=analysis.seed,
        timer=stopwatch,
    )


def _residuals(evaluation: Evaluation, table: pd.DataFrame, dut: str) -> pd.DataFrame:
    """Every held-back or trained error with the point it belongs to: point, dut, model, split, predicted, residual."""
    residuals = evaluation.residuals
    points = table["point"].to_numpy()[residuals["row"].to_numpy(dtype=np.intp)]
    return residuals.drop(columns="row").assign(point=points, dut=dut)


def _save_models(folder: Path, evaluation: Evaluation, meta: dict[str, Any]) -> list[ModelFileError]:
    """Save what was fitted; a model of a kind that has no file format is reported and costs the others nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    failures: list[ModelFileError] = []
    for name, estimator in evaluation.fitted.items():
        figures = {split: dict(values) for split, values in evaluation.metrics[name].items()}
        try:
            save_model(folder / f"{name}.json", cast(Any, estimator), {**meta, "model": name}, figures)
        except ModelFileError as error:
            failures.append(error)
    return failures


def judge_limits(analysis: Analysis, metrics: dict[str, Any], duts: Sequence[str]) -> list[Judged]:
    """Hold the limits of the procedure against the metrics of every DUT."""
    judged = []
    for limit in analysis.limits:
        for quantity in ("max_abs_dps", "std_dps"):
            value = getattr(limit, quantity)
            if value is not None:
                measured = {dut: _figure(metrics, dut, limit.model, limit.split, quantity) for dut in duts}
                judged.append(Judged(limit.model, limit.split, quantity, value, measured))
    return judged


def _figure(metrics: dict[str, Any], *path: str) -> float | None:
    value: Any = metrics
    for part in path:
        value = value.get(part) if isinstance(value, dict) else None
    return value if isinstance(value, float) and np.isfinite(value) else None
