"""A run folder made from formulas: surface A (docs of the fitters, §1) with dwell-to-dwell errors and noise, no bench.

Models are plain polynomials written as JSON under the names of the real models, so that a test needs no fitter;
`load_polynomial` reads them back. Everything is drawn from one seed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tests.bench.report.synthetic_manifest import manifest_of

Floats = NDArray[np.float64]

DUTS = ("gyro-a", "gyro-b")
TEMPERATURES_DEGC = tuple(range(-30, 61, 5))
RATES_DPS = tuple(range(-180, 181, 10))
DEGREES = {"linear": 1, "ts_published": 4, "ts_joint": 8}
SOAK_S, ACQUIRE_S, SETTLE_S, RAMP_DEGC_MIN = 7200.0, 600.0, 6.0, 1.0
SELF_HEATING_DEGC, DUT_LAG_S, CHAMBER_LAG_S = 3.5, 1200.0, 240.0


def surface_a(temperature_degc: Floats, rate_dps: Floats, k1: float = 0.020260709) -> Floats:
    """What the gyro of surface A reads (deg/s) at a temperature and a true rate."""
    t = (temperature_degc - 15.0) / 45.0
    k = 0.049530876 + k1 * np.tanh((temperature_degc - 24.87441) / 14.0)
    return (1 + k) * np.sin(0.0013 * rate_dps) / 0.0013 + 0.40871934 + 0.42963359 * t


@dataclass(frozen=True)
class Polynomial:
    """A polynomial of total degree `degree` in the scaled temperature and rate; the tests' stand-in for a model."""

    degree: int
    coefficients: Floats

    def predict(self, temperature_degc: Floats, rate_dps: Floats) -> Floats:
        return np.asarray(_terms(temperature_degc, rate_dps, self.degree) @ self.coefficients)

    @classmethod
    def fitted(cls, degree: int, temperature_degc: Floats, rate_dps: Floats, reference_dps: Floats) -> Polynomial:
        terms = _terms(temperature_degc, rate_dps, degree)
        return cls(degree, np.asarray(np.linalg.lstsq(terms, reference_dps, rcond=None)[0], dtype=np.float64))


def load_polynomial(path: Path) -> Polynomial:
    """Read back a model that `write_synthetic_run` wrote."""
    raw = json.loads(path.read_text())
    return Polynomial(raw["degree"], np.array(raw["coefficients"]))


