"""Thermal cycles after the run: records to rows of error and temperatures, to models judged on what they never saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analyses.context import Analysed, Context, Judged, Metrics
from bench.analyses.unsmoothed import unsmoothed
from bench.clock import stopwatch
from bench.errors import UserMistake, did_you_mean
from bench.points import write_table
from bench.procedure.analyses import CYCLE_MODELS, CycleAnalysis
from bench.rawstore import RawFileDamaged
from bench.series import Columns, SeriesIncomplete, read_parts
from fitting.judging import Candidate, Judgement, Part, judge
from fitting.modelfile import ModelFileError, save_model
from fitting.modelfiles.columns import BIAS_ERROR_DPS
from fitting.validation import ValidationError

FOLDER, ROWS, MODELS = "analyses", "cycles.parquet", "models"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CycleRows:
    """Averaged rows of one record of one DUT: time since it began, temperatures (n, k), rate, its white-noise u."""

    label: str
    t_s: Floats
    temperatures_degc: Floats
    rate_dps: Floats
    u_dps: Floats


def averaged(series: Columns, label: str, started_at_s: float, names: Sequence[str], rows: int) -> CycleRows:
    """Means of blocks of `rows` rows of a series; blocks with a gap, and what is left at the end, are dropped.

    The uncertainty of a mean is that of its white noise, from differences of neighbouring rows, so that drift within
    the block is not taken for noise. Raises UserMistake for a temperature the series does not have.
    """
    columns = [_temperature(series, name, label) for name in names]
    count = len(series["t_s"]) // rows
    blocks = {name: np.asarray(series[name])[: count * rows].reshape(count, rows) for name in ("t_s", "rate_dps")}
    temperatures = np.stack([column[: count * rows].reshape(count, rows).mean(axis=1) for column in columns], axis=1)
    rate = blocks["rate_dps"]
    whole = np.isfinite(rate).all(axis=1) & np.isfinite(temperatures).all(axis=1)
    steps = np.diff(rate[whole], axis=1)
    sigma = np.sqrt(np.mean(steps**2) / 2.0) if steps.size else float(np.nan)
    return CycleRows(
        label,
        blocks["t_s"][whole].mean(axis=1) - started_at_s,
        temperatures[whole],
        rate[whole].mean(axis=1),
        np.full(int(whole.sum()), sigma / np.sqrt(rows)),
    )


def _temperature(series: Columns, name: str, label: str) -> Floats:
    column = name if name.endswith("_degc") else f"{name}_degc"
    if column not in series:
        known = [other.removesuffix("_degc") for other in series if other.endswith("_degc")]
        hint = did_you_mean(name, known)
        raise UserMistake(f"cycles: record '{label}' has no temperature '{name}'. It has: {', '.join(known)}.{hint}")
    return np.asarray(series[column], dtype=np.float64)


def cycle_models(names: Sequence[str]) -> dict[str, Any]:
    """Model names to `fitting.cycle_models.CycleModel`s. Raises UserMistake for an unknown name."""
    known = {item.name: item for item in entry_points(group=CYCLE_MODELS)}
    for name in names:
        if name not in known:
            raise UserMistake(f"unknown cycle model '{name}'.{did_you_mean(name, known)}")
    return {name: known[name].load()() for name in names}


@dataclass(frozen=True)
class CycleResult:
    """The judgement of one DUT; for each of its rows the record and the time since that began; the models' inputs."""

    judgement: Judgement
    truth_dps: float
    labels: NDArray[np.str_]
    t_s: Floats
    error_dps: Floats
    inputs: Mapping[str, Floats]


def analyse_dut(folder: Path, finished: Sequence[Mapping[str, Any]], dut: str, spec: CycleAnalysis) -> CycleResult:
    """Rows, error and models of one DUT. Raises UserMistake, ValidationError, or what reading the parts raises."""
    records = _records(folder, finished, dut, spec)
    order = np.concatenate([np.full(len(one.t_s), k) for k, one in enumerate(records.values())])
    truth_dps = _truth(records, spec)
    error = np.concatenate([one.rate_dps for one in records.values()]) - truth_dps
    u = np.concatenate([one.u_dps for one in records.values()])
    candidates = {
        name: Candidate(
            model.make,
            np.vstack([model.features(one.temperatures_degc, spec.average_s) for one in records.values()]),
            model.grouped,
        )
        for name, model in cycle_models(spec.models).items()
    }
    labels = np.concatenate([np.full(len(one.t_s), label) for label, one in records.items()])
    t_s = np.concatenate([one.t_s for one in records.values()])
    judgement = judge(candidates, error, u, _parts(labels, t_s, spec), order, spec.seed, stopwatch)
    inputs = {name: candidate.inputs for name, candidate in candidates.items()}
    return CycleResult(judgement, truth_dps, labels, t_s, error, inputs)


def _records(
    folder: Path, finished: Sequence[Mapping[str, Any]], dut: str, spec: CycleAnalysis
) -> dict[str, CycleRows]:
    """The averaged rows of every record the analysis names, by label."""
    mine = {str(about["label"]): about for about in finished if about["dut"] == dut}
    records = {}
    for label in labels_of(spec):
        if label not in mine:
            raise ValidationError(f"record '{label}' was not made")
        about = mine[label]
        if about["verdict"] == "fail":
            raise ValidationError(f"record '{label}' failed its quality limits: {about['reasons']}")
        rows = max(1, round(spec.average_s / about["every_s"]))
        series = read_parts(folder, about)
        records[label] = averaged(series, label, about["started_at_s"], spec.temperatures, rows)
    return records


