"""Exact generators of block means for the tests (simulation models, section 4); rates in deg/h, times in s."""

from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def white(rng: np.random.Generator, n: int, dt: float, arw: float) -> Array:
    """Angle random walk, deg/sqrt(h)."""
    return 60.0 * arw / sqrt(dt) * rng.standard_normal(n)


def random_walk(rng: np.random.Generator, n: int, dt: float, rrw: float) -> Array:
    """Rate random walk, deg/h/sqrt(h), from zero."""
    step = rrw / 60.0 * sqrt(dt)
    g = step * rng.standard_normal(n)
    return np.cumsum(g) - 0.5 * g + step / sqrt(12.0) * rng.standard_normal(n)


def gauss_markov(rng: np.random.Generator, n: int, dt: float, variance: float, tc: float) -> Array:
    """Means over dt of a stationary process with correlation time tc."""
    r = dt / tc
    a = np.exp(-r)
    var_w = -variance * np.expm1(-2.0 * r)
    small = 2.0 * r**3 / 3.0 - r**4 / 2.0
    var_v = variance * tc**2 * (small if r < 1e-3 else 2.0 * r - 3.0 + 4.0 * a - a**2)
    cov = variance * tc**2 / tc * np.expm1(-r) ** 2
    g = rng.standard_normal((2, n))
    w = sqrt(var_w) * g[0]
    v = cov / sqrt(var_w) * g[0] + sqrt(max(var_v - cov**2 / var_w, 0.0)) * g[1]
    start = sqrt(variance) * rng.standard_normal()
    state, _ = lfilter([1.0], [1.0, -a], w, zi=[a * start])
    before = np.concatenate([[start], state[:-1]])
    return (tc * -np.expm1(-r) * before + v) / dt


def flicker(rng: np.random.Generator, n: int, dt: float, bias_instability: float) -> Array:
    """Bias instability B in deg/h: a bank of processes a factor of three apart, from dt / 30 to 10 n dt."""
    tc = dt / 30.0 * 3.0 ** np.arange(np.ceil(log(300.0 * n) / log(3.0)) + 1)
    variance = 2.0 * log(2.0) / pi * bias_instability**2 * log(3.0) / (2.0 * log(2.0))
    return np.sum([gauss_markov(rng, n, dt, variance, float(t)) for t in tc], axis=0)


def quantised(rate: Array, dt: float, lsb_arcsec: float) -> Array:
    """The angle rounded down to whole steps, its residue carried (deg/h times s is arcsec)."""
    counts = np.floor(np.cumsum(rate) * dt / lsb_arcsec)
    return np.diff(counts, prepend=0.0) * lsb_arcsec / dt


def ramp(n: int, dt: float, slope: float) -> Array:
    """Rate ramp in deg/h/h."""
    return slope * (np.arange(n) + 0.5) * dt / 3600.0
