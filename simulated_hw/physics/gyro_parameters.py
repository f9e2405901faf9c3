"""What a user may say about a simulated gyro: frozen dataclasses, checked when made."""

from dataclasses import dataclass, field
from typing import Literal

from simulated_hw.physics.parameters import require, require_finite, require_not_negative, require_positive
from simulated_hw.physics.ring_laser_parameters import RingLaserParameters
from simulated_hw.physics.seeker_parameters import SeekerParameters


@dataclass(frozen=True)
class SurfaceParameters:
    """Error surface of the `ts` kind: output = (1 + k(T)) sin(alpha Ω)/alpha + b0 + b1 t.

    k(T) = k0 + k1 tanh((T - t0)/w), t = (T - centre)/half_span. The defaults are "surface A", whose uncompensated and
    linearly compensated errors on the 684-point grid are those published for the `ts` experiment, to all digits.

    Fields:
        k0, k1: scale-factor error, dimensionless. t0_degc, w_k: where it changes, and over which width.
        alpha: Sagnac phase per input rate, rad/(°/s); 0 is a linear gyro.
        b0_dps, b1_dps: bias at the centre, and its change over half the span.
        centre_degc, half_span_k: the temperature scale of the bias.
    """

    k0: float = 0.049530876
    k1: float = 0.020260709
    t0_degc: float = 24.87441
    w_k: float = 14.0
    alpha: float = 0.0013
    b0_dps: float = 0.40871934
    b1_dps: float = 0.42963359
    centre_degc: float = 15.0
    half_span_k: float = 45.0

    def __post_init__(self) -> None:
        require_finite(self, "k0", "k1", "t0_degc", "b0_dps", "b1_dps", "centre_degc")
        require_positive(self, "w_k", "half_span_k")
        require_not_negative(self, "alpha")


@dataclass(frozen=True)
class CurveParameters:
    """Errors as curves: output = (1 + S(T)) f(Ω) + B(T).

    S and B are a polynomial in T - reference, or, if temperatures are given, a table interpolated linearly and held
    beyond its ends. f(Ω) = sin(alpha Ω)/alpha · (1 + k3 (Ω/Ω_max)² + asymmetry sign(Ω)).

    Fields:
        reference_degc: where the polynomials have their origin.
        scale_polynomial: coefficients in ppm, ppm/K, ppm/K², …
        scale_temperatures_degc, scale_values_ppm: the table instead of it.
        bias_polynomial: coefficients in deg/h, deg/h/K, deg/h/K², …
        bias_temperatures_degc, bias_values_dph: the table instead of it.
        alpha: Sagnac phase per input rate of an open-loop gyro, rad/(°/s); 0 for a closed loop.
        k3_ppm, asymmetry_ppm: scale-factor nonlinearity at full rate, and difference between the two senses (half).
        dead_band_dph: within ± this a closed loop sticks at 0 (cross-talk). It acts on all that is measured, bias and
            the noise of each frame included: noise above it fills it, as in reality. 0 for none.
    """

    reference_degc: float = 25.0
    scale_polynomial: tuple[float, ...] = ()
    scale_temperatures_degc: tuple[float, ...] = ()
    scale_values_ppm: tuple[float, ...] = ()
    bias_polynomial: tuple[float, ...] = ()
    bias_temperatures_degc: tuple[float, ...] = ()
    bias_values_dph: tuple[float, ...] = ()
    alpha: float = 0.0
    k3_ppm: float = 0.0
    asymmetry_ppm: float = 0.0
    dead_band_dph: float = 0.0

    def __post_init__(self) -> None:
        require_finite(self, "reference_degc", "scale_polynomial", "bias_polynomial", "k3_ppm", "asymmetry_ppm")
        require_not_negative(self, "alpha", "dead_band_dph")
        self._check_table("scale_temperatures_degc", "scale_values_ppm", "scale_polynomial")
        self._check_table("bias_temperatures_degc", "bias_values_dph", "bias_polynomial")

    def _check_table(self, temperatures: str, values: str, polynomial: str) -> None:
        at = getattr(self, temperatures)
        require_finite(self, temperatures, values)
        require(self, list(at) == sorted(set(at)), temperatures, "rising")
        require(self, len(getattr(self, values)) == len(at), values, f"as long as {temperatures}")
        require(self, not (at and getattr(self, polynomial)), polynomial, f"empty when {temperatures} is given")


@dataclass(frozen=True)
class ThermalParameters:
    """Thermal chain: chamber air → housing → coil outer → coil inner; exact for any time constants.

    Fields:
        housing_s, coil_outer_s, coil_inner_s: time constants of the three steps.
        self_heating_k: how much warmer than the air the powered gyro ends up.
        shupe_c1: bias per rate of change of the coil's outer temperature, deg/h per °C/min.
        shupe_c2: bias per rate of change of the outer-to-inner difference, deg/h per °C/min.
        shupe_c3: bias per outer-to-inner difference, deg/h per °C.
        hysteresis_dph: bias after heating minus bias after cooling; its sign is that of the last setpoint change.
    """

    housing_s: float = 900.0
    coil_outer_s: float = 300.0
    coil_inner_s: float = 480.0
    self_heating_k: float = 3.0
    shupe_c1: float = 1.0
    shupe_c2: float = 2.0
    shupe_c3: float = 0.1
    hysteresis_dph: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "housing_s", "coil_outer_s", "coil_inner_s")
        require_not_negative(self, "self_heating_k")
        require_finite(self, "shupe_c1", "shupe_c2", "shupe_c3", "hysteresis_dph")


