"""Reference data: error surface A of the fitting notes, section 1, written out again here as an independent oracle."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.blas import one_thread


@dataclass(frozen=True)
class Campaign:
    """inputs: [temperature_degc, rate_dps as given] (n, 2); reference: true rate; dwell: dwell number."""

    inputs: NDArray[np.float64]
    reference: NDArray[np.float64]
    dwell: NDArray[np.int64]

    def split(self, seed: int, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """A random split: rows for training, rows held back."""
        order = np.random.default_rng(1000 + seed).permutation(len(self.reference))
        return order[:count], order[count:]


def surface_a(temperature: NDArray[np.float64], rate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Output of the gyro in deg/s at a temperature in degC and a true rate in deg/s."""
    gain = 0.049530876 + 0.020260709 * np.tanh((temperature - 24.87441) / 14.0)
    bias = 0.40871934 + 0.42963359 * (temperature - 15.0) / 45.0
    return (1.0 + gain) * np.sin(0.0013 * rate) / 0.0013 + bias


def make_campaign(seed: int, *, noise: float = 2.8e-4, dwell_errors: bool = False) -> Campaign:
    """The 684-point grid; dwell errors: 100 ppm scale, 2 deg/h bias, 0.1 degC sensor error, common to a dwell."""
    rng = np.random.default_rng(seed)
    temperatures = np.arange(-30.0, 61.0, 5.0)
    rates = np.concatenate([np.arange(-180.0, 0.0, 10.0), np.arange(10.0, 181.0, 10.0)])
    dwell = np.repeat(np.arange(len(temperatures)), len(rates))
    temperature, rate = temperatures[dwell], np.tile(rates, len(temperatures))
    output = surface_a(temperature, rate) + noise * rng.standard_normal(len(rate))
    if dwell_errors:
        scale, bias, sensor = rng.standard_normal((3, len(temperatures))) * [[1e-4], [2.0 / 3600.0], [0.1]]
        output = output * (1.0 + scale[dwell]) + bias[dwell]
        temperature = temperature + sensor[dwell]
    return Campaign(np.column_stack([temperature, output]), rate, dwell)


@pytest.fixture(scope="session")
def campaign() -> Callable[..., Campaign]:
    """Makes reference campaigns."""
    return make_campaign


@pytest.fixture(scope="session", autouse=True)
def _one_blas_thread() -> Iterator[None]:
    """The pure functions leave the threads to their caller; the estimators limit them by themselves."""
    with one_thread():
        yield
