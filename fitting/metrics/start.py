"""Turn-on and warm-up time: when the output of a gyro started cold comes into a band and stays."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.metrics.bias import block_means
from fitting.metrics.figure import Figure, with_u


def time_to_band_s(
    rate_dph: NDArray[np.float64], interval_s: float, block_s: float, band_dph: tuple[float, float]
) -> float:
    """End of the first block whose mean lies in the band and after which every mean does, in s after power-on."""
    means = block_means(rate_dph, interval_s, block_s)
    outside = np.flatnonzero((means < band_dph[0]) | (means > band_dph[1]))
    first = int(outside[-1]) + 1 if len(outside) else 0
    if first == len(means):
        raise ValueError(
            f"the last mean, {means[-1]:.6g} deg/h, is outside {band_dph[0]:g} ... {band_dph[1]:g} deg/h: never "
            "in the band for good. Record longer, or widen the band"
        )
    return float((first + 1) * block_s)


def turn_on_time(
    starts_dph: Sequence[ArrayLike], interval_s: float, block_s: float, band_dph: tuple[float, float]
) -> Figure:
    """t_on: the longest of several cold starts, records (n,) from power-on in deg/h, in s.

    band_dph: for the turn-on time the band of usable output, for the warm-up time that of specified performance.
    """
    times = np.array(
        [time_to_band_s(np.asarray(r, dtype=np.float64), interval_s, block_s, band_dph) for r in starts_dph]
    )
    spread = float(times.std(ddof=1)) if len(times) > 1 else 0.0
    return with_u(
        "turn-on time",
        "t_on",
        float(times.max()),
        "s",
        u=float(np.hypot(block_s / np.sqrt(12.0), spread)),
        dof=max(len(times) - 1, 1) if spread > block_s else np.inf,
        n=len(times),
        definition=f"from power-on to the end of the first mean of {block_s:g} s inside {band_dph[0]:g} ... "
        f"{band_dph[1]:g} deg/h after which none is outside; the longest of {len(times)} cold starts",
        source="IEEE Std 528 turn-on time and warm-up time",
    )
