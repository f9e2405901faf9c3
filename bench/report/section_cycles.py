"""Thermal cycles: what each model leaves of the error, on what it learned from and on what it never saw."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from bench.report import figures as fig
from bench.report.data import ReportData
from bench.report.formats import MISSING, fault, significant
from bench.report.section import Section
from bench.report.tables import Cell, Column, Table, table
from bench.report.wording import model_name

DPH_PER_DPS = 3600.0
UNCOMPENSATED, TRAIN, UNSMOOTHED = "none", "train", "unsmoothed"

# What the papers print, in words; their gyros are not ours.
PUBLISHED = {
    "rlg": (
        "Published (Chinese J. Sci. Instrum. 34(4), 2013): three ring laser gyros; std in the first dwell 0.0052, "
        "0.0044 and 0.0056 °/h; over the cycle about 0.03 °/h uncompensated; after ε-SVR all three inside their "
        "nominal 0.01 °/h, about 75 % less; linear regression does not get there. The paper judges on the cycle it "
        "trained on.",
    ),
    "bp": (
        "Published (Beijing Information Sci. & Tech. Univ.): bias stability 0.011 °/h at room temperature, 0.09 °/h "
        "over the cycle uncompensated; CSAPSO-BP 70 % better than uncompensated and 15 % better than BP on the test "
        "cycle. The published swarm settings (inertia 0.8, both learning factors 2) lie beyond the stability bound "
        "c1 + c2 < 24(1 − ω²)/(7 − 5ω) = 2.88: 'csapso_published' keeps them, 'csapso_stable' does not.",
    ),
}
Figures = Mapping[str, Mapping[str, Mapping[str, Any]]]


def cycles(data: ReportData) -> Section | None:
    """The section; None if the run has no analysis of cycles."""
    path = data.run_dir / "analyses" / "cycles.json"
    if not path.is_file():
        return None
    remarks: list[str] = []
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        metrics: Mapping[str, Figures] = {str(dut): dict(models) for dut, models in found.items()}
    except (OSError, ValueError, AttributeError, TypeError, RecursionError) as error:
        text = f"analyses/cycles.json cannot be read ({fault(error, path)}): nothing of it is shown."
        return Section("cycles", "Thermal cycles", remarks=(text,))
    drawn = _figures(data, metrics, remarks)
    paragraph = (
        "Error is the output minus the true rate (the mean of the reference part), in averages as long as the "
        "procedure says. Every test but 'train' is of records, or of a half, that the model has not seen. Times floor: "
        "std over the noise floor, what white noise alone leaves in such averages. Guarded: rows outside what the "
        "model has learned from, where it falls back."
    )
    tables = [made for dut, models in metrics.items() for made in (_table(dut, models), _measures(dut, models))]
    unsmoothed = [dut for dut, models in metrics.items() if UNSMOOTHED in models.get(UNCOMPENSATED, {})]
    if unsmoothed:
        tables.append(_unsmoothed({dut: metrics[dut] for dut in unsmoothed}))
    remarks += _warnings(data)
    remarks += PUBLISHED.get(data.manifest.procedure.experiment or "", ())
    return Section("cycles", "Thermal cycles", (paragraph,), tuple(tables), tuple(drawn), tuple(remarks))


def _warnings(data: ReportData) -> list[str]:
    """What fits warned of, once for each model."""
    try:
        found = json.loads((data.run_dir / "analyses" / "cycles_warnings.json").read_text(encoding="utf-8"))
        pairs = [(name, text) for models in found.values() for name, texts in models.items() for text in texts]
    except (OSError, ValueError, AttributeError, TypeError, RecursionError):
        return []
    return [f"{model_name(str(name))} warned: {text}" for name, text in dict.fromkeys(pairs)]


def _table(dut: str, models: Figures) -> Table:
    tests = list(dict.fromkeys(test for by in models.values() for test in by if test != UNSMOOTHED))
    columns = [Column("Model", False)]
    groups = [("", 1)]
    for test in tests:
        columns += [Column("std, °/h"), Column("× floor")]
        groups.append((test.replace("_", " "), 2))
    columns += [Column("Better, %"), Column("Guarded, %"), Column("Fit, ms")]
    first = next((test for test in tests if test != TRAIN), TRAIN)
    groups += [(f"on {first.replace('_', ' ')}", 2), ("", 1)]
    raw = models.get(UNCOMPENSATED, {}).get(first, {}).get("std_dps")
    rows = [_row(model, by, tests, first, raw) for model, by in models.items()]
    caption = f"DUT {dut}: what each model leaves. Better: than not compensated."
    return table(caption, columns, rows, groups)


def _measures(dut: str, models: Figures) -> Table:
    """The measures of the papers, on the first test."""
    tests = [test for test in models.get(UNCOMPENSATED, {}) if test not in (TRAIN, UNSMOOTHED)] or [TRAIN]
    columns = [Column("Model", False), Column("Bias stability, °/h"), Column("MAE, °/h"), Column("MSE, (°/h)²")]
    columns += [Column("Largest, °/h")]
    rows: list[list[str | Cell]] = []
    for name, by in models.items():
        one = by.get(tests[0], {})
        mse = one.get("mse_dps2")
        squared = MISSING if mse is None else significant(mse * DPH_PER_DPS**2)
        rows.append([model_name(name), _dph(one.get("bias_stability_dps")), _dph(one.get("mae_dps")), squared])
        rows[-1].append(_dph(one.get("max_abs_dps")))
    caption = (
        f"DUT {dut}, test '{tests[0].replace('_', ' ')}'. Bias stability: standard deviation (n − 1) of averages that "
        "do not overlap, as GJB 2426A defines it; it is not the bias instability of an Allan curve."
    )
    return table(caption, columns, rows)


def _unsmoothed(metrics: Mapping[str, Figures]) -> Table:
    """The models on what was not averaged: spread of single rows or frames, and how much of it they took away."""
    names = list(dict.fromkeys(model for models in metrics.values() for model in models))
    columns = [Column("Model", False)]
    columns += [Column(text) for dut in metrics for text in (f"{dut}, std °/h", "taken off, °/h")]
    rows: list[list[str | Cell]] = []
    for name in names:
        row: list[str | Cell] = [model_name(name)]
        for models in metrics.values():
            row += _taken_off(
                *(models.get(key, {}).get(UNSMOOTHED, {}).get("std_dps") for key in (UNCOMPENSATED, name))
            )
        rows.append(row)
    one = next(iter(metrics.values()))[UNCOMPENSATED][UNSMOOTHED]
    caption = (
        f"The same models applied to the unsmoothed output, {one['rate_hz']:g} Hz, of the first record not seen. The "
        "noise of a single frame is most of its std; taken off is the root of the difference of the squares."
    )
    return table(caption, columns, rows)


def _taken_off(before: float | None, after: float | None) -> list[str]:
    """What is left, and the root of the difference of the squares, negative if there is more than before."""
    if before is None or after is None:
        return [_dph(after), MISSING]
    return [_dph(after), _dph(math.copysign(abs(before**2 - after**2) ** 0.5, before - after))]


def _row(
    model: str, by: Mapping[str, Mapping[str, Any]], tests: list[str], first: str, raw: float | None
) -> list[str | Cell]:
    row: list[str | Cell] = [model_name(model)]
    for test in tests:
        one = by.get(test, {})
        std, floor = one.get("std_dps"), one.get("floor_dps")
        row += [_dph(std), f"{std / floor:.2f}" if std is not None and floor else MISSING]
    one = by.get(first, {})
    std = one.get("std_dps")
    better = MISSING if model == UNCOMPENSATED or not raw or std is None else f"{100 * (1 - std / raw):.1f}"
    guarded, fit_s = one.get("guarded"), by.get(TRAIN, {}).get("fit_s")
    row += [better, MISSING if guarded is None else f"{100 * guarded:.1f}"]
    return [*row, MISSING if fit_s is None else significant(1e3 * fit_s, 3)]


def _dph(value: float | None) -> str:
    return MISSING if value is None else significant(value * DPH_PER_DPS)


def _figures(data: ReportData, metrics: Mapping[str, Figures], remarks: list[str]) -> list[fig.Figure]:
    path = data.run_dir / "analyses" / "cycles.parquet"
    try:
        rows = pd.read_parquet(path)
    except Exception as error:
        remarks.append(f"analyses/cycles.parquet cannot be read ({fault(error, path)}): nothing is drawn.")
        return []
    drawn = []
    for number, (dut, models) in enumerate(metrics.items()):
        tests = [test for test in models.get(UNCOMPENSATED, {}) if test not in (TRAIN, UNSMOOTHED)]
        if tests:
            drawn.append(_figure(rows[(rows["dut"] == dut) & (rows["split"] == tests[0])], dut, tests[0], number))
    return drawn


def _figure(rows: pd.DataFrame, dut: str, test: str, number: int) -> fig.Figure:
    """Error as measured, and what each model leaves of it, against time."""
    drawn = fig.canvas(fig.WIDE)
    height = fig.WIDE[1]
    above = fig.axes_at(drawn, 74, height - 240, 14, 34)
    below = fig.axes_at(drawn, 74, 46, 14, 268)
    last_s = float(rows["t_s"].max())
    unit_s = fig.time_axis(above, last_s)
    fig.time_axis(below, last_s, label="time since the record began")
    above.set_xlabel("")
    above.tick_params(labelbottom=False)
    raw = rows[rows["model"] == UNCOMPENSATED]
    above.plot(raw["t_s"] / unit_s, raw["error_dps"] * DPH_PER_DPS, color=fig.INK, label="as measured", linewidth=1.0)
    left = rows[rows["model"] != UNCOMPENSATED]
    for k, (model, one) in enumerate(left.groupby("model", sort=False)):
        t = one["t_s"].to_numpy(dtype=float) / unit_s
        colour = fig.dut_colour(k)
        predicted = (one["error_dps"] - one["residual_dps"]).to_numpy(dtype=float)
        above.plot(t, predicted * DPH_PER_DPS, color=colour, label=model_name(str(model)), linewidth=1.2)
        residual = one["residual_dps"].to_numpy(dtype=float)
        below.plot(t, residual * DPH_PER_DPS, color=colour, label=model_name(str(model)), linewidth=0.9)
    spread = float(np.percentile(np.abs(left["residual_dps"]), 99)) * DPH_PER_DPS if len(left) else 1.0
    below.set_ylim(-1.3 * spread, 1.3 * spread)
    above.set_ylabel("error (°/h)")
    below.set_ylabel("residual (°/h)")
    fig.legend_above(above)
    alt = f"DUT {dut}: error over the test {test} with each model's prediction above, what each leaves below."
    caption = (
        f"DUT {dut}, test '{test.replace('_', ' ')}'. Above: the error as measured and as each model predicts it. "
        "Below: what each leaves, the axis as wide as 99 % of all residuals."
    )
    return fig.finish(drawn, f"cycles{number}", alt, caption)
