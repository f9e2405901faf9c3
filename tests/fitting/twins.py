"""Synthetic twins of the thermal-cycle experiments `bp` and `rlg`, for tests and benchmarks.

Gyros with a thermal chain air -> housing -> outer coil -> inner coil and a bias that depends on the state of that
chain, not only on the temperature somebody measures; every unit differs by 30 %. Rows are means over 100 s.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
Leg = tuple[float, float]  # setpoint in degC, minutes after which it is reached

STEP_S, ROW_S = 10.0, 100.0
BP_FLOOR_DPH, RLG_FLOOR_DPH = 0.011, 0.0052  # std of a row's white noise: the published std at room temperature
BP_RAW, RLG_RAW = 8.0, 5.0  # std of the uncompensated bias, in floors


@dataclass(frozen=True)
class Cycle:
    """temperatures_degc: (n, k) as measured; bias_dph, smooth_dph: (n,) with and without noise; floor_dph: its std."""

    temperatures_degc: Array
    bias_dph: Array
    smooth_dph: Array
    floor_dph: float


def steps(start: float, setpoints: list[float], ramp_degc_min: float, dwell_min: float) -> list[Leg]:
    """Ramps from one setpoint to the next, with a dwell at each."""
    legs = []
    for setpoint in setpoints:
        legs += [(setpoint, abs(setpoint - start) / ramp_degc_min), (setpoint, dwell_min)]
        start = setpoint
    return legs


def air(start: float, legs: list[Leg]) -> Array:
    """Air temperature every STEP_S seconds along the legs, (n + 1,)."""
    times = np.concatenate([[0.0], np.cumsum([60.0 * minutes for _, minutes in legs])])
    return np.interp(np.arange(0.0, times[-1] + STEP_S / 2, STEP_S), times, [start, *[leg[0] for leg in legs]])


def chain(air_degc: Array, tau_s: Array) -> Array:
    """Temperatures of nodes in series behind the air, (len(tau), n + 1), steady at first; exact for linear pieces."""
    size = len(tau_s)
    system = np.zeros((size + 2, size + 2))
    system[:size, :size] = np.diag(-1.0 / tau_s) + np.diag(1.0 / tau_s[1:], -1)
    system[0, size], system[size, size + 1] = 1.0 / tau_s[0], 1.0 / STEP_S
    step = scipy.linalg.expm(system * STEP_S)[:size]
    nodes = np.empty((len(air_degc), size))
    nodes[0] = air_degc[0]
    for i, (now, later) in enumerate(pairwise(air_degc)):
        nodes[i + 1] = step @ np.concatenate([nodes[i], [now, later - now]])
    return nodes.T


def rows(values: Array) -> Array:
    """Means over 100 s of values (..., n + 1) known every STEP_S, linear between."""
    middles = 0.5 * (values[..., 1:] + values[..., :-1])
    block = round(ROW_S / STEP_S)
    count = middles.shape[-1] // block
    return np.asarray(middles[..., : count * block].reshape(*values.shape[:-1], count, block).mean(axis=-1))


def _slope(values: Array) -> Array:
    """Time derivative in degC/min."""
    return np.asarray(np.gradient(values, STEP_S / 60.0, axis=-1))


def _vary(rng: np.random.Generator, nominal: list[float]) -> Array:
    return np.asarray(nominal) * (1.0 + 0.3 * rng.uniform(-1.0, 1.0, len(nominal)))


def _bp_unit(seed: int) -> Callable[[Array], tuple[Array, Array]]:
    """One FOG: air -> (its thermometer, its bias in arbitrary units). simulation_models.md, section 3.2."""
    rng = np.random.default_rng([seed, 1])
    tau_s = _vary(rng, [1200.0, 480.0, 600.0])
    b1, b2, c1, c2, c3, drift, bump, sensor_s = _vary(rng, [1.0e-3, 2e-5, 0.15, 0.3, 0.01, 0.003, 0.02, 20.0])

    def gyro(air_degc: Array) -> tuple[Array, Array]:
        _, outer, inner = chain(air_degc, tau_s)
        shupe = c1 * _slope(outer) + c2 * _slope(outer - inner) + c3 * (outer - inner)
        # dn/dT grows by some 1e-3 per degC; the up and down branches differ by a saturating part of the slope.
        bias = b1 * inner + b2 * (inner - 25.0) ** 2 + shupe * (1.0 + drift * (inner - 25.0) / 10.0)
        bias += bump * np.exp(-0.5 * ((inner - 5.0) / 10.0) ** 2) + 0.005 * np.tanh(_slope(inner) / 0.2)
        return outer - sensor_s / 60.0 * _slope(outer), bias

    return gyro


def _bp_air(room_degc: float) -> Array:
    down = [40.0, 20.0, 0.0, -20.0, -40.0]
    legs = steps(room_degc, [60.0, *down, *[-20.0, 0.0, 20.0, 40.0, 60.0]], 0.4, 30.0)
    return air(room_degc, legs)


@cache
def bp(seed: int, cycle: int = 0) -> Cycle:
    """Cycle 0, 1, ... of unit `seed` through the stepped profile: 498 rows, logged from the first dwell at 60 degC.

    830 minutes are a dwell of 30 and ten steps of 80: the ramp from room temperature is not in the log, so a record
    begins with the gyro still warming.
    """
    rng = np.random.default_rng([seed, 2, cycle])
    gyro, scale = _bp_unit(seed), BP_RAW * BP_FLOOR_DPH
    smooth_of = [_last(*gyro(_bp_air(room)), 498) for room in (24.0, 24.0 + rng.uniform(-2.0, 2.0))]
    scale /= smooth_of[0][1].std()
    temperature, smooth = smooth_of[1][0][:, np.newaxis], scale * smooth_of[1][1]
    noise = BP_FLOOR_DPH * rng.standard_normal(len(smooth))
    measured = temperature + 0.002 * rng.standard_normal(temperature.shape)
    return Cycle(measured, smooth + noise + 0.01 * rng.standard_normal(), smooth, BP_FLOOR_DPH)


def _last(temperature: Array, bias: Array, count: int) -> tuple[Array, Array]:
    """The last rows of both, means over 100 s counted from the end."""
    spare = (len(bias) - 1) % round(ROW_S / STEP_S)
    return rows(temperature[spare:])[-count:], rows(bias[spare:])[-count:]


def rlg_air(profile: str, room_degc: float = 25.0) -> Array:
    """'cycle': the published one, 336 rows; 'steps': twice as slow, with two dwells on the way."""
    if profile == "cycle":
        return air(room_degc, [(room_degc, 150.0), *steps(room_degc, [-30.0, room_degc], 1.0, 150.0)])
    return air(room_degc, [(room_degc, 100.0), *steps(room_degc, [0.0, -28.0, -10.0, room_degc], 0.5, 80.0)])


@cache
def rlg(seed: int, cycle: int = 0, profile: str = "cycle") -> Cycle:
    """Cycle 0, 1, ... of unit `seed`: anode, cathode and inner case; E = D_T dT + D_grad grad T + D_dot dT/dt."""
    unit, rng = np.random.default_rng([seed, 3]), np.random.default_rng([seed, 4, cycle, profile == "steps"])
    tau_s = _vary(unit, [900.0, 400.0, 400.0, 500.0])
    d_t, d_square, d_grad, d_cross, d_dot, d_body = _vary(unit, [4e-4, 8e-6, 2e-3, 1e-3, 0.009, 3e-3])

    def gyro(air_degc: Array) -> tuple[Array, Array]:
        case, cathode, anode, body = chain(air_degc, tau_s)  # no thermometer is on the body
        bias = d_t * body + d_square * (body - 10.0) ** 2 + d_dot * _slope(cathode) + d_body * (body - anode)
        bias += 0.001 * np.tanh(_slope(body) / 0.3)  # the branches up and down differ
        return np.array([anode, cathode, case]), bias + d_grad * (anode - cathode) + d_cross * (cathode - case)

    scale = RLG_RAW * RLG_FLOOR_DPH / rows(gyro(rlg_air("cycle"))[1]).std()
    temperatures, bias = gyro(rlg_air(profile, 25.0 + rng.uniform(-0.5, 0.5)))
    smooth = scale * rows(bias)
    measured = rows(temperatures).T + 0.002 * rng.standard_normal((len(smooth), 3))
    noise = RLG_FLOOR_DPH * rng.standard_normal(len(smooth))
    return Cycle(measured, smooth + noise + 0.002 * rng.standard_normal(), smooth, RLG_FLOOR_DPH)
