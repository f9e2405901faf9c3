"""Rate sets and small rates: from the points of a run to what `fitting.metrics` takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bench.analyses.calibration_records import NotRecorded
from bench.points import usable
from fitting.metrics.figure import Figure
from fitting.metrics.scale_factor import RateSet, rate_set

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

_FEWEST_RATES = 3
_DPH_PER_DPS = 3600.0


@dataclass(frozen=True)
class RateSetAt:
    """A rate set of one DUT at one temperature, and what belongs beside its figures.

    u_noise: standard uncertainty of K without the table's error, which all sets of a run have in common.
    """

    dwell: int
    setpoint_degc: float | None
    temperature_degc: float
    rates: RateSet
    u_noise: float
    conditions: dict[str, Any]


def rate_sets(
    points: pd.DataFrame,
    dut: str,
    table_u_ppm: float,
    within_dps: float | None = None,
    repeats_s: Sequence[float] = (),
) -> list[RateSetAt]:
    """Every rate set of a DUT, one for each dwell that has three rates in each direction.

    within_dps: points of a threshold scan, whose input or rate is no larger, are no part of a rate set. repeats_s: when
    repeats begin; each has a rate set of its own.
    """
    table = usable(points, dut)
    if within_dps is not None:
        small = (table["rate_reference_dps"].abs() <= within_dps) | (table["rate_setpoint_dps"].abs() <= within_dps)
        table = table[~small | (table["rate_setpoint_dps"] == 0.0)]
    repeat = np.searchsorted(np.sort(np.array(repeats_s, dtype=np.float64)), table["started_at_s"], side="right")
    groups = table.groupby([table["dwell"], repeat], sort=True)
    return [found for _, rows in groups for found in _rate_set(rows, table_u_ppm)]


def _rate_set(rows: pd.DataFrame, table_u_ppm: float) -> Iterator[RateSetAt]:
    rows = rows.sort_values("started_at_s", kind="stable")
    moving = rows["rate_setpoint_dps"].to_numpy() != 0.0
    rates = rows["rate_setpoint_dps"].to_numpy(dtype=np.float64)[moving]
    if min(len(np.unique(rates[rates > 0.0])), len(np.unique(rates[rates < 0.0]))) < _FEWEST_RATES:
        return
    outputs = rows["rate_mean_dps"].to_numpy(dtype=np.float64)
    before, after = _rests(outputs, moving)
    found = rate_set(
        rates, outputs[moving], rest_before=before, rest_after=after, table_u_ppm=table_u_ppm, unit="deg/s"
    )
    if moving.all():
        found = _without_rests(found)
    k = found.scale_factor
    u_noise = float(np.sqrt(max(k.u**2 - (k.value * table_u_ppm * 1e-6) ** 2, 0.0)))
    conditions = _conditions(rows, moving)
    setpoint = conditions["chamber_setpoint_degc"]
    temperature = float(conditions["dut_temperature_degc"]["mean"])
    yield RateSetAt(int(rows["dwell"].iloc[0]), setpoint, temperature, found, u_noise, conditions)


def _without_rests(found: RateSet) -> RateSet:
    """The same figures, saying what was not taken off."""
    taken, left = "outputs at rest taken off", "no output at rest was measured: the offset holds bias and earth rate"

    def said(figure: Figure) -> Figure:
        return replace(figure, definition=figure.definition.replace(taken, left))

    return replace(found, scale_factor=said(found.scale_factor), offset=said(found.offset))


def _rests(outputs: Floats, moving: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Output at rest before and after each moving point, (m,) each; the nearer one twice where there is only one.

    Without any rest they are 0, and the offset of the line holds bias and earth rate.
    """
    at_rest = np.flatnonzero(~moving)
    if not len(at_rest):
        zero = np.zeros(int(moving.sum()))
        return zero, zero
    where = np.searchsorted(at_rest, np.flatnonzero(moving))
    last = len(at_rest) - 1
    before, after = outputs[at_rest[np.clip(where - 1, 0, last)]], outputs[at_rest[np.minimum(where, last)]]
    return np.asarray(before), np.asarray(np.where(where > last, before, after))