def labels_of(spec: CycleAnalysis) -> list[str]:
    """Labels of the records an analysis names."""
    named = [*spec.train, *(label for labels in spec.tests.values() for label in labels)]
    named += [half.record for half in spec.halves.values()]
    return list(dict.fromkeys([*named, *([spec.reference.record] if spec.reference else [])]))


def _truth(records: Mapping[str, CycleRows], spec: CycleAnalysis) -> float:
    """The true rate: the mean output of the settled part, or, without one, of the first record to learn from."""
    if spec.reference is None:
        return float(records[spec.train[0]].rate_dps.mean())
    one = records[spec.reference.record]
    inside = (one.t_s >= spec.reference.from_s) & (one.t_s <= spec.reference.to_s)
    if not inside.any():
        raise ValidationError(f"the reference part of record '{one.label}' holds no row")
    return float(one.rate_dps[inside].mean())


def _parts(labels: NDArray[np.str_], t_s: Floats, spec: CycleAnalysis) -> list[Part]:
    """What is learned from and judged: the records to train on, then each record cut in two."""
    tests = {name: np.isin(labels, named) for name, named in spec.tests.items()}
    parts = [Part(np.isin(labels, spec.train), tests)]
    for name, half in spec.halves.items():
        mine = labels == half.record
        parts.append(Part(mine & (t_s < half.at_s), {name: mine & (t_s >= half.at_s)}))
    return parts


def analyse(context: Context) -> Analysed:
    """Fit and judge the cycle models of every DUT; nothing without a `cycles` block."""
    spec = context.head.cycles
    if spec is None:
        return Analysed()
    metrics: Metrics = {}
    said: dict[str, Any] = {}
    notes: list[str] = []
    kept: list[pd.DataFrame] = []
    for dut in context.duts:
        try:
            result = analyse_dut(context.recorded, context.series, dut, spec)
        except (ValidationError, SeriesIncomplete, RawFileDamaged, OSError) as error:
            notes.append(f"{dut}: no fit: {error}")
            continue
        metrics[dut] = dict(result.judgement.metrics)
        said[dut] = result.judgement.warnings
        _add_unsmoothed(context, dut, spec, result, metrics[dut])
        kept.append(_rows(result, dut))
        notes += _save_models(context, dut, spec, result)
    if kept:
        (context.folder / FOLDER).mkdir(exist_ok=True)
        write_table(context.folder / FOLDER / ROWS, pd.concat(kept, ignore_index=True))
    judged = judge_limits(spec, metrics, context.duts)
    return Analysed(judged=judged, notes=notes, documents={"cycles": metrics, "cycles_warnings": said})


def _save_models(context: Context, dut: str, spec: CycleAnalysis, result: CycleResult) -> list[str]:
    """Write the fitted models; a model of a kind that has no file format is named and costs the others nothing."""
    folder = context.folder / FOLDER / MODELS / dut
    folder.mkdir(parents=True, exist_ok=True)
    failures = []
    for name, model in cycle_models(spec.models).items():
        figures = {test: dict(values) for test, values in result.judgement.metrics[name].items()}
        about = {"run_id": context.run_id, "dut": dut, "model": name, "average_s": spec.average_s}
        columns, fitted = model.inputs(spec.temperatures), result.judgement.fitted[name]
        try:
            save_model(folder / f"{name}.json", fitted, about, figures, inputs=columns, output=BIAS_ERROR_DPS)
        except ModelFileError as error:
            failures.append(f"{dut}: {error}")
    return failures


def _add_unsmoothed(
    context: Context, dut: str, spec: CycleAnalysis, result: CycleResult, metrics: dict[str, Any]
) -> None:
    """The same models on every frame of the first record they have not seen, as test 'unsmoothed'."""
    unseen = [labels[0] for labels in spec.tests.values()]
    about = next((one for one in context.series if one["dut"] == dut and one["label"] in unseen[:1]), None)
    if about is None:
        return
    fitted = result.judgement.fitted
    models = {name: (model, fitted[name]) for name, model in cycle_models(spec.models).items()}
    names = [name if name.endswith("_degc") else f"{name}_degc" for name in spec.temperatures]
    for name, figures in unsmoothed(context.recorded, about, names, result.truth_dps, models).items():
        metrics[name]["unsmoothed"] = figures


def _rows(result: CycleResult, dut: str) -> pd.DataFrame:
    """Every judged row: dut, model, split, label, t_s, error_dps, predicted_dps, residual_dps."""
    table = result.judgement.residuals
    at = table["row"].to_numpy()
    about = {"dut": dut, "label": result.labels[at], "t_s": result.t_s[at], "error_dps": result.error_dps[at]}
    return table.drop(columns="row").assign(**about)


def judge_limits(spec: CycleAnalysis, metrics: Metrics, duts: Sequence[str]) -> list[Judged]:
    """Hold the limits of the procedure against the figures of every DUT; `times_floor` is of the std."""
    judged = []
    for limit in spec.limits:
        figures = {dut: metrics.get(dut, {}).get(limit.model, {}).get(limit.test, {}) for dut in duts}
        for quantity in ("max_abs_dps", "std_dps", "times_floor"):
            value = getattr(limit, quantity)
            if value is not None:
                measured = {dut: _figure(figures[dut], quantity) for dut in duts}
                judged.append(Judged(limit.model, limit.test, quantity, value, measured))
    return judged


def _figure(figures: Mapping[str, Any], quantity: str) -> float | None:
    if quantity != "times_floor":
        return figures.get(quantity)
    std_dps, floor_dps = figures.get("std_dps"), figures.get("floor_dps")
    return std_dps / floor_dps if std_dps is not None and floor_dps else None
