"""The error that is left after compensation: of held-out predictions where the run has them, else of the saved model.

residuals.parquet has one row per point, DUT, model and split: `predicted_dps`, `residual_dps` (predicted minus
reference). The rows of leave_temperatures_out predict each point once, by a model that never saw its dwell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report.formats import fault

HEADLINE_SPLIT = "leave_temperatures_out"
FILE = "residuals.parquet"
NUMBERS = ("point", "predicted_dps", "residual_dps")
TEXTS = ("dut", "model", "split")
# Both sides are rounded to 1e-10 deg/s in points.csv; a figure of metrics.json is the same sum in another order.
REFERENCE_TOLERANCE_DPS = 1e-6
STD_TOLERANCE = 1e-6

Floats = NDArray[np.float64]


class Compensation(Protocol):
    """What a saved model does: temperature (n,) degC and gyro output (n,) deg/s to the compensated rate (n,) deg/s."""

    def predict(self, temperature_degc: Floats, rate_dps: Floats) -> Floats: ...


ModelLoader = Callable[[Path], Compensation]


@dataclass(frozen=True)
class Residuals:
    """`residual_dps` (n,) of a DUT's points, NaN where there is none; `held_out`: no model saw its own dwell."""

    residual_dps: Floats
    held_out: bool = False


def load_saved_model(path: Path) -> Compensation:
    """The default loader: fitting.modelfile.load_model, imported on use."""
    from fitting.modelfile import load_model

    loaded: Compensation = load_model(path)
    return loaded


def read_held_out(run_dir: Path, notes: list[str]) -> pd.DataFrame | None:
    """The leave-temperatures-out rows of residuals.parquet; None, with a note unless the file is missing."""
    path = run_dir / FILE
    if not path.exists():
        return None
    try:
        table = pd.read_parquet(path)
        missing = [name for name in (*NUMBERS, *TEXTS) if name not in table]
        if missing:
            raise ValueError(f"it has no column {', '.join(missing)}")
        numbers = {name: pd.to_numeric(table[name], errors="coerce").astype(float) for name in NUMBERS}
        rows = pd.DataFrame({**numbers, **{name: table[name].astype(str) for name in TEXTS}})
    except Exception as error:  # pyarrow raises several kinds; a damaged file must not cost the lab its report
        notes.append(
            f"{FILE} cannot be used ({fault(error, path)}): the residuals shown are of the model fitted on all points."
        )
        return None
    return rows[rows["split"] == HEADLINE_SPLIT]


def held_out_residuals(
    table: pd.DataFrame | None, points: pd.DataFrame, dut: str, model: str, std_dps: float | None, notes: list[str]
) -> Residuals | None:
    """The held-out residuals of one DUT and model; None if there are none, or (noted) if they are of another run.

    points: the DUT's rows of points.csv. std_dps: what metrics.json says of the same errors, None if it does not.
    """
    if table is None:
        return None
    rows = table[(table["dut"] == dut) & (table["model"] == model)]
    if rows.empty:
        return None
    foreign = _foreign(rows, points, std_dps)
    if foreign:
        notes.append(
            f"{dut}: {FILE} does not belong to this run ({foreign}): the residuals shown are of the model fitted on "
            "all points. 'fogbench fit' writes the file again."
        )
        return None
    by_point = pd.Series(rows["residual_dps"].to_numpy(), index=rows["point"].to_numpy())
    return Residuals(points["point"].map(by_point).to_numpy(dtype=float), held_out=True)


def _foreign(rows: pd.DataFrame, points: pd.DataFrame, std_dps: float | None) -> str:
    """Why these rows cannot be of these points and figures of merit; empty if they agree."""
    if not np.isfinite(rows[list(NUMBERS)].to_numpy()).all():
        return "it holds values that are no numbers"
    if rows["point"].duplicated().any() or points["point"].duplicated().any():
        return "a point occurs twice"
    joined = rows.merge(points[["point", "rate_reference_dps"]], on="point")
    if len(joined) < len(rows):
        return "it has points that points.csv lacks"
    reference = joined["predicted_dps"] - joined["residual_dps"]
    if not (abs(reference - joined["rate_reference_dps"]) <= REFERENCE_TOLERANCE_DPS).all():
        return "its reference rates differ from those of points.csv"
    if std_dps is not None and not math.isclose(float(np.std(rows["residual_dps"])), std_dps, rel_tol=STD_TOLERANCE):
        return "its standard deviation differs from that of metrics.json"
    return ""


def saved_model_residuals(path: Path, points: pd.DataFrame, load_model: ModelLoader, notes: list[str]) -> Residuals:
    """The residuals of the model saved in `path`, which was fitted on all points; noted if it cannot be used."""
    temperature = points["dut_temperature_degc"].to_numpy(dtype=float)
    rate = points["rate_mean_dps"].to_numpy(dtype=float)
    known = np.isfinite(temperature) & np.isfinite(rate)
    residual = np.full(len(points), math.nan)
    try:
        predicted = load_model(path).predict(temperature[known], rate[known])
    except Exception as error:  # a damaged or foreign model file must not cost the lab its report
        notes.append(f"models/{path.parent.name}/{path.name} cannot be used: {fault(error, path)}")
        return Residuals(residual)
    residual[known] = predicted - points["rate_reference_dps"].to_numpy(dtype=float)[known]
    return Residuals(residual)
