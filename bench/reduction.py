"""From frames to samples to a point: the statistics a calibration reports for one DUT at one condition."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Outlier rule: farther than 6 scaled median absolute deviations from the median (gyro_test_metrics 8.5 asks for a
# logged rule, e.g. 6 MAD; 1.4826 makes the MAD of normal noise its standard deviation). White noise of 1000 samples
# loses one to it once in half a million points.
OUTLIER_MADS = 6.0
MAD_TO_SIGMA = 1.4826
# The same rule on frames; farther out, for there are many more of them, and looked at through a part of them: white
# noise of 60 000 frames loses one to it once in a billion points.
SPIKE_MADS = 8.0
SPIKE_PART = 500
# Consecutive frames that may be a spike. What is off for longer is motion or a step, and stays in the samples.
SPIKE_FRAMES = 3
# A run of equal frames is frozen output if noise would show such a run once in so many points.
HELD_ODDS = 1e9
# Equal frames that are a run at all, and frames per change of an output that is frozen altogether.
HELD_LEAST, HELD_CHANGES = 10, 1000


@dataclass(frozen=True)
class Samples:
    """One row per interval; NaN where no good frame fell into it.

    rate_dps, temperature_degc: float64[n]; frames: int64[n], good frames used.
    """

    rate_dps: Floats
    temperature_degc: Floats
    frames: NDArray[np.int64]


@dataclass(frozen=True)
class PointStatistics:
    """Statistics of one point; rates in deg/s, temperature in degC, its slope in degC/min."""

    rate_mean_dps: float
    rate_std_dps: float
    rate_mean_u_dps: float
    samples: int
    outliers: int
    dut_temperature_degc: float
    dut_temperature_slope_degc_min: float
    dut_temperature_slope_u_degc_min: float


def intervals_of(offset: NDArray[np.int64], frames_per_interval: float) -> NDArray[np.int64]:
    """The interval of each frame, int64[n]; `offset` is its number minus that of the first frame.

    Frame k belongs to interval floor((k + ½) / frames_per_interval), the one its middle lies in on the gyro's own
    clock, so that arrival jitter moves no frame.
    """
    interval: NDArray[np.int64] = np.floor((offset + 0.5) / frames_per_interval).astype(np.int64)
    return interval


def to_samples(
    offset: NDArray[np.int64],
    rate_dps: Floats,
    temperature_degc: Floats,
    good: NDArray[np.bool_],
    frames_per_sample: float,
    count: int,
    newest: bool = False,
) -> Samples:
    """Assign frames to the intervals of an acquisition and reduce each.

    `offset` is the frame index minus that of the first frame of the acquisition, rising; `intervals_of` says which
    interval a frame belongs to. A sample is the mean of its good frames, or the newest of them.
    """
    whole = round(frames_per_sample)
    if whole == frames_per_sample and len(offset) == whole * count and good.all() and offset[-1] == whole * count - 1:
        return _regular(rate_dps, temperature_degc, whole, count, newest)
    interval = intervals_of(offset, frames_per_sample)
    use = good & (interval >= 0) & (interval < count)
    interval, rate, temperature = interval[use], rate_dps[use], temperature_degc[use]
    frames = np.bincount(interval, minlength=count).astype(np.int64)
    if newest:
        return Samples(_last(interval, rate, count), _last(interval, temperature, count), np.minimum(frames, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        means = [np.bincount(interval, values, minlength=count) / frames for values in (rate, temperature)]
    return Samples(means[0], means[1], frames)


def _regular(rate: Floats, temperature: Floats, whole: int, count: int, newest: bool) -> Samples:
    rows, temperatures = rate.reshape(count, whole), temperature.reshape(count, whole)
    if newest:
        return Samples(rows[:, -1].copy(), temperatures[:, -1].copy(), np.ones(count, np.int64))
    return Samples(rows.mean(axis=1), temperatures.mean(axis=1), np.full(count, whole, np.int64))


def _last(interval: NDArray[np.int64], values: Floats, count: int) -> Floats:
    result = np.full(count, np.nan)
    result[interval] = values  # numpy assigns in order, so the newest frame of an interval stays
    return result


def point_statistics(samples: Samples, every_s: float) -> PointStatistics | None:
    """Mean, spread, uncertainty and temperature of a point; None if no sample is left.

    Outliers by the rule above are counted and left out. `every_s` is the interval of the samples.
    """
    present = np.isfinite(samples.rate_dps)
    rate = samples.rate_dps[present]
    if not rate.size:
        return None
    kept = ~outliers(rate)
    clean: Floats = rate[kept]
    times_min: Floats = np.flatnonzero(present).astype(np.float64) * (every_s / 60.0)
    return PointStatistics(
        rate_mean_dps=float(clean.mean()),
        rate_std_dps=float(clean.std(ddof=1)) if clean.size > 1 else float("nan"),
        rate_mean_u_dps=standard_uncertainty(clean),
        samples=int(clean.size),
        outliers=int(rate.size - clean.size),
        dut_temperature_degc=float(samples.temperature_degc[present].mean()),
        dut_temperature_slope_degc_min=slope(times_min, samples.temperature_degc[present]),
        dut_temperature_slope_u_degc_min=slope_uncertainty(times_min, samples.temperature_degc[present]),
    )


def outliers(values: Floats) -> NDArray[np.bool_]:
    """Which values are farther than 6 scaled MAD from the median; none if more than half of them are equal.

    >>> outliers(np.array([1.0, 1.1, 0.9, 1.05, 9.0]))
    array([False, False, False, False,  True])
    """
    distance = np.abs(values - np.median(values))
    spread = MAD_TO_SIGMA * float(np.median(distance))
    if spread == 0.0:
        return np.zeros(values.shape, bool)
    return distance > OUTLIER_MADS * spread


def spikes(rate_dps: Floats, good: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Which good frames are spikes: at most three in a row, farther than 8 scaled MAD from the median; None if none.

    Median and MAD are those of some five hundred frames, spread without a period. Where more than half of these are
    equal, their resolution takes the place of the MAD.
    """
    values = rate_dps if good.all() else rate_dps[good]
    part = values[_spread(values.size)] if values.size > SPIKE_PART else values
    if part.size < HELD_LEAST:
        return None
    middle = part.size // 2
    centre = np.partition(part, middle)[middle]
    distance = np.abs(part - centre)
    spread = MAD_TO_SIGMA * np.partition(distance, middle)[middle]
    if spread == 0.0:
        spread = distance[distance > 0.0].min(initial=np.inf)
    reach = SPIKE_MADS * spread
    if values.max() - centre <= reach and centre - values.min() <= reach:
        return None
    far = np.flatnonzero(good & (np.abs(rate_dps - centre) > reach))
    runs = np.split(far, np.flatnonzero(np.diff(far) > 1) + 1)
    found = np.zeros(rate_dps.shape, bool)
    found[np.concatenate([far[:0], *(run for run in runs if run.size <= SPIKE_FRAMES)])] = True
    return found if found.any() else None


