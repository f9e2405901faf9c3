"""The gyro's thermal chain against step-by-step integration in the chamber's air."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro_parameters import SensorParameters, ThermalParameters
from simulated_hw.physics.parameters import ChamberParameters
from simulated_hw.physics.thermal import ThermalChain, coil_degc, coil_slopes_k_s, fog_network

HOUR = 3600.0


def stepped_chamber():
    chamber = ChamberPlant(ChamberParameters(), seed=1)
    chamber.command(0.0, -30.0, 1.0)
    chamber.command(4 * HOUR, -25.0, 1.0)
    return chamber


def integrated(chamber, thermal, sensor, times):
    fine = np.arange(0.0, times[-1] + 20.0, 5.0)
    air = CubicSpline(fine, chamber.air_degc(fine))

    def rhs(t, x):
        housing, outer, inner, reading = x
        return [
            (air(t) + thermal.self_heating_k - housing) / thermal.housing_s,
            (housing - outer) / thermal.coil_outer_s,
            (outer - inner) / thermal.coil_inner_s,
            ((outer + inner) / 2 - reading) / sensor.lag_s,
        ]

    return solve_ivp(rhs, (0.0, times[-1]), [25.0] * 4, t_eval=times, rtol=1e-8, atol=1e-8, max_step=60.0).y.T


@pytest.mark.parametrize(
    "thermal", [ThermalParameters(), ThermalParameters(600.0, 600.0, 600.0, 5.0)], ids=["default", "equal constants"]
)
def test_agrees_with_numerical_integration(thermal):
    chamber, sensor = stepped_chamber(), SensorParameters()
    times = np.arange(0.0, 6 * HOUR, 97.0)
    chain = ThermalChain(chamber, fog_network(thermal, sensor))
    expected = integrated(chamber, thermal, sensor, times)
    np.testing.assert_allclose(chain.temperatures_degc(times), expected, atol=3e-3)


def test_a_two_hour_soak_after_a_five_degree_step_is_long_enough_and_half_an_hour_is_not():
    chamber = stepped_chamber()
    chain = ThermalChain(chamber, fog_network(ThermalParameters(), SensorParameters()))
    ramp_end = 4 * HOUR + 300.0
    nodes = chain.temperatures_degc(ramp_end + np.array([0.5, 1.0, 2.0]) * HOUR)
    outer, inner = coil_slopes_k_s(ThermalParameters(), nodes)
    slope_k_min = 30.0 * (outer + inner)
    assert slope_k_min[0] > 0.05 > slope_k_min[1] > 0.005 > slope_k_min[2]
    assert coil_degc(nodes)[2] == pytest.approx(-25.0 + 3.0, abs=0.05)  # warmer than the air by its own heat


def test_slopes_are_the_derivatives():
    chain = ThermalChain(stepped_chamber(), fog_network(ThermalParameters(), SensorParameters()))
    t = np.array([1000.0, 5000.0, 15000.0])
    outer, inner = coil_slopes_k_s(ThermalParameters(), chain.temperatures_degc(t))
    difference = (chain.temperatures_degc(t + 0.5) - chain.temperatures_degc(t - 0.5))[:, 1:3]
    np.testing.assert_allclose(np.stack([outer, inner], axis=1), difference, rtol=1e-5, atol=1e-9)


def test_the_same_bits_whoever_asked_before_and_whatever_the_chamber_is_told_later():
    chamber, late = ChamberPlant(ChamberParameters(), 1), ChamberPlant(ChamberParameters(), 1)
    nosy = ThermalChain(chamber, fog_network(ThermalParameters(), SensorParameters()))
    times = np.arange(0.0, 3 * HOUR, 50.0)
    for plant in (chamber, late):
        plant.command(10.0, 60.0, 3.0)
    first = nosy.temperatures_degc(times)
    for plant in (chamber, late):
        plant.command(2 * HOUR, -20.0, 3.0)
    quiet = ThermalChain(late, fog_network(ThermalParameters(), SensorParameters()))
    past = times < 2 * HOUR
    assert nosy.temperatures_degc(times).tobytes() == quiet.temperatures_degc(times).tobytes()
    assert quiet.temperatures_degc(times[past]).tobytes() == first[past].tobytes()
    assert not np.allclose(quiet.temperatures_degc(times)[-1], first[-1])
