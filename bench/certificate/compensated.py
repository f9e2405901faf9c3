"""The uncertainty of every compensated figure of a model: one budget for each point it was judged on."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.analyses.models import INPUT_COLUMNS
from bench.errors import UserMistake, did_you_mean
from bench.points import usable
from bench.procedure.calibration import BenchUncertainty
from bench.series import Floats
from fitting.earth import EARTH_RATE_DPH
from fitting.modelfile import load_model
from fitting.random_errors.mean import NoiseOfMean
from fitting.uncertainty import Budget, BudgetRow, RateConditions, combine, compensated_rate_budget

if TYPE_CHECKING:
    import pandas as pd

# The split whose residuals stand for what the model does to a temperature it has not seen, and what may take its place.
SPLITS = ("leave_temperatures_out", "random")
DPH_PER_DPS = 3600.0


@dataclass(frozen=True)
class CompensatedPoint:
    """One point: where it is, what the model leaves of its error, and the budget of that; deg/h."""

    setpoint_degc: float | None
    temperature_degc: float
    rate_dps: float
    error_dph: float
    budget: Budget


@dataclass(frozen=True)
class Compensated:
    """A model on the points of one DUT. residual_dps: std of its error in `split`; rows: how many errors that is of."""

    model: str
    split: str
    residual_dps: float
    rows: int
    points: Sequence[CompensatedPoint]

    @property
    def worst(self) -> CompensatedPoint:
        """The point of the largest uncertainty."""
        return max(self.points, key=lambda one: one.budget.expanded_dph)


def compensated(
    folder: Path, points: pd.DataFrame, dut: str, model: str, bench: BenchUncertainty, latitude_deg: float | None
) -> Compensated:
    """The budget of every point of a DUT. Raises UserMistake if the run has no such model, or what loading it does."""
    path = folder / "models" / dut / f"{model}.json"
    there = sorted(one.stem for one in path.parent.glob("*.json"))
    if not path.is_file():
        raise UserMistake(f"{folder}: no model '{model}' of {dut}.{did_you_mean(model, there)}")
    loaded = load_model(path)
    columns = [INPUT_COLUMNS[name] for name in loaded.document["meta"]["inputs"]]
    table = usable(points, dut)
    split, std_dps, rows = _residual(folder, dut, model)

    def predict(X: Floats) -> Floats:
        return loaded.predict(X[:, 0], X[:, 1])

    made = []
    for row in table.to_dict("records"):
        inputs = float(row[columns[0]]), float(row[columns[1]])
        budget = compensated_rate_budget(predict, _conditions(row, inputs, bench, latitude_deg, (std_dps, rows)))
        budget = _without_latitude(budget) if latitude_deg is None else budget
        error = float(predict(np.array([inputs]))[0]) - float(row["rate_reference_dps"])
        setpoint = row["chamber_setpoint_degc"]
        asked = float(setpoint) if np.isfinite(setpoint) else None
        made.append(CompensatedPoint(asked, inputs[0], float(row["rate_setpoint_dps"]), error * DPH_PER_DPS, budget))
    if not made:
        raise UserMistake(f"{folder}: no point of {dut} can be used, so there is no compensated figure")
    return Compensated(model, split, std_dps, rows, made)


def _residual(folder: Path, dut: str, model: str) -> tuple[str, float, int]:
    """Split, standard deviation and number of the errors of the model on what it did not learn from."""
    try:
        metrics: Mapping[str, Any] = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        figures = metrics[dut][model]
        split = next(name for name in SPLITS if name in figures)
        return split, float(figures[split]["std_dps"]), int(figures[split]["n"])
    except (OSError, ValueError, KeyError, TypeError, StopIteration) as error:
        raise UserMistake(
            f"{folder}/metrics.json has no error of '{model}' on held-back points of {dut} ({error!r}), which the "
            f"budget needs. Make it: fogbench fit {folder} --model {model}"
        ) from error


def _conditions(
    row: Mapping[Any, Any],
    inputs: tuple[float, float],
    bench: BenchUncertainty,
    latitude_deg: float | None,
    residual: tuple[float, int],
) -> RateConditions:
    u_dph = float(row["rate_mean_u_dps"]) * DPH_PER_DPS
    dof = max(float(np.sqrt(row["samples"])) - 1.0, 1.0)  # of the batch means that u comes from
    return RateConditions(
        inputs[0],
        inputs[1],
        float(row["rate_setpoint_dps"]),
        NoiseOfMean(u_dph, dof, u_dph),
        bench.table_ppm,
        bench.temperature_k,
        0.0 if latitude_deg is None else latitude_deg,
        bench.latitude_deg,
        60.0 * bench.tilt_deg,
        residual[0],
        float(max(residual[1] - 1, 1)),
    )


def _without_latitude(budget: Budget) -> Budget:
    """Where the bench states no latitude the earth's rotation was not taken off, and is anything up to all of it."""
    rows = [row for row in budget.rows if not row.source.startswith("earth rate")]
    earth = BudgetRow("earth rate: latitude not stated", "B", "rectangular", EARTH_RATE_DPH, "deg/h", 1.0)
    return combine([*rows, earth], budget.coverage)


def by_temperature(found: Compensated) -> list[CompensatedPoint]:
    """Of every chamber setpoint the point of the largest uncertainty, cold to warm."""
    worst: dict[float, CompensatedPoint] = {}
    for one in found.points:
        key = one.temperature_degc if one.setpoint_degc is None else one.setpoint_degc
        if key not in worst or one.budget.expanded_dph > worst[key].budget.expanded_dph:
            worst[key] = one
    return [worst[key] for key in sorted(worst)]
