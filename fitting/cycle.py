"""Reduction of a thermal cycle to rows, and the figures it is judged by (`bp`, `rlg`); pure functions on arrays.

Values are in the unit they come in; the names say deg/h, because that is what these experiments report.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

Array = NDArray[np.float64]

AVERAGING_S = 100.0
# gyro_test_metrics.md, section 4.5: a gyro is settled when its own slope is below 0.01 degC/min over 10 min.
SETTLED_DEGC_MIN, SETTLED_OVER_S = 0.01, 600.0
_CONFIDENCE = 0.95


def block_rows(averaging_s: float, period_s: float) -> int:
    """Samples in a block; ValueError if the block is not a whole number of sample periods (to 1e-6)."""
    ratio = averaging_s / period_s if period_s > 0.0 else np.nan
    rows = round(ratio) if np.isfinite(ratio) else 0
    if rows < 1 or abs(ratio - rows) > 1e-6 * rows:
        raise ValueError(
            f"cycle: blocks of {averaging_s!r} s of samples every {period_s!r} s; allowed: a whole number of samples a "
            "block, at least one. Choose another averaging time."
        )
    return rows


def block_means(values: Array, rows: int) -> Array:
    """Means of non-overlapping blocks of `rows` along the first axis; the rest of the last block is dropped.

    values: (n,) or (n, k); result: (n // rows,) or (n // rows, k). ValueError if there is not one whole block.
    """
    count = len(values) // rows
    if count < 1:
        raise ValueError(f"cycle: {len(values)} samples are less than one block of {rows}; record longer.")
    return np.asarray(values[: count * rows].reshape(count, rows, *values.shape[1:]).mean(axis=1))


def first_dwell(
    temperature_degc: Array,
    period_s: float,
    slope_degc_min: float = SETTLED_DEGC_MIN,
    over_s: float = SETTLED_OVER_S,
) -> slice:
    """Rows (start, stop) of the first stretch in which the gyro's own temperature is settled.

    A row is settled if the temperature has moved by less than slope_degc_min x over_s within the over_s before it.
    ValueError if no row is, with the smallest slope met.
    """
    window = max(1, round(over_s / period_s))
    if len(temperature_degc) <= window:
        raise ValueError(
            f"cycle: {len(temperature_degc)} rows of {period_s:g} s are too few to see {over_s:g} s of steady "
            "temperature; record longer or take a shorter time."
        )
    slope = np.abs(temperature_degc[window:] - temperature_degc[:-window]) / (window * period_s / 60.0)
    settled = slope <= slope_degc_min
    if not settled.any():
        raise ValueError(
            f"cycle: the temperature never settles: it moves over {over_s:g} s by at least {slope.min():.3g} degC/min, "
            f"allowed is {slope_degc_min:g}. Dwell longer before the first ramp, or give the truth."
        )
    begin = int(np.argmax(settled))
    moving = ~settled[begin:]
    length = int(np.argmax(moving)) if moving.any() else len(moving)
    return slice(begin + window, begin + window + length)


@dataclass(frozen=True)
class ReducedCycle:
    """Rows of a cycle: means over blocks of period_s.

    temperatures_degc: (n, k). output_dph: (n,). dwell: rows of the first settled dwell. truth_dph: mean output there,
    with its standard uncertainty for white noise, truth_u_dph (NaN for one row). error_dph: output - truth, (n,).
    """

    period_s: float
    temperatures_degc: Array
    output_dph: Array
    dwell: slice
    truth_dph: float
    truth_u_dph: float

    @property
    def error_dph(self) -> Array:
        """Output minus truth, (n,)."""
        return np.asarray(self.output_dph - self.truth_dph)

    @property
    def centred_dph(self) -> Array:
        """Output minus its mean over the cycle, (n,), as `bp` takes it."""
        return np.asarray(self.output_dph - self.output_dph.mean())


def reduce_cycle(
    output_dph: Array, temperatures_degc: Array, sample_period_s: float, averaging_s: float = AVERAGING_S
) -> ReducedCycle:
    """Average samples (n,) and temperatures (n, k) over blocks, and take the truth from the first settled dwell.

    ValueError if the shapes differ, a value is not finite, or there is no whole block or no settled dwell.
    """
    if output_dph.ndim != 1 or temperatures_degc.ndim != 2 or len(output_dph) != len(temperatures_degc):
        raise ValueError(
            f"cycle: output of shape {output_dph.shape} and temperatures of shape {temperatures_degc.shape}; allowed: "
            "(n,) and (n, k) of the same n."
        )
    if not (np.isfinite(output_dph).all() and np.isfinite(temperatures_degc).all()):
        raise ValueError("cycle: a value is NaN or infinite; cut the gap out and treat the parts as records.")
    rows = block_rows(averaging_s, sample_period_s)
    output, temperatures = block_means(output_dph, rows), block_means(temperatures_degc, rows)
    dwell = first_dwell(temperatures.mean(axis=1), averaging_s)
    quiet = output[dwell]
    spread = float(quiet.std(ddof=1) / np.sqrt(len(quiet))) if len(quiet) > 1 else float("nan")
    return ReducedCycle(averaging_s, temperatures, output, dwell, float(quiet.mean()), spread)


@dataclass(frozen=True)
class BiasStability:
    """GJB bias stability: std (divisor n - 1) of n non-overlapping block means of length averaging_s.

    low_dph, high_dph: 95 % interval for white noise, chi-square. Not the bias instability of an Allan curve, and it
    grows with the length of the record (gyro_test_metrics.md, sections 3 and 4).
    """

    value_dph: float
    blocks: int
    averaging_s: float
    low_dph: float
    high_dph: float


def bias_stability(values_dph: Array, period_s: float, averaging_s: float = AVERAGING_S) -> BiasStability:
    """Of values (n,) every period_s, not detrended; ValueError for fewer than two whole blocks."""
    means = block_means(values_dph, block_rows(averaging_s, period_s))
    count = len(means)
    if count < 2:
        raise ValueError(f"cycle: one block of {averaging_s:g} s has no spread; bias stability needs two or more.")
    value, tail = float(means.std(ddof=1)), 0.5 * (1.0 - _CONFIDENCE)
    upper, lower = chdtri(count - 1, tail), chdtri(count - 1, 1.0 - tail)  # chdtri takes the upper tail
    shares = np.sqrt((count - 1) / np.array([upper, lower]))
    return BiasStability(value, count, averaging_s, float(value * shares[0]), float(value * shares[1]))


@dataclass(frozen=True)
class CycleFigures:
    """Of what is left after compensation: mean, mean absolute and mean square error over rows, and bias stability."""

    rows: int
    mean_dph: float
    mae_dph: float
    mse_dph2: float
    stability: BiasStability


def figures(residual_dph: Array, period_s: float, averaging_s: float = AVERAGING_S) -> CycleFigures:
    """Figures of residuals (n,) every period_s; mae and mse of the residuals as they are, not centred."""
    return CycleFigures(
        len(residual_dph),
        float(residual_dph.mean()),
        float(np.abs(residual_dph).mean()),
        float(residual_dph @ residual_dph / len(residual_dph)),
        bias_stability(residual_dph, period_s, averaging_s),
    )


def improvement_percent(before: float, after: float) -> float:
    """By how much a figure fell, in per cent of what it was; ValueError if it was not above zero."""
    if not before > 0.0:
        raise ValueError(f"cycle: an improvement on {before!r} has no meaning; allowed: a figure above zero.")
    return 100.0 * (1.0 - after / before)
