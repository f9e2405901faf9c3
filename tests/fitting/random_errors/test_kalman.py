"""The 3-state filter against filterpy, alone, in batches, and as the 12-state one."""

from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from scipy.linalg import block_diag

from fitting.random_errors.kalman import SmoothingModel, smooth

PHI1, PHI2 = np.array([0.5, 0.2, 0.9, -0.3]), np.array([0.3, 0.1, 0.05, 0.2])
PROCESS, NOISE = np.array([0.01, 0.04, 1e-4, 0.02]), np.array([0.09, 0.01, 1.0, 1e-4])
MEANS = np.array([-10.0, 8.0, 0.001, 1.0])
CONSTANT, CONSTANT_U2 = MEANS * (1.0 - PHI1 - PHI2), np.array([0.01, 1e-4, 1.0, 1e-6])


def model(of: Any = slice(None)) -> SmoothingModel:
    return SmoothingModel(*(values[of] for values in (PHI1, PHI2, CONSTANT, PROCESS, NOISE, CONSTANT_U2)))


def records(*shape: int) -> NDArray[np.float64]:
    return np.asarray(MEANS + 0.3 * np.random.default_rng(1).standard_normal((*shape, 4)))


def filterpy(z: NDArray[np.float64], sensors: list[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """States (n - 1, 3 s) and covariances of the filter with all sensors (s) in one state of 3 s; z (n, s)."""
    peer = KalmanFilter(dim_x=3 * len(sensors), dim_z=len(sensors))
    peer.F = block_diag(*([[PHI1[s], PHI2[s], 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] for s in sensors))
    peer.H = block_diag(*([[1.0, 0.0, 0.0]] for _ in sensors))
    peer.Q = block_diag(*(np.diag([PROCESS[s], 0.0, 0.0]) for s in sensors))
    peer.R = np.diag(NOISE[sensors])
    peer.P = block_diag(*(np.diag([NOISE[s], NOISE[s], CONSTANT_U2[s]]) for s in sensors))
    peer.x = np.concatenate([[z[1, i], z[0, i], CONSTANT[s]] for i, s in enumerate(sensors)])[:, np.newaxis]
    states, covariances = [peer.x[:, 0].copy()], [peer.P.copy()]
    for row in z[2:]:
        peer.predict()
        peer.update(row[:, np.newaxis])
        states.append(peer.x[:, 0].copy())
        covariances.append(peer.P.copy())
    return np.array(states), np.array(covariances)


@pytest.mark.parametrize("sensor", range(4))
def test_one_sensor_is_filterpy(sensor: int) -> None:
    z = records(400)[:, sensor]
    ours = smooth(z, model(sensor))
    state, covariance = filterpy(z[:, np.newaxis], [sensor])
    assert ours.state == pytest.approx(state, rel=1e-12, abs=1e-12 * np.abs(z).max())
    assert ours.covariance == pytest.approx(covariance, rel=1e-10, abs=1e-12 * np.abs(covariance).max())


def test_four_sensors_are_the_twelve_state_filter() -> None:
    z = records(200)
    ours = smooth(z, model())
    state, covariance = filterpy(z, [0, 1, 2, 3])
    assert ours.state.transpose(0, 2, 1).reshape(-1, 12) == pytest.approx(state, rel=1e-12, abs=1e-11)
    for s in range(4):
        block = covariance[:, 3 * s : 3 * s + 3, 3 * s : 3 * s + 3]
        assert ours.covariance[..., s] == pytest.approx(block, rel=1e-10, abs=1e-12 * np.abs(block).max())


@pytest.mark.parametrize("runs", [2, 30])
def test_runs_are_filtered_each_for_itself(runs: int) -> None:
    z = records(60, runs)
    together = smooth(z, model())
    assert together.state.shape == (59, 3, runs, 4)
    for run in (0, runs - 1):
        assert together.state[:, :, run] == pytest.approx(smooth(z[:, run], model()).state, rel=1e-13, abs=1e-13)
    assert together.value[-1, 0, 2] == smooth(z[:, 0, 2], model(2)).value[-1]


def test_many_sensors_are_filtered_each_for_itself() -> None:
    z = np.tile(records(50), (1, 10))
    many = SmoothingModel(*(np.tile(np.asarray(values), 10) for values in vars(model()).values()))
    ours = smooth(z, many)
    four = smooth(z[:, :4], model())
    assert ours.state[:, :, 36:] == pytest.approx(four.state, rel=1e-13, abs=1e-13)
    assert ours.covariance[..., 36:] == pytest.approx(four.covariance, rel=1e-13, abs=1e-16)


def test_the_constant_is_learned() -> None:
    rng = np.random.default_rng(3)
    z = 5.0 + 0.1 * rng.standard_normal(5000)
    wrong = SmoothingModel(0.3, 0.2, 0.0, 1e-6, 0.01, 100.0)
    smoothed = smooth(z, wrong)
    assert smoothed.constant[-1] == pytest.approx(2.5, abs=0.02)
    assert smoothed.value[-1000:].std() < 0.2 * z.std()


def test_what_cannot_be_filtered_is_said() -> None:
    with pytest.raises(ValueError, match="3 or more"):
        smooth([1.0, 2.0], model(0))
    with pytest.raises(ValueError, match="without gaps"):
        smooth([1.0, 2.0, np.nan, 3.0], model(0))
    with pytest.raises(ValueError, match="for 4 sensors"):
        smooth(np.zeros((10, 3)), model())
