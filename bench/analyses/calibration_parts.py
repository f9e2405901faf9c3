"""The parts of a calibration: each takes records or points of one DUT and states figures.

Everything is divided by K first; then the earth's rotation is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from bench.analyses.calibration_lab import Found, Lab, Stated, bias_of, noise_of, pooled
from bench.analyses.calibration_points import RateSetAt, nearest, small_rates, visits
from bench.analyses.calibration_records import NotRecorded, RestRecord
from bench.procedure.calibration import RepeatFigures, ScaleFactorFigures, StaticFigures, ThresholdFigures
from fitting.metrics.allan_figures import allan_figures
from fitting.metrics.bias import ScaleFactor, bias_repeatability, bias_stability, to_dph
from fitting.metrics.figure import Figure
from fitting.metrics.scale_factor import scale_factor_repeatability, scale_factor_temperature_sensitivity
from fitting.metrics.small_rates import dead_zone, resolution, threshold
from fitting.metrics.start import time_to_band_s, turn_on_time
from fitting.random_errors.allan import AllanCurve, allan_curve
from fitting.random_errors.allan_fit import AllanFit, fit_allan

DRAWS = 400
# The letters of the fit that mean something else in a list with the scale factor K.
SYMBOLS = {"Q": "Qn", "K": "Krw"}


def static(lab: Lab, spec: StaticFigures, found: Found) -> None:
    """B0, Bs, and the Allan coefficients of each record named."""
    for one in lab.records(spec.record, spec.warm_up_s):
        scale, about_k = lab.scale_at(one.mean_degc)
        conditions = one.conditions() | about_k
        found.attempt("bias", partial(_bias, lab, one, scale, conditions, found))
        for block in spec.blocks_s:
            make = partial(_stability, one, block, scale, conditions)
            found.attempt(f"bias stability over {block:g} s", make)
        found.attempt("Allan coefficients", partial(_allan, one, scale, conditions, found))


def _bias(lab: Lab, one: RestRecord, scale: ScaleFactor, conditions: dict[str, Any], found: Found) -> list[Stated]:
    earth = lab.earth()
    noise = noise_of(one, scale)
    figure = bias_of(one, scale, earth, noise, 1)
    found.budgets.setdefault("B0", lab.bias_budget(figure, figure.value + earth.value_dph, scale, noise))
    about = conditions | {"averaging_s": one.length_s, "earth_rate_dph": earth.value_dph}
    return [Stated("static", figure, about, _degc(one.mean_degc))]


def _stability(one: RestRecord, block_s: float, scale: ScaleFactor, conditions: dict[str, Any]) -> list[Stated]:
    both = bias_stability(one.output_dps, one.every_s, block_s, scale)
    detrended = replace(both.detrended, symbol=f"{both.detrended.symbol} detrended")
    return [
        Stated("static", figure, conditions | {"averaging_s": block_s, "detrended": taken_out}, _degc(one.mean_degc))
        for figure, taken_out in ((both.as_defined, False), (detrended, True))
    ]


def _allan(one: RestRecord, scale: ScaleFactor, conditions: dict[str, Any], found: Found) -> list[Stated]:
    curve = allan_curve(to_dph(one.output_dps, scale), one.every_s)
    fit = fit_allan(curve, draws=DRAWS)
    found.tables.setdefault("allan", []).append(allan_table(one.label, curve, fit))
    about = conditions | {"averaging_s": {"min": float(curve.tau_s[0]), "max": float(curve.tau_s[-1])}}
    figures = [
        replace(figure, symbol=SYMBOLS.get(figure.symbol, figure.symbol))
        for figure in allan_figures(fit, curve.samples)
    ]
    return [Stated("static", figure, about, _degc(one.mean_degc)) for figure in figures]


def allan_table(label: str, curve: AllanCurve, fit: AllanFit) -> dict[str, Any]:
    """The curve, its limits and the fit, as lists."""
    columns = {
        "tau_s": curve.tau_s,
        "deviation_dph": curve.deviation_dph,
        "low_dph": curve.low_dph,
        "high_dph": curve.high_dph,
        "fit_dph": fit.deviation_dph(curve.tau_s),
    }
    return {"record": label, **{name: np.asarray(values).tolist() for name, values in columns.items()}}


def scale_factor(lab: Lab, spec: ScaleFactorFigures, repeats: RepeatFigures | None, found: Found) -> None:
    """K, F0, Kn, Ka of every rate set; Kt over temperatures; Kr over visits to the same one."""
    if not lab.sets:
        raise NotRecorded("no rate set: at one temperature at least 3 rates in each direction")
    rows = found.tables.setdefault("rates", [])
    for one in lab.sets:
        at, conditions = _degc(one.temperature_degc), one.conditions | {"dwell": one.dwell}
        made = one.rates
        figures = (made.scale_factor, made.offset, made.nonlinearity, made.asymmetry)
        found.stated += [Stated("scale_factor", figure, conditions, at) for figure in figures]
        columns = (made.rates_dps, made.residuals_ppm, made.reading_ppm)
        rows += [
            {"dwell": one.dwell, "at": at, "rate_dps": rate, "full_scale_ppm": full, "reading_ppm": reading}
            for rate, full, reading in zip(*(column.tolist() for column in columns), strict=True)
        ]
    found.budgets["K"] = lab.scale_budget(nearest(lab.sets, spec.room_degc))
    temperatures = {one.setpoint_degc for one in lab.sets}
    if len(temperatures) > 1:
        found.attempt("scale-factor temperature sensitivity", lambda: [_over_temperature(lab.sets, spec)])
    at_room = visits(lab.sets, spec.room_degc)
    if len(at_room) > 1:
        found.attempt("scale-factor repeatability", lambda: [_repeated(at_room, repeats)])


def _over_temperature(sets: Sequence[RateSetAt], spec: ScaleFactorFigures) -> Stated:
    columns = [(one.temperature_degc, one.rates.scale_factor.value, one.u_noise) for one in sets]
    t, k, u = np.array(columns).T
    # The setpoint is the chamber's; the sensor of the DUT reads warmer. Both have the same room.
    room = nearest(list(sets), spec.room_degc).temperature_degc
    figure = scale_factor_temperature_sensitivity(t, k, u, room)
    conditions = {
        "temperatures_degc": t.tolist(),
        "rate_sets": len(sets),
        "not_in_u": "repeatability of K from one temperature to the next",
    }
    return Stated("scale_factor", figure, conditions)


def _repeated(sets: Sequence[RateSetAt], repeats: RepeatFigures | None) -> Stated:
    figure = scale_factor_repeatability([one.rates.scale_factor.value for one in sets])
    return Stated("scale_factor", _of_repeats(figure, repeats), _spread_of(sets), _degc(sets[0].temperature_degc))


def _spread_of(sets: Sequence[RateSetAt]) -> dict[str, Any]:
    within = np.sqrt(np.mean([one.u_noise**2 for one in sets]))
    return {"repeats": len(sets), "of_which_noise_of_one_ppm": float(1e6 * within)}


def _of_repeats(figure: Figure, repeats: RepeatFigures | None) -> Figure:
    """The figure with what really was done between the repeats in its definition."""
    if repeats is not None and repeats.between == "power_off":
        return figure
    words = figure.definition.replace("power cycles with cool-down between", "thermal excursions, the power left on")
    return replace(figure, definition=words.replace("power cycles", "thermal excursions, the power left on"))


def power_cycles(lab: Lab, spec: RepeatFigures, found: Found) -> None:
    """Br over records that are alike; t_on if they begin at power-on."""
    records = lab.records(spec.record, spec.warm_up_s)
    scales = [lab.scale_at(one.mean_degc) for one in records]
    noise = pooled([noise_of(one, scale) for one, (scale, _) in zip(records, scales, strict=True)])
    biases = []
    for one, (scale, about_k) in zip(records, scales, strict=True):
        figure = bias_of(one, scale, lab.earth(), noise, len(records))
        biases.append(figure.value)
        found.budgets.setdefault("B0", lab.bias_budget(figure, figure.value + lab.earth().value_dph, scale, noise))
        conditions = one.conditions() | about_k | {"averaging_s": one.length_s}
        found.stated.append(Stated("power_cycles", figure, conditions, one.label))
    about = {
        "repeats": len(records),
        "between": spec.between,
        "averaging_s": records[0].length_s,
        "of_which_noise_of_one_dph": noise.u,
        "biases_dph": biases,
    }
    found.attempt(
        "bias repeatability",
        lambda: [Stated("power_cycles", _of_repeats(bias_repeatability(biases), spec), about)],
    )
    if spec.band_dph is not None:
        found.attempt("turn-on time", lambda: [_turned_on(lab, spec, biases)])


def _turned_on(lab: Lab, spec: RepeatFigures, biases_dph: Sequence[float]) -> Stated:
    """The longest start; each is held to the band about its own bias, for that differs from start to start."""
    assert spec.band_dph is not None
    starts = lab.records(spec.record, 0.0)
    own = [
        to_dph(one.output_dps, lab.scale_at(one.mean_degc)[0]) - lab.earth().value_dph - value
        for one, value in zip(starts, biases_dph, strict=True)
    ]
    band = (-spec.band_dph, spec.band_dph)
    figure = turn_on_time(own, starts[0].every_s, spec.average_s, band)
    each = [time_to_band_s(one, starts[0].every_s, spec.average_s, band) for one in own]
    return Stated(
        "power_cycles", figure, {"averaging_s": spec.average_s, "band_about": "bias of each start", "starts_s": each}
    )


def small(lab: Lab, spec: ThresholdFigures, found: Found) -> None:
    """W_th and W_dz from the scan through zero input, W_res from the one about rest."""
    temperature = float(lab.points.loc[lab.points["dut"] == lab.dut, "dut_temperature_degc"].mean())
    scale, about_k = lab.scale_at(temperature)

    def through_zero(make: Any) -> list[Stated]:
        lab.earth()
        scan = small_rates(lab.points, lab.dut, scale.value, spec.span_dps, "rate_reference_dps")
        about = about_k | {"averaging_s": scan.averaging_s, "u_of_one_response_dph": scan.u_dph}
        return [Stated("threshold", make(scan.applied_dph, scan.response_dph, scan.u_dph), about)]

    def about_rest() -> list[Stated]:
        scan = small_rates(lab.points, lab.dut, scale.value, spec.span_dps, "rate_setpoint_dps")
        about = about_k | {"averaging_s": scan.averaging_s, "u_of_one_response_dph": scan.u_dph}
        figure = resolution(scan.applied_dph, scan.response_dph, scan.u_dph, scan.about_dph)
        return [Stated("threshold", figure, about)]

    found.attempt("threshold", lambda: through_zero(threshold))
    found.attempt("dead zone", lambda: through_zero(dead_zone))
    found.attempt("resolution", about_rest)


def _degc(temperature_degc: float) -> str:
    return f"{temperature_degc:.1f} degC"
