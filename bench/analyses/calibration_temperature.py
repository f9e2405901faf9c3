"""Bias against temperature: soaks, and rows of ramps up and down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analyses.calibration_lab import Found, Lab, Stated, bias_of, noise_of, pooled
from bench.analyses.calibration_records import RestRecord
from bench.procedure.calibration import TemperatureFigures
from fitting.metrics.bias import (
    BiasStability,
    ScaleFactor,
    block_means,
    full_temperature_bias_stability,
    to_dph,
)
from fitting.metrics.thermal import bias_temperature_rate_sensitivity, bias_temperature_sensitivity, hysteresis

Floats = NDArray[np.float64]

PART = "temperature"
BLOCKS_S = (10.0, 100.0)


def temperature(lab: Lab, spec: TemperatureFigures, found: Found) -> None:
    """Bt and the bias table from soaks; B_dT, hysteresis and BsT from ramps."""
    if spec.soaks is not None:
        _soaks(lab, spec, lab.records(spec.soaks, spec.warm_up_s), found)
    if spec.ramps is not None:
        for one in lab.records(spec.ramps, 0.0):
            _ramps(lab, spec, one, found)


def _soaks(lab: Lab, spec: TemperatureFigures, records: Sequence[RestRecord], found: Found) -> None:
    scales = [lab.scale_at(one.mean_degc) for one in records]
    noise = pooled([noise_of(one, scale) for one, (scale, _) in zip(records, scales, strict=True)])
    rows = []
    at_room = min(records, key=lambda one: abs(_asked(one) - spec.room_degc))
    for one, (scale, about_k) in zip(records, scales, strict=True):
        figure = bias_of(one, scale, lab.earth(), noise, len(records))
        # From one temperature to another only the noise differs: earth rate and K are the same in all.
        rows.append((one.mean_degc, figure.value, noise.u))
        if one is at_room:
            mean_dph = figure.value + lab.earth().value_dph
            found.budgets.setdefault("B0", lab.bias_budget(figure, mean_dph, scale, noise))
        conditions = one.conditions() | about_k | {"averaging_s": one.length_s}
        found.stated.append(Stated(PART, figure, conditions, f"{one.mean_degc:.1f} degC"))
    t, b, u = np.array(rows).T
    room = at_room.mean_degc

    def over_temperature() -> list[Stated]:
        made = bias_temperature_sensitivity(t, b, u, room)
        found.tables["bias_over_temperature"] = {
            "rows": [
                dict(zip(("temperature_degc", "bias_dph", "u_dph"), row, strict=True)) for row in made.table.tolist()
            ],
            "polynomial": made.polynomial.tolist(),
            "residual_rms_dph": made.residual_rms_dph,
        }
        about = {
            "soaks": len(t),
            "averaging_s": records[0].length_s,
            "not_in_u": "repeatability of the bias from one temperature to the next",
        }
        return [Stated(PART, made.sensitivity, about)]

    found.attempt("bias temperature sensitivity", over_temperature)


def _asked(one: RestRecord) -> float:
    """The chamber's setpoint; the DUT's own temperature without one."""
    return one.mean_degc if one.setpoint_degc is None else one.setpoint_degc


@dataclass(frozen=True)
class RampRows:
    """Averages (n,) of a record over a temperature cycle: bias in deg/h, temperature, its slope."""

    bias_dph: Floats
    temperature_degc: Floats
    slope_degc_min: Floats


def ramp_rows(one: RestRecord, average_s: float, scale: ScaleFactor, earth_dph: float) -> RampRows:
    """Block means; a row's slope is the central difference of its neighbours, so the outermost two are left out."""
    output = block_means(to_dph(one.output_dps, scale), one.every_s, average_s) - earth_dph
    degc = block_means(one.temperature_degc, one.every_s, average_s)
    slopes = (degc[2:] - degc[:-2]) / (2.0 * average_s / 60.0)
    return RampRows(output[1:-1], degc[1:-1], slopes)


def _ramps(lab: Lab, spec: TemperatureFigures, one: RestRecord, found: Found) -> None:
    scale, about_k = lab.scale_at(one.mean_degc)
    rows = ramp_rows(one, spec.average_s, scale, lab.earth().value_dph)
    conditions: dict[str, Any] = one.conditions() | about_k | {"averaging_s": spec.average_s}

    def by_slope() -> list[Stated]:
        made = bias_temperature_rate_sensitivity(rows.bias_dph, rows.temperature_degc, rows.slope_degc_min)
        found.tables.setdefault("ramps", []).append(
            {
                "record": one.label,
                "coefficients": made.coefficients.tolist(),
                "u": np.sqrt(np.diag(made.covariance)).tolist(),
                "residual_rms_dph": made.residual_rms_dph,
            }
        )
        return [Stated(PART, made.rate_sensitivity, conditions, one.label)]

    def branches() -> list[Stated]:
        figure = hysteresis(
            rows.bias_dph,
            rows.temperature_degc,
            rows.slope_degc_min,
            bin_degc=spec.bin_k,
            moving=spec.moving_degc_min,
        )
        return [Stated(PART, figure, conditions, one.label)]

    def stability(block_s: float) -> list[Stated]:
        both: BiasStability = full_temperature_bias_stability(one.output_dps, one.every_s, block_s, scale)
        about = conditions | {"averaging_s": block_s, "detrended": False}
        return [Stated(PART, both.as_defined, about, one.label)]

    found.attempt("bias temperature-rate sensitivity", by_slope)
    found.attempt("bias hysteresis", branches)
    for block_s in BLOCKS_S:
        found.attempt(f"full-temperature bias stability over {block_s:g} s", partial(stability, block_s))
