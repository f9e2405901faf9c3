"""Deterministic errors of a gyro: output = (1 + S(T)) f(Ω) + B(T), temperatures in °C, rates in deg/s."""

from collections.abc import Callable

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from simulated_hw.physics.gyro_parameters import CurveParameters, GyroParameters, SurfaceParameters

DPH_PER_DPS = 3600.0
_PPM = 1e-6

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class ErrorModel:
    """Scale-factor curve S, bias curve B and rate response f of one gyro."""

    def __init__(self, parameters: GyroParameters) -> None:
        surface = parameters.model == "surface_a"
        source = parameters.surface if surface else parameters.curves
        self.alpha = source.alpha
        self.k3 = 0.0 if surface else parameters.curves.k3_ppm * _PPM / parameters.max_rate_dps**2
        self.asymmetry = 0.0 if surface else parameters.curves.asymmetry_ppm * _PPM
        self.dead_band_dps = 0.0 if surface else parameters.curves.dead_band_dph / DPH_PER_DPS
        self.scale, self.bias_dps = _surface(parameters.surface) if surface else _curves(parameters.curves)

    def respond(self, rate_dps: NDArray[np.float64]) -> NDArray[np.float64]:
        """f(Ω): the Sagnac sine of an open loop, k3 and asymmetry. Works in place: the argument is overwritten."""
        ideal = rate_dps.copy() if self.k3 or self.asymmetry else rate_dps
        if self.alpha:
            np.multiply(rate_dps, self.alpha, out=rate_dps)
            np.sin(rate_dps, out=rate_dps)
            np.multiply(rate_dps, 1.0 / self.alpha, out=rate_dps)
        if self.k3 or self.asymmetry:
            rate_dps *= 1.0 + self.k3 * ideal * ideal + self.asymmetry * np.sign(ideal)
        return rate_dps

    def output_dps(self, temperature_degc: NDArray[np.float64], rate_dps: NDArray[np.float64]) -> NDArray[np.float64]:
        """The output without noise, broadcasting temperature against rate."""
        temperature, rate = np.broadcast_arrays(temperature_degc, rate_dps)
        response = self.respond(np.array(rate, dtype=np.float64))
        return (1.0 + self.scale(temperature)) * response + self.bias_dps(temperature)


def stuck_in_dead_band(rate_dps: NDArray[np.float64], band_dps: float) -> NDArray[np.float64]:
    """What a closed loop that sticks at 0 within ± band makes of it; far beyond the band, nothing."""
    size = np.abs(rate_dps)
    free = rate_dps - np.copysign(band_dps * np.exp(-np.maximum(size - band_dps, 0.0) / band_dps), rate_dps)
    return np.where(size < band_dps, 0.0, free)


def _surface(p: SurfaceParameters) -> tuple[Curve, Curve]:
    def scale(temperature: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(p.k0 + p.k1 * np.tanh((temperature - p.t0_degc) / p.w_k))

    def bias(temperature: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(p.b0_dps + p.b1_dps * ((temperature - p.centre_degc) / p.half_span_k))

    return scale, bias


def _curves(p: CurveParameters) -> tuple[Curve, Curve]:
    scale = _curve(p.reference_degc, p.scale_polynomial, p.scale_temperatures_degc, p.scale_values_ppm, _PPM)
    bias = _curve(p.reference_degc, p.bias_polynomial, p.bias_temperatures_degc, p.bias_values_dph, 1.0 / DPH_PER_DPS)
    return scale, bias


def _curve(
    reference: float, coefficients: tuple[float, ...], at: tuple[float, ...], values: tuple[float, ...], unit: float
) -> Curve:
    if at:
        xs, ys = np.array(at), np.array(values) * unit
        return lambda temperature: np.asarray(np.interp(temperature, xs, ys))
    c = np.array(coefficients or (0.0,)) * unit
    return lambda temperature: np.asarray(polynomial.polyval(temperature - reference, c), dtype=np.float64)