def _conditions(rows: pd.DataFrame, moving: NDArray[np.bool_]) -> dict[str, Any]:
    setpoints = rows["chamber_setpoint_degc"].dropna()
    lasting = rows["ended_at_s"].to_numpy(dtype=np.float64) - rows["started_at_s"].to_numpy(dtype=np.float64)
    turns = np.abs(rows["rate_setpoint_dps"].to_numpy(dtype=np.float64)) * lasting / 360.0
    temperature = rows["dut_temperature_degc"]
    return {
        "chamber_setpoint_degc": float(setpoints.iloc[0]) if len(setpoints) else None,
        "dut_temperature_degc": {
            "min": float(temperature.min()),
            "mean": float(temperature.mean()),
            "max": float(temperature.max()),
            "slope_degc_min": _largest(rows["dut_temperature_slope_degc_min"].to_numpy(dtype=np.float64)),
        },
        "rates_dps": sorted(set(rows["rate_setpoint_dps"].to_numpy(dtype=np.float64)[moving].tolist())),
        "rests": int((~moving).sum()),
        "averaging_s": {"min": float(lasting.min()), "max": float(lasting.max())},
        "revolutions_per_point": {"min": float(turns[moving].min()), "max": float(turns[moving].max())},
        "outliers": int(rows["outliers"].sum()),
        "spikes": int(rows["spikes"].sum()),
        "frames_lost": int(rows["frames_lost"].sum()),
    }


def _largest(values: Floats) -> float | None:
    """The value of largest magnitude; None if there is none."""
    present = values[np.isfinite(values)]
    return float(present[np.argmax(np.abs(present))]) if len(present) else None


def nearest(sets: list[RateSetAt], temperature_degc: float) -> RateSetAt:
    """The first rate set at the temperature nearest to this one."""
    distance = [round(abs(_asked(one) - temperature_degc), 6) for one in sets]
    return sets[distance.index(min(distance))]


def _asked(one: RateSetAt) -> float:
    return one.temperature_degc if one.setpoint_degc is None else one.setpoint_degc


def visits(sets: list[RateSetAt], temperature_degc: float) -> list[RateSetAt]:
    """All rate sets made at the temperature nearest to this one."""
    there = _asked(nearest(sets, temperature_degc))
    return [one for one in sets if abs(_asked(one) - there) < 1.0]


@dataclass(frozen=True)
class SmallRates:
    """Applied rates and responses (m,), the response already divided by K; u of one response; all in deg/h."""

    applied_dph: Floats
    response_dph: Floats
    u_dph: float
    about_dph: float
    averaging_s: float


def small_rates(points: pd.DataFrame, dut: str, k: float, span_dps: float, column: str) -> SmallRates:
    """Points whose `column` (the input, or the table's rate) is within ± span, against the one nearest 0 of it.

    NotRecorded: fewer than three of them.
    """
    table = usable(points, dut)
    rows = table[table[column].abs() <= span_dps]
    if len(rows) < _FEWEST_RATES:
        what = "input with the earth's rotation" if column == "rate_reference_dps" else "table rate"
        raise NotRecorded(f"{len(rows)} points have their {what} within ± {span_dps * _DPH_PER_DPS:g} deg/h")
    applied = rows[column].to_numpy(dtype=np.float64)
    zero = int(np.argmin(np.abs(applied)))
    output, u = (rows[name].to_numpy(dtype=np.float64) / k for name in ("rate_mean_dps", "rate_mean_u_dps"))
    moved = np.arange(len(rows)) != zero
    lasting = rows["ended_at_s"] - rows["started_at_s"]
    return SmallRates(
        (applied - applied[zero])[moved] * _DPH_PER_DPS,
        (output - output[zero])[moved] * _DPH_PER_DPS,
        float(np.hypot(np.sqrt(np.mean(u[moved] ** 2)), u[zero])) * _DPH_PER_DPS,
        float(rows["rate_reference_dps"].iloc[zero]) * _DPH_PER_DPS,
        float(lasting.median()),
    )
