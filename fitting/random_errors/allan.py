"""Overlapping Allan deviation of a uniform rate record.

    sigma^2(m tau0) = sum_k (theta_(k+2m) - 2 theta_(k+m) + theta_k)^2 / (2 m^2 n),  theta_k = y_1 + ... + y_k

over all n start indices k (IEEE Std 952 annex; NIST SP 1065 eq. 11). theta is summed once, from the record without its
mean, which cancels in the second difference: that keeps all digits of small noise on a large rate. Each m is then one
pass over theta in blocks that stay in the processor's second-level cache, with no temporary of the record's length.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.random_errors.confidence import equivalent_dof, identify_noise, interval
from fitting.random_errors.gaps import stretches

# 32768 doubles: two buffers and three slices of theta fit into a second-level cache of 1 to 2 MB (measured best).
_BLOCK = 32768


@dataclass(frozen=True)
class AllanCurve:
    """Allan deviations (t,) of one record, at tau = factors * interval_s.

    differences: second differences averaged; noise_exponent: alpha of the rate's spectrum f^alpha, identified at each
    tau; edf: equivalent degrees of freedom; low_dph, high_dph: chi-square limits for `coverage`.
    samples: length of the record; missing: how many of them are missing.
    """

    interval_s: float
    factors: NDArray[np.int64]
    deviation_dph: NDArray[np.float64]
    differences: NDArray[np.int64]
    noise_exponent: NDArray[np.int64]
    edf: NDArray[np.float64]
    low_dph: NDArray[np.float64]
    high_dph: NDArray[np.float64]
    coverage: float
    samples: int
    missing: int

    @property
    def tau_s(self) -> NDArray[np.float64]:
        """Averaging times in s, (t,)."""
        return np.asarray(self.factors * self.interval_s)


def averaging_factors(samples: int, per_decade: int = 10, longest: int | None = None) -> NDArray[np.int64]:
    """Log-spaced m from 1 to `longest`, by default samples // 9 (25 % relative error of the deviation).

    >>> averaging_factors(90, per_decade=4).tolist()
    [1, 2, 3, 6, 10]
    """
    longest = samples // 9 if longest is None else longest
    if not 1 <= longest <= samples // 2:
        raise ValueError(
            f"the longest averaging factor is {longest} for {samples} samples. "
            "Allowed: 1 to half the record; the default, a ninth, needs at least 9 samples. Record longer"
        )
    steps = np.arange(int(per_decade * np.log10(longest) + 1e-9) + 1)
    return np.unique(np.round(10.0 ** (steps / per_decade)).astype(np.int64))


def allan_variances(
    rate: ArrayLike, factors: ArrayLike, *, overlapping: bool = True
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Allan variances (t,) of rate (n,), in its unit squared, and the number of second differences in each (t,).

    A NaN is a missing sample: only second differences that touch none are used. overlapping=False uses every m-th
    start index of a stretch (the plain Allan variance). Where no difference is left the variance is NaN.
    ValueError: no finite sample.
    """
    values = np.asarray(rate, dtype=np.float64)
    runs = stretches(values)
    if not runs:
        raise ValueError(f"none of the {values.size} samples is finite. Allan deviation needs a record of rates")
    mean = float(np.nanmean(values)) if len(runs) > 1 else float(values[runs[0][0] : runs[0][1]].mean())
    sums, counts = np.zeros(np.size(factors)), np.zeros(np.size(factors), np.int64)
    for first, end in runs:
        angle = _angles(values[first:end], mean)
        for i, m in enumerate(np.ravel(factors).tolist()):
            differences = len(angle) - 2 * m
            if differences > 0:
                stride = 1 if overlapping else m
                sums[i] += _squares(angle, m) if stride == 1 else _strided_squares(angle, m)
                counts[i] += -(-differences // stride)
    with np.errstate(invalid="ignore"):
        return sums / (2.0 * np.square(np.ravel(factors).astype(np.float64)) * counts), counts


def _angles(rate: NDArray[np.float64], mean: float) -> NDArray[np.float64]:
    """theta_0 = 0 and the cumulative sum of rate - mean, (n + 1,)."""
    angle = np.empty(len(rate) + 1)
    angle[0] = 0.0
    np.subtract(rate, mean, out=angle[1:])
    np.cumsum(angle[1:], out=angle[1:])
    return angle


def _squares(angle: NDArray[np.float64], m: int) -> float:
    """Sum of the squared second differences at lag m over all start indices."""
    count, total = len(angle) - 2 * m, 0.0
    later, earlier = np.empty(min(_BLOCK, count)), np.empty(min(_BLOCK, count))
    for start in range(0, count, _BLOCK):
        end = min(start + _BLOCK, count)
        a, b = later[: end - start], earlier[: end - start]
        np.subtract(angle[start + 2 * m : end + 2 * m], angle[start + m : end + m], out=a)
        np.subtract(angle[start + m : end + m], angle[start:end], out=b)
        np.subtract(a, b, out=a)
        total += float(a @ a)
    return total


def _strided_squares(angle: NDArray[np.float64], m: int) -> float:
    second = angle[2 * m :: m] - 2.0 * angle[m:-m:m] + angle[: -2 * m : m]
    return float(second @ second)


def allan_curve(
    rate_dph: ArrayLike, interval_s: float, factors: ArrayLike | None = None, coverage: float = 0.95
) -> AllanCurve:
    """The Allan curve of rate_dph (n,), sampled every interval_s, with confidence limits.

    factors: averaging factors, default `averaging_factors(n)`; those for which gaps leave no difference are dropped.
    The noise type is identified on the longest stretch without gap. ValueError: too short a record, no finite sample.
    """
    rate = np.ascontiguousarray(rate_dph, dtype=np.float64)
    wanted = averaging_factors(len(rate)) if factors is None else np.ravel(factors).astype(np.int64)
    variances, counts = allan_variances(rate, wanted)
    kept = counts > 0
    used, deviation = wanted[kept], np.sqrt(variances[kept])
    runs = stretches(rate)
    first, end = max(runs, key=lambda run: run[1] - run[0])
    exponent = identify_noise(rate[first:end], used)
    missing = int(np.count_nonzero(~np.isfinite(rate)))
    edf = equivalent_dof(exponent, used, len(rate) - missing + 1)
    low, high = interval(deviation, edf, coverage)
    return AllanCurve(interval_s, used, deviation, counts[kept], exponent, edf, low, high, coverage, len(rate), missing)