def write_synthetic_run(
    folder: Path,
    *,
    duts: Sequence[str] = DUTS,
    temperatures_degc: Sequence[float] = TEMPERATURES_DEGC,
    rates_dps: Sequence[float] = RATES_DPS,
    stop_after: int | None = None,
    outcome: str = "PASS",
    virtual: bool = True,
    seed: int = 1,
    timeline_period_s: float = 60.0,
    without: Sequence[str] = (),
) -> Path:
    """Write a run folder and return it.

    `stop_after` ends the run after that many points of each DUT; `without` leaves parts out ('models', 'metrics',
    'residuals', 'timeline', 'manifest', 'points').
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    schedule = _schedule(temperatures_degc, rates_dps)
    planned, schedule = len(schedule), schedule[:stop_after]
    points = _points(schedule, duts, rng)
    saved = "models" not in without
    fits = {dut: _fit(folder, dut, points[points["dut"] == dut], rng, saved) for dut in duts} if len(points) else {}
    metrics = {dut: figures for dut, (figures, _) in fits.items()}
    if fits and "residuals" not in without:
        pd.concat([errors for _, errors in fits.values()]).to_parquet(folder / "residuals.parquet", index=False)
    if "points" not in without:
        points.to_csv(folder / "points.csv", index=False, float_format="%.9g")
    if "timeline" not in without:
        _timeline(schedule, duts, timeline_period_s).to_parquet(folder / "timeline.parquet")
    if "metrics" not in without:
        (folder / "metrics.json").write_text(json.dumps(metrics, indent=1))
    (folder / "procedure.yaml").write_text("name: temperature_rate_grid\ntitle: Temperature × rate grid\n")
    (folder / "bench.yaml").write_text(
        "name: virtual\nduts:\n" + "".join(f"  {json.dumps(dut)}: {{}}\n" for dut in duts)
    )
    if "manifest" not in without:
        duration_s = schedule[-1][2] + ACQUIRE_S if schedule else 600.0
        counts = {"planned": planned, "measured": len(schedule)}
        manifest = manifest_of(folder, points, metrics, duts, duration_s, counts, outcome, virtual, seed)
        (folder / "manifest.json").write_text(json.dumps(manifest, indent=1))
    return folder


def _terms(temperature_degc: Floats, rate_dps: Floats, degree: int) -> Floats:
    t, r = np.asarray(temperature_degc) / 60.0, np.asarray(rate_dps) / 200.0
    terms: Floats = np.stack([t**i * r**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=-1)
    return terms


def _schedule(temperatures: Sequence[float], rates: Sequence[float]) -> list[tuple[float, float, float]]:
    """(chamber setpoint, rate setpoint, start of the acquisition in s) of each planned point."""
    now, before, schedule = 0.0, 25.0, []
    for temperature in temperatures:
        now += abs(temperature - before) / RAMP_DEGC_MIN * 60.0 + SOAK_S
        before = temperature
        for rate in rates:
            now += SETTLE_S
            schedule.append((float(temperature), float(rate), now))
            now += ACQUIRE_S
    return schedule


def _points(
    schedule: Sequence[tuple[float, float, float]], duts: Sequence[str], rng: np.random.Generator
) -> pd.DataFrame:
    frames = [_points_of(schedule, dut, number, rng) for number, dut in enumerate(duts)]
    return pd.concat(frames).sort_values(["point", "dut"], kind="stable").reset_index(drop=True)


def _points_of(
    schedule: Sequence[tuple[float, float, float]], dut: str, number: int, rng: np.random.Generator
) -> pd.DataFrame:
    setpoint, rate, start = np.array(schedule, dtype=float).reshape(-1, 3).T
    n = len(setpoint)
    dwell = np.cumsum(np.diff(setpoint, prepend=setpoint[:1]) != 0)
    scale, bias, sensor = (rng.normal(0, sigma, n + 1)[dwell] for sigma in (100e-6, 2 / 3600, 0.1))
    true_degc = setpoint + SELF_HEATING_DEGC + 0.3 * number + rng.normal(0, 0.01, n)
    reference = rate + 15.041 / 3600 * math.sin(math.radians(29.5))
    std = 0.0088 + 0.0006 * number
    u = std / math.sqrt(1000) * (1 + 0.15 * rng.random(n))
    mean = surface_a(true_degc - SELF_HEATING_DEGC, reference, 0.020260709 * (1 - 0.2 * number)) + scale * rate + bias
    lost = rng.poisson(0.02, n)
    verdict = np.where(rng.random(n) < 0.004, "marginal", "pass")
    reasons = np.where(verdict == "marginal", "temperature slope 0.021 degC/min above 0.02", "")
    if n > 300 and number == 1:
        verdict[250], reasons[250], lost[250] = "fail", "4 812 of 60 000 frames lost (limit 1 %)", 4812
    return pd.DataFrame(
        {
            "point": np.arange(1, n + 1),
            "dut": dut,
            "dwell": dwell + 1,
            "chamber_setpoint_degc": setpoint,
            "chamber_readback_degc": setpoint + rng.normal(0, 0.03, n),
            "dut_temperature_degc": true_degc + sensor,
            "dut_temperature_slope_degc_min": rng.normal(0, 0.001, n),
            "dut_temperature_slope_u_degc_min": 0.0004,
            "rate_setpoint_dps": rate,
            "rate_readback_dps": rate + rng.normal(0, 2e-4, n),
            "rate_worst_dps": rate + rng.normal(0, 5e-4, n),
            "rate_reference_dps": reference,
            "rate_mean_dps": mean + rng.normal(0, u),
            "rate_std_dps": std,
            "rate_mean_u_dps": u,
            "noise_ratio": 1.0 + rng.normal(0, 0.02, n),
            "samples": 1000,
            "frames": 60_000 - lost,
            "frames_lost": lost,
            "duplicates": 0,
            "bad_checksum": 0,
            "skipped_bytes": 0,
            "resyncs": 0,
            "frames_held": 0,
            "spikes": rng.poisson(0.01, n),
            "outliers": rng.poisson(0.01, n),
            "started_at_s": start,
            "ended_at_s": start + ACQUIRE_S,
            "verdict": verdict,
            "reasons": reasons,
        }
    )


def _fit(
    folder: Path, dut: str, points: pd.DataFrame, rng: np.random.Generator, saved: bool
) -> tuple[dict[str, dict[str, dict[str, float]]], pd.DataFrame]:
    """Fit the polynomials, save them, and judge them on the splits the real evaluation uses; metrics and errors."""
    t, r, y, u = (
        points[name].to_numpy()
        for name in ("dut_temperature_degc", "rate_mean_dps", "rate_reference_dps", "rate_mean_u_dps")
    )
    train = rng.permutation(len(y)) < round(0.69 * len(y))
    fold = np.unique(points["chamber_setpoint_degc"], return_inverse=True)[1] % 6
    metrics: dict[str, dict[str, dict[str, float]]] = {}
    errors: list[pd.DataFrame] = []
    for model, degree in {"none": 0, **DEGREES}.items():
        held_out = np.zeros(len(y))
        for k in np.unique(fold):
            held_out[fold == k] = _error(degree, t, r, y, fold != k)[fold == k]
        error = _error(degree, t, r, y, train)
        judged = {"random_train": (error, train), "random": (error, ~train)}
        judged["leave_temperatures_out"] = (held_out, np.ones(len(y), dtype=bool))
        metrics[model] = {split: _figures(e[rows], u[rows]) for split, (e, rows) in judged.items() if rows.any()}
        for split, (e, rows) in judged.items():
            columns = {"model": model, "split": split, "predicted_dps": (y + e)[rows], "residual_dps": e[rows]}
            errors.append(pd.DataFrame({**columns, "point": points["point"].to_numpy()[rows], "dut": dut}))
        if model != "none" and saved:
            fitted = Polynomial.fitted(degree, t, r, y)
            path = folder / "models" / dut / f"{model}.json"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"degree": degree, "coefficients": list(fitted.coefficients)}))
    return metrics, pd.concat(errors)


def _error(degree: int, t: Floats, r: Floats, y: Floats, train: NDArray[np.bool_]) -> Floats:
    """Error of every row for a polynomial fitted on `train`; degree 0 stands for no compensation."""
    if degree == 0 or not train.any():
        return np.asarray(r - y)
    return Polynomial.fitted(degree, t[train], r[train], y[train]).predict(t, r) - y


def _figures(error: Floats, u: Floats) -> dict[str, float]:
    return {
        "max_abs_dps": float(np.max(np.abs(error))),
        "std_dps": float(np.std(error)),
        "floor_dps": float(np.sqrt(np.mean(u**2))),
        "n": len(error),
        "fit_s": 0.01,
    }


def _timeline(schedule: Sequence[tuple[float, float, float]], duts: Sequence[str], period_s: float) -> pd.DataFrame:
    end = schedule[-1][2] + ACQUIRE_S if schedule else 600.0
    t = np.arange(0.0, end, period_s)
    starts = np.array([start for _, _, start in schedule] or [math.inf])
    running = np.searchsorted(starts, t, side="right") - 1
    rates = np.array([0.0, *(rate for _, rate, _ in schedule), 0.0])
    acquiring = (running >= 0) & (t - starts[np.maximum(running, 0)] < ACQUIRE_S + SETTLE_S)
    rate = np.where(acquiring, rates[running + 1], 0.0)
    setpoint = _setpoint(schedule, t)
    air = _lagged(setpoint, period_s, CHAMBER_LAG_S, 25.0)
    columns = {
        "t_s": t,
        "chamber_setpoint_degc": setpoint,
        "chamber_readback_degc": air,
        "rate_setpoint_dps": rate,
        "rate_readback_dps": rate,
    }
    for number, dut in enumerate(duts):
        warm = air + (SELF_HEATING_DEGC + 0.3 * number) * (1 - np.exp(-t / 3600))
        columns[f"temperature_degc:{dut}"] = np.where(
            np.arange(len(t)) % 3 == 1, math.nan, _lagged(warm, period_s, DUT_LAG_S, 25.0)
        )
    return pd.DataFrame(columns)


def _setpoint(schedule: Sequence[tuple[float, float, float]], t: Floats) -> Floats:
    """The chamber's ramped setpoint: a ramp to each temperature, then flat until its last acquisition ends."""
    at_s, at_degc, before, last_end = [0.0], [25.0], 25.0, 0.0
    for temperature, _, start in schedule:
        if temperature != before:
            at_s += [last_end, last_end + abs(temperature - before) / RAMP_DEGC_MIN * 60.0]
            at_degc += [before, temperature]
        before, last_end = temperature, start + ACQUIRE_S
    return np.interp(t, at_s, at_degc)


def _lagged(values: Floats, period_s: float, lag_s: float, first: float) -> Floats:
    out, keep = np.empty_like(values), math.exp(-period_s / lag_s)
    state = first
    for index, value in enumerate(values):
        state = value + (state - value) * keep
        out[index] = state
    return out
