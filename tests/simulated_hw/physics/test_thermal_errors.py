"""The ring laser's bias against its law, with temperatures integrated step by step."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.gyro_classes import gyro_class
from simulated_hw.physics.gyro_parameters import NoiseParameters, SensorParameters
from simulated_hw.physics.parameters import ChamberParameters, TableParameters
from simulated_hw.physics.rate_table import TablePlant

HOUR = 3600.0
RING = replace(
    gyro_class("rlg_a"),
    clock_offset_ppm=0.0,
    turn_on_bias_sigma_dph=0.0,
    noise=NoiseParameters(0.0, 0.0, 0.0, 0.0, 0.0),
    sensor=SensorParameters(lag_s=5.0, offset_sigma_k=0.0, noise_k=0.0, lsb_k=0.0),
)


@pytest.fixture(scope="module")
def cooled():
    chamber = ChamberPlant(ChamberParameters(), 1)
    chamber.command(1.5 * HOUR, -30.0, 1.0)
    gyro = GyroUnit(RING, chamber, TablePlant(TableParameters(), 1), seed=1, serial="R")
    times = np.arange(0.0, 4 * HOUR, 60.0)
    r = RING.ring_laser

    def slopes(t, x):
        case, anode, cathode = x
        air = chamber.air_degc(np.array([t]))[0]
        return [
            (air + r.case_heating_k - case) / r.case_s,
            (case + r.anode_heating_k - anode) / r.anode_s,
            (case + r.cathode_heating_k - cathode) / r.cathode_s,
        ]

    nodes = solve_ivp(slopes, (0.0, times[-1]), [25.0] * 3, t_eval=times, rtol=1e-8, atol=1e-8, max_step=30.0).y
    return gyro, times, nodes


def test_bias_is_the_law_of_the_true_temperatures(cooled):
    gyro, times, (case, anode, cathode) = cooled
    r = RING.ring_laser
    body, gradient = 0.5 * (anode + cathode), anode - cathode
    slope = 30.0 * (
        (case + r.anode_heating_k - anode) / r.anode_s + (case + r.cathode_heating_k - cathode) / r.cathode_s
    )
    expected = r.temperature_dph_k * (body - 25.0) + r.gradient_dph_k * gradient + r.slope_dph * slope
    expected += r.curvature * (body - 25.0) ** 2 + r.cross * (body - 25.0) * gradient
    found = np.array([gyro.block(k, k + 1).rate_dps[0] for k in (times * 100).astype(int).tolist()]) * 3600.0
    assert np.ptp(expected) > 0.05
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_channels_are_the_three_temperatures_behind_their_sensors_lag(cooled):
    gyro, times, nodes = cooled
    for name, node in zip(("case_degc", "anode_degc", "cathode_degc"), nodes, strict=True):
        late = (times[1:] * 100).astype(int).tolist()
        found = np.array([gyro.block(k, k + 1).channels[name][0] for k in late])
        lagging = node[1:] - 5.0 * np.gradient(node, times)[1:]
        np.testing.assert_allclose(found[5:], lagging[5:], atol=0.02)
    truth = gyro.truth(times)
    np.testing.assert_allclose(truth["coil_degc"], 0.5 * (nodes[1] + nodes[2]), atol=5e-3)
