"""North seeking after the run: heading in two and four positions, before and after the filter, against the survey."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analyses.context import Analysed, Context, Judged
from bench.points import write_table
from bench.procedure.analyses import SEEKING_POSITIONS_DEG, NorthAnalysis
from bench.rawstore import RawFileDamaged
from bench.series import SeriesIncomplete, read_parts
from fitting.metrics.bias import block_means
from fitting.north import (
    Level,
    Smoothing,
    SmoothingComparison,
    compare_smoothing,
    four_position_heading_deg,
    heading_error_mil,
)
from fitting.random_errors.allan import AllanCurve, allan_curve
from fitting.random_errors.allan_fit import fit_allan
from fitting.random_errors.autoregression import fit_ar2
from fitting.random_errors.kalman import SmoothingModel, smooth

Floats = NDArray[np.float64]

FOLDER, ROWS, CURVES = "analyses", "north.parquet", "north_allan.parquet"
# Column of a series -> factor to the unit used here: deg/h and g.
SENSORS = {"rate_dps": 3600.0, "rate_y_dps": 3600.0, "accel_x_g": 1.0, "accel_y_g": 1.0}
DRAWS = 200


class NotSought(ValueError):
    """North cannot be computed from what was recorded; the message says why."""


@dataclass(frozen=True)
class Sought:
    """What was found for one DUT."""

    document: dict[str, Any]
    rows: pd.DataFrame
    curves: pd.DataFrame
    worst_mil: float


def analyse(context: Context) -> Analysed:
    """Seek north from the records of every DUT; nothing without a `north` block."""
    spec = context.head.north
    if spec is None:
        return Analysed()
    document: dict[str, Any] = {}
    notes: list[str] = []
    tables: dict[str, list[pd.DataFrame]] = {ROWS: [], CURVES: []}
    worst: dict[str, float | None] = dict.fromkeys(context.duts)
    for dut in context.duts:
        try:
            found = _seek(context, dut, spec)
        except (ValueError, SeriesIncomplete, RawFileDamaged, OSError) as error:
            notes.append(f"{dut}: north was not found: {error}")
            continue
        document[dut], worst[dut] = found.document, found.worst_mil
        tables[ROWS].append(found.rows.assign(dut=dut))
        tables[CURVES].append(found.curves.assign(dut=dut))
    if document:
        (context.folder / FOLDER).mkdir(exist_ok=True)
        for name, blocks in tables.items():
            write_table(context.folder / FOLDER / name, pd.concat(blocks, ignore_index=True))
    judged = []
    if spec.max_error_mil is not None:
        judged = [Judged("north", "two_positions", "rms_mil", spec.max_error_mil, worst)]
    return Analysed(judged=judged, notes=notes, documents={"north": document})


def _seek(context: Context, dut: str, spec: NorthAnalysis) -> Sought:
    latitude, azimuth = context.site.get("latitude_deg"), context.site.get("azimuth_deg")
    if latitude is None or azimuth is None:
        raise NotSought("the bench file states no latitude or no azimuth under 'site:', so there is no truth")
    mine = [about for about in context.series if about["dut"] == dut]
    still = [about for about in mine if about["label"] == spec.still]
    if not still:
        raise NotSought(f"record '{spec.still}' was not made")
    every_s, rest = float(still[0]["every_s"]), sensors_of(context.recorded, still[0])
    seekings = [stack(context.recorded, one) for one in seekings_of(mine, spec.seek)]
    length = min(one.shape[-1] for one in seekings)
    data = np.stack([one[..., :length] for one in seekings])
    stability = np.array([block_means(sensor, every_s, spec.average_s).std(ddof=1) for sensor in rest])
    smoothing = Smoothing(every_s, stability, spec.fit_s)
    true_deg = np.full(len(data), azimuth)
    two = compare_smoothing(data[:, [0, 2]], true_deg, latitude, smoothing, spec.mils_per_circle)
    four = _four(data, smoothing, latitude, azimuth, spec)
    before, after = rest[0], _filtered(rest[0], every_s, float(stability[0]), spec.fit_s)
    curves = {name: allan_curve(trace, every_s) for name, trace in (("before", before), ("after", after))}
    document = {
        "latitude_deg": latitude,
        "azimuth_deg": azimuth,
        "mils_per_circle": spec.mils_per_circle,
        "seekings": len(data),
        "seconds_per_position": length * every_s,
        "bias_stability_dph": float(stability[0]),
        "two_positions": _summary(two),
        "four_positions": {name: float(np.sqrt(np.mean(errors**2))) for name, errors in four.items()},
        "autoregression": _autoregression(before, every_s, spec.fit_s),
        "allan": {name: _allan(curve) for name, curve in curves.items()},
    }
    errors = {"two_before_mil": two.before_mil, "two_after_mil": two.after_mil}
    rows = pd.DataFrame({"seeking": np.arange(1, len(data) + 1)} | errors | four)
    return Sought(document, rows, _table(curves), two.rms_before_mil)


def seekings_of(series: Sequence[Mapping[str, Any]], name: str) -> list[list[Mapping[str, Any]]]:
    """Records called `name`, `name-2` … in fours, one at each position, in the order measured; NotSought if none."""
    called = re.compile(rf"{re.escape(name)}(-\d+)?")
    found = [about for about in series if called.fullmatch(str(about["label"])) and about["verdict"] != "fail"]
    waiting: dict[float, Mapping[str, Any]] = {}
    complete: list[list[Mapping[str, Any]]] = []
    for about in sorted(found, key=lambda about: int(about["record"])):
        if about["position_deg"] in SEEKING_POSITIONS_DEG:
            waiting[about["position_deg"]] = about
        if len(waiting) == len(SEEKING_POSITIONS_DEG):
            complete.append([waiting[position] for position in SEEKING_POSITIONS_DEG])
            waiting = {}
    if len(complete) < 2:
        raise NotSought(
            f"{len(complete)} whole seekings of records '{name}'; it takes 2 or more, each with the table at 0, 90, "
            "180 and 270 deg"
        )
    return complete


def sensors_of(folder: Path, about: Mapping[str, Any]) -> Floats:
    """Gyros x and y in deg/h, accelerometers x and y in g of one record, (4, n); gaps are filled by the value before.

    NotSought if a channel is missing or more than one row in a thousand is.
    """
    series = read_parts(folder, about)
    missing = [name for name in SENSORS if name not in series]
    if missing:
        raise NotSought(f"the DUT sends no {' and no '.join(missing)}; declare them as channels of its frame")
    values = np.stack([np.asarray(series[name], dtype=np.float64) * factor for name, factor in SENSORS.items()])
    gaps = ~np.isfinite(values).all(axis=0)
    if gaps.mean() > 1e-3:
        raise NotSought(f"{int(gaps.sum())} of {gaps.size} rows of record '{about['label']}' are missing")
    last = np.maximum.accumulate(np.where(gaps, 0, np.arange(gaps.size)))
    return np.asarray(values[:, last])


def stack(folder: Path, seeking: Sequence[Mapping[str, Any]]) -> Floats:
    """The sensors of one seeking, (4 positions, 4 sensors, n), all as long as the shortest."""
    read = [sensors_of(folder, about) for about in seeking]
    length = min(one.shape[1] for one in read)
    return np.stack([one[:, :length] for one in read])


def _four(
    data: Floats, smoothing: Smoothing, latitude: float, azimuth: float, spec: NorthAnalysis
) -> dict[str, NDArray[np.float64]]:
    """Errors in mil of the four-position heading of gyro x, from plain and from smoothed means, (seekings,) each."""
    means = {
        "four_before_mil": data.mean(axis=-1),
        "four_after_mil": np.array([smoothing.means(np.moveaxis(one, -1, 0)) for one in data]),
    }
    errors = {}
    for name, mean in means.items():
        half = 0.5 * (mean[:, 0] - mean[:, 2])
        # The table counts counter-clockwise, seen from above.
        heading = four_position_heading_deg(
            mean[..., 0].T, latitude, clockwise=False, level=Level(half[:, 2], half[:, 3])
        )
        errors[name] = heading_error_mil(heading, azimuth, spec.mils_per_circle)
    return errors


def _filtered(trace: Floats, every_s: float, stability: float, fit_s: float) -> Floats:
    """A record after the filter, the model from its first `fit_s`."""
    found = fit_ar2(trace[: round(fit_s / every_s)])
    model = SmoothingModel(
        found.phi1, found.phi2, found.constant_of_mean, found.noise_variance, stability**2, found.constant_u**2
    )
    return np.asarray(smooth(trace, model).value)


def _autoregression(trace: Floats, every_s: float, fit_s: float) -> dict[str, float]:
    found = fit_ar2(trace[: round(fit_s / every_s)])
    names = ("phi1", "phi2", "constant", "phi1_u", "phi2_u", "constant_u")
    return {name: float(getattr(found, name)) for name in names}


def _summary(two: SmoothingComparison) -> dict[str, Any]:
    return {
        "rms_before_mil": two.rms_before_mil,
        "rms_after_mil": two.rms_after_mil,
        "max_before_mil": float(np.abs(two.before_mil).max()),
        "max_after_mil": float(np.abs(two.after_mil).max()),
        "change_mil2": two.change_mil2,
        "change_u_mil2": two.change_u_mil2,
        "verdict": two.verdict,
    }


def _allan(curve: AllanCurve) -> dict[str, Any]:
    """Coefficients with limits, and the minimum of the curve, which is none of them."""
    found = fit_allan(curve, draws=DRAWS)
    coefficients = {
        one.symbol: {"name": one.name, "unit": one.unit, "value": one.value, "low": one.low, "high": one.high}
        for one in found.coefficients
    }
    minimum = {"deviation_dph": found.minimum.deviation_dph, "tau_s": found.minimum.tau_s}
    return {"coefficients": coefficients, "minimum": minimum}


def _table(curves: Mapping[str, AllanCurve]) -> pd.DataFrame:
    blocks = [
        pd.DataFrame(
            {
                "trace": name,
                "tau_s": curve.tau_s,
                "deviation_dph": curve.deviation_dph,
                "low_dph": curve.low_dph,
                "high_dph": curve.high_dph,
            }
        )
        for name, curve in curves.items()
    ]
    return pd.concat(blocks, ignore_index=True)