@dataclass(frozen=True)
class SensorParameters:
    """The gyro's own temperature sensor, on the coil, renewed once a second.

    Fields:
        lag_s: time constant behind the coil. offset_sigma_k: hidden offset. noise_k: white noise of each reading.
        lsb_k: resolution; 0 for none.
    """

    lag_s: float = 20.0
    offset_sigma_k: float = 0.2
    noise_k: float = 0.01
    lsb_k: float = 0.01

    def __post_init__(self) -> None:
        require_positive(self, "lag_s")
        require_not_negative(self, "offset_sigma_k", "noise_k", "lsb_k")


@dataclass(frozen=True)
class NoiseParameters:
    """Random errors of the rate, named as the test standards name them.

    Fields:
        arw_deg_sqrt_h: angle random walk N. bias_instability_dph: B, the Allan floor / 0.664.
        rrw_dph_sqrt_h: rate random walk K, deg/h/sqrt(h). rate_ramp_dph_h: R, deg/h per hour.
        lsb_arcsec: angle quantum, the residue carried from frame to frame; 0 for none.
    """

    arw_deg_sqrt_h: float = 0.05
    bias_instability_dph: float = 0.3
    rrw_dph_sqrt_h: float = 0.1
    rate_ramp_dph_h: float = 0.0
    lsb_arcsec: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(self, "arw_deg_sqrt_h", "bias_instability_dph", "rrw_dph_sqrt_h", "lsb_arcsec")
        require_finite(self, "rate_ramp_dph_h")


@dataclass(frozen=True)
class RepeatabilityParameters:
    """Errors drawn anew at every thermal excursion, that is, whenever the chamber gets another setpoint (1 sigma).

    Fields:
        scale_ppm: scale factor. bias_dph: bias. sensor_k: error of the temperature sensor.
    """

    scale_ppm: float = 100.0
    bias_dph: float = 2.0
    sensor_k: float = 0.1

    def __post_init__(self) -> None:
        require_not_negative(self, "scale_ppm", "bias_dph", "sensor_k")


@dataclass(frozen=True)
class GyroParameters:
    """A gyro under test, its sensitive axis up (counter-clockwise positive) unless it is a north seeker.

    Fields:
        kind: 'single_axis', or 'north_seeker': two gyros and two accelerometers with level axes (see `seeker`).
        model: which error model: 'surface_a' (the numbers of `surface`), 'curves' (those of `curves`) or 'ring_laser'
            (those of `curves` and `ring_laser`).
        data_rate_hz: frames per second, each the mean rate since the frame before. clock_offset_ppm: of its clock.
        max_rate_dps: full scale; beyond it the output is clipped and the status says so.
        turn_on_bias_sigma_dph, turn_on_scale_sigma_ppm: hidden bias and scale-factor error of each power-on.
        surface, curves, ring_laser, seeker, thermal, sensor, noise, repeatability: see there.
    """

    kind: Literal["single_axis", "north_seeker"] = "single_axis"
    model: Literal["surface_a", "curves", "ring_laser"] = "surface_a"
    data_rate_hz: float = 100.0
    clock_offset_ppm: float = 8.0
    max_rate_dps: float = 200.0
    turn_on_bias_sigma_dph: float = 0.3
    turn_on_scale_sigma_ppm: float = 0.0
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    curves: CurveParameters = field(default_factory=CurveParameters)
    ring_laser: RingLaserParameters = field(default_factory=RingLaserParameters)
    seeker: SeekerParameters = field(default_factory=SeekerParameters)
    thermal: ThermalParameters = field(default_factory=ThermalParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    noise: NoiseParameters = field(default_factory=NoiseParameters)
    repeatability: RepeatabilityParameters = field(default_factory=RepeatabilityParameters)

    def __post_init__(self) -> None:
        require(self, self.kind in ("single_axis", "north_seeker"), "kind", "'single_axis' or 'north_seeker'")
        allowed = "'surface_a', 'curves' or 'ring_laser'"
        require(self, self.model in ("surface_a", "curves", "ring_laser"), "model", allowed)
        require_positive(self, "data_rate_hz", "max_rate_dps")
        require_not_negative(self, "turn_on_bias_sigma_dph", "turn_on_scale_sigma_ppm")
        require_finite(self, "clock_offset_ppm")
        require(self, abs(self.clock_offset_ppm) < 1e5, "clock_offset_ppm", "between -100000 and 100000")