@lru_cache(maxsize=16)
def _spread(size: int) -> NDArray[np.intp]:
    """SPIKE_PART places below `size`, even but without a period: multiples of the golden ratio modulo one.

    Every k-th frame would meet an encoder's ripple at one phase whenever k frames are whole turns of it.
    """
    return np.asarray(np.arange(SPIKE_PART) * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0 * size, dtype=np.intp)


def held_frames(raw: NDArray[np.generic]) -> int:
    """How many frames only repeat the one before although noise would not: the output was frozen.

    A run of equal frames counts from the length on that noise has once in 10⁹ points. Of counts so coarse that many are
    equal by nature, half of the runs may be short excursions; the other half are geometric in length, so that one in
    ten runs being longer than q, one in 2 · 5^(L/q) is longer than L.
    """
    n = raw.size
    same = raw[1:] == raw[:-1]
    repeats = int(np.count_nonzero(same))
    if n <= HELD_LEAST or repeats < HELD_LEAST:
        return 0
    if (n - repeats) * HELD_CHANGES < n or repeats == n - 1:
        return repeats
    shortest = float(np.log(n * HELD_ODDS / 2.0) / np.log(5.0))
    # A run of the shortest length that counts fills at least one whole block.
    block = int(shortest) // 2
    if not same[: same.size // block * block].reshape(-1, block).all(axis=1).any():
        return 0
    lengths = np.diff(np.flatnonzero(np.concatenate(([True], ~same, [True]))))
    tenth = max(1, lengths.size // 10)
    long = lengths[lengths >= shortest * np.partition(lengths, -tenth)[-tenth]]
    return int((long - 1).sum())


def standard_uncertainty(values: Floats) -> float:
    """Standard uncertainty of the mean, type A, honest about correlated noise.

    Non-overlapping batch means, √n batches: u = s(batch means)/√(number of batches), which counts drift and correlation
    up to a batch length; never less than the white-noise figure s/√n. Flicker slower than the record is in no statistic
    of one record. NaN for fewer than 2 values.
    """
    n = values.size
    if n < 2:
        return float("nan")
    white = float(values.std(ddof=1)) / float(np.sqrt(n))
    batches = int(np.sqrt(n))
    if batches < 4:
        return white
    length = n // batches
    means = values[: length * batches].reshape(batches, length).mean(axis=1)
    return max(white, float(means.std(ddof=1)) / float(np.sqrt(batches)))


def slope(times: Floats, values: Floats) -> float:
    """Least-squares slope of `values` over `times`, in units of value per time; 0 for fewer than two instants."""
    if values.size < 2:
        return 0.0
    centred = times - times.mean()
    spread = float(centred @ centred)
    return float(centred @ (values - values.mean())) / spread if spread > 0 else 0.0


def slope_uncertainty(times: Floats, values: Floats) -> float:
    """Standard uncertainty of `slope` from the scatter about the line; infinite for fewer than three instants.

    Widened by √((1 + r)/(1 − r)) for the lag-one correlation r of the residuals: a sensor that renews its reading once
    a second gives several samples the same value.
    """
    centred = times - times.mean()
    spread = float(centred @ centred)
    if values.size < 3 or spread == 0.0:
        return float("inf")
    residual = values - values.mean() - slope(times, values) * centred
    power = float(residual @ residual)
    if power == 0.0:
        return 0.0
    correlation = min(max(float(residual[1:] @ residual[:-1]) / power, 0.0), 0.99)
    return float(np.sqrt(power / (values.size - 2) / spread * (1 + correlation) / (1 - correlation)))
