"""The named classes of simulated gyros: what a bench file starts from."""

from collections.abc import Mapping
from types import MappingProxyType

from simulated_hw.physics.gyro_parameters import (
    CurveParameters,
    GyroParameters,
    NoiseParameters,
    RepeatabilityParameters,
    SensorParameters,
    SurfaceParameters,
    ThermalParameters,
)
from simulated_hw.physics.ring_laser_parameters import RingLaserParameters


def _variant_b() -> GyroParameters:
    """Surface A's sibling from another maker's batch: later and wider transition, other slopes and constants."""
    return GyroParameters(
        clock_offset_ppm=-12.0,
        surface=SurfaceParameters(k0=0.041, k1=0.0165, t0_degc=17.5, w_k=18.0, alpha=0.0012, b0_dps=-0.33, b1_dps=0.31),
        thermal=ThermalParameters(housing_s=1080.0, coil_outer_s=330.0, coil_inner_s=420.0, self_heating_k=4.0),
        sensor=SensorParameters(lag_s=15.0),
        noise=NoiseParameters(arw_deg_sqrt_h=0.04, bias_instability_dph=0.4),
    )


def _by_curves(a1: float, b: tuple[float, ...], curves: tuple[float, float], noise: NoiseParameters) -> GyroParameters:
    return GyroParameters(
        model="curves",
        max_rate_dps=400.0,
        curves=CurveParameters(
            scale_polynomial=(0.0, a1), bias_polynomial=b, k3_ppm=curves[0], asymmetry_ppm=curves[1]
        ),
        noise=noise,
        repeatability=RepeatabilityParameters(scale_ppm=curves[0] / 3, bias_dph=b[0] / 10, sensor_k=0.1),
    )


# Hidden errors that the published experiments do not have, or take out by their reduction, are small or absent in the
# classes made for them: each is one unit, so that two runs under two seeds are two cycles of the same gyro.


def _ring_laser(
    clock_ppm: float, arw: float, bias: tuple[float, float, float, float, float], times_s: tuple[float, float, float]
) -> GyroParameters:
    """A unit of the `rlg` experiment. Its firmware has averaged the dither away: the frames have no dither line."""
    temperature, gradient, slope, curvature, cross = bias
    return GyroParameters(
        model="ring_laser",
        clock_offset_ppm=clock_ppm,
        max_rate_dps=400.0,
        turn_on_bias_sigma_dph=0.003,
        curves=CurveParameters(scale_polynomial=(0.0, 0.1)),
        ring_laser=RingLaserParameters(
            temperature_dph_k=temperature,
            gradient_dph_k=gradient,
            slope_dph=slope,
            curvature=curvature,
            cross=cross,
            case_s=times_s[0],
            anode_s=times_s[1],
            cathode_s=times_s[2],
        ),
        sensor=SensorParameters(lag_s=10.0, offset_sigma_k=0.0),
        noise=NoiseParameters(arw, 3e-4, 2e-4, 0.0, 0.01),
        repeatability=RepeatabilityParameters(0.0, 0.0, 0.0),
    )


def _stepped_cycle_fog() -> GyroParameters:
    """The unit of the `bp` experiment: its bias follows temperature and, through its coil, the past of temperature."""
    return GyroParameters(
        model="curves",
        data_rate_hz=400.0,
        clock_offset_ppm=-6.0,
        max_rate_dps=300.0,
        turn_on_bias_sigma_dph=0.02,
        curves=CurveParameters(
            scale_polynomial=(0.0, 3.0, 0.02),
            bias_polynomial=(0.08, 7e-4, -4e-5, -5e-7),
            k3_ppm=15.0,
            asymmetry_ppm=8.0,
        ),
        thermal=ThermalParameters(1200.0, 420.0, 600.0, 4.0, shupe_c1=0.19, shupe_c2=0.4, shupe_c3=0.01),
        sensor=SensorParameters(lag_s=15.0, offset_sigma_k=0.0, noise_k=0.005),
        noise=NoiseParameters(1.85e-3, 5e-4, 3e-4, 0.0, 0.01),
        repeatability=RepeatabilityParameters(0.0, 0.0, 0.0),
    )


def _north_seeker() -> GyroParameters:
    """The seeker of the `north` experiment: B as published, the other Allan terms of the usual order."""
    return GyroParameters(
        kind="north_seeker",
        model="curves",
        clock_offset_ppm=11.0,
        max_rate_dps=100.0,
        turn_on_bias_sigma_dph=0.02,
        curves=CurveParameters(scale_polynomial=(20.0, 5.0), bias_polynomial=(0.12, 1e-3, 2e-5), k3_ppm=15.0),
        thermal=ThermalParameters(shupe_c1=0.1, shupe_c2=0.2, shupe_c3=0.01),
        noise=NoiseParameters(2.5e-3, 0.0196, 0.02, 0.005, 0.02),
        repeatability=RepeatabilityParameters(5.0, 0.0, 0.05),
    )


# The pair of the `ts` experiment, virtual units of three grades with the usual datasheet values of each grade, and the
# units of the `rlg`, `bp` and `north` experiments.
GYRO_CLASSES: Mapping[str, GyroParameters] = MappingProxyType(
    {
        "ts_a": GyroParameters(),
        "ts_b": _variant_b(),
        "tactical": _by_curves(60.0, (3.0, 0.02, 5e-4), (100.0, 50.0), NoiseParameters(0.05, 0.5, 0.5, 0.0, 0.3)),
        "navigation": _by_curves(5.0, (0.1, 1e-3, 2e-5), (15.0, 8.0), NoiseParameters(0.005, 0.02, 0.01, 0.0, 0.02)),
        "high_end": _by_curves(1.0, (0.02, 1e-4, 2e-6), (3.0, 1.0), NoiseParameters(3e-4, 5e-4, 5e-4, 0.0, 0.0015)),
        "rlg_a": _ring_laser(5.0, 8.6e-4, (2.9e-3, -8e-3, 0.025, 3.2e-5, -3e-4), (1500.0, 420.0, 900.0)),
        "rlg_b": _ring_laser(-9.0, 7.3e-4, (2.5e-3, -6e-3, 0.030, 2.7e-5, -3.5e-4), (1380.0, 480.0, 840.0)),
        "rlg_c": _ring_laser(2.0, 9.3e-4, (-2.7e-3, 9e-3, -0.022, -3.0e-5, 3e-4), (1620.0, 390.0, 960.0)),
        "bp": _stepped_cycle_fog(),
        "north": _north_seeker(),
    }
)


def gyro_class(name: str) -> GyroParameters:
    """The parameters of a named class of gyros. Raises ValueError listing the names."""
    try:
        return GYRO_CLASSES[name]
    except KeyError:
        raise ValueError(f"no gyro class {name!r}; there are {', '.join(GYRO_CLASSES)}") from None
