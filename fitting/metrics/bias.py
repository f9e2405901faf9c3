"""Bias, its stability within a run and its repeatability between power cycles (GJB 2426A family).

Bias *stability* is the spread of block means of a fixed length. It is neither the bias *instability* (coefficient B of
the Allan fit) nor the Allan *minimum*: those are in `allan_figures`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.metrics.figure import Figure, standard_deviation, with_u
from fitting.random_errors.mean import noise_of_mean

_DPH_PER_DPS = 3600.0


@dataclass(frozen=True)
class ScaleFactor:
    """K in output units per deg/s and its standard uncertainty; 1 for a gyro that already gives deg/s."""

    value: float = 1.0
    u: float = 0.0


@dataclass(frozen=True)
class InputRate:
    """Earth rate along the input axis in deg/h and its standard uncertainty."""

    value_dph: float
    u_dph: float = 0.0


def to_dph(output: ArrayLike, scale: ScaleFactor) -> NDArray[np.float64]:
    """Output (n,) as equivalent input rate in deg/h: K first, earth rate later. ValueError: samples are missing."""
    rate = np.asarray(output, dtype=np.float64) / scale.value * _DPH_PER_DPS
    missing = int(np.count_nonzero(~np.isfinite(rate)))
    if missing:
        raise ValueError(
            f"{missing} of {rate.size} samples are not finite. Fill short gaps by rule (random_errors.gaps), cut at "
            "long ones: closed up, they would shift every block after them"
        )
    return rate


def bias(output: ArrayLike, interval_s: float, scale: ScaleFactor, earth: InputRate) -> Figure:
    """B0 = mean(output) / K - earth rate, of a static record (n,) in output units, n >= 30.

    Its uncertainty joins the correlated noise of the mean, K and the earth rate.
    """
    rate = to_dph(output, scale)
    mean, noise = float(rate.mean()), noise_of_mean(rate, interval_s)
    parts = np.array([noise.u, mean * scale.u / scale.value, earth.u_dph])
    u = float(np.sqrt(np.sum(parts**2)))
    dof = noise.dof * (u / noise.u) ** 4 if noise.u > 0.0 else np.inf
    definition = (
        f"mean output of {len(rate) * interval_s:.6g} s divided by K = {scale.value:.9g} output/(deg/s), "
        f"minus the earth rate along the input axis, {earth.value_dph:.6g} deg/h"
    )
    return with_u(
        "bias",
        "B0",
        mean - earth.value_dph,
        "deg/h",
        u=u,
        dof=dof,
        n=len(rate),
        definition=definition,
        source="GJB 2426A bias",
    )


@dataclass(frozen=True)
class BiasStability:
    """The figure by definition, and a second one with a straight line taken out of the block means."""

    as_defined: Figure
    detrended: Figure


def block_means(rate: NDArray[np.float64], interval_s: float, block_s: float) -> NDArray[np.float64]:
    """Means of successive blocks that do not overlap; what does not fill a block at the end is left out.

    ValueError: block_s is not a whole number of samples, or fewer than three blocks.
    """
    per_block = round(block_s / interval_s)
    if per_block < 1 or abs(per_block * interval_s - block_s) > 1e-6 * block_s:
        raise ValueError(f"blocks of {block_s} s of samples every {interval_s} s. Allowed: a whole number of samples")
    count = len(rate) // per_block
    if count < 3:
        raise ValueError(f"{count} blocks of {block_s} s in {len(rate) * interval_s} s. Allowed: 3 or more")
    return np.asarray(rate[: count * per_block].reshape(count, per_block).mean(axis=1))


def bias_stability(output: ArrayLike, interval_s: float, block_s: float, scale: ScaleFactor) -> BiasStability:
    """Bs: standard deviation of block means, 1 sigma, in deg/h, of a static record (n,) in output units.

    The chi-square limits take the blocks as independent, which holds for white noise; flicker and drift make Bs grow
    with the record, which is why its length stands in the definition.
    """
    rate = to_dph(output, scale)
    means = block_means(rate, interval_s, block_s)
    return _stability(
        means, "bias stability", f"Bs({block_s:g} s)", f"{block_s:g} s of a record of {len(rate) * interval_s:.6g} s"
    )


def full_temperature_bias_stability(
    output: ArrayLike, interval_s: float, block_s: float, scale: ScaleFactor
) -> BiasStability:
    """BsT: the same over a whole temperature cycle, low to high to low."""
    rate = to_dph(output, scale)
    means = block_means(rate, interval_s, block_s)
    blocks = f"{block_s:g} s over a whole temperature cycle of {len(rate) * interval_s:.6g} s"
    return _stability(means, "full-temperature bias stability", f"BsT({block_s:g} s)", blocks)


def _stability(means: NDArray[np.float64], name: str, symbol: str, blocks: str) -> BiasStability:
    text = f"standard deviation (1 sigma, n - 1) of means of non-overlapping blocks of {blocks}"
    source = "GJB 2426A bias stability; not the bias instability of IEEE Std 952"
    centred = means - means.mean()
    as_defined = standard_deviation(centred, name, symbol, "deg/h", definition=f"{text}, not detrended", source=source)
    time = np.arange(len(means)) - 0.5 * (len(means) - 1)
    detrended = standard_deviation(
        centred - time * (time @ centred) / (time @ time),
        f"{name}, detrended",
        symbol,
        "deg/h",
        fitted=2,
        definition=f"{text}, after a straight line is taken out (n - 2)",
        source=source,
    )
    return BiasStability(as_defined, detrended)


def bias_repeatability(biases_dph: ArrayLike) -> Figure:
    """Br: standard deviation of the biases (Q,) of Q power cycles, in deg/h; GJB asks for Q >= 6."""
    values = np.asarray(biases_dph, dtype=np.float64)
    definition = f"standard deviation (Q - 1) of the bias of Q = {len(values)} power cycles with cool-down between"
    return standard_deviation(
        values - values.mean(),
        "bias repeatability",
        "Br",
        "deg/h",
        definition=definition + ("" if len(values) >= 6 else "; fewer than the 6 of the standard"),
        source="GJB 2426A bias repeatability",
    )
