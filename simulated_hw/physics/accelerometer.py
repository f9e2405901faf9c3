"""A quartz accelerometer: output = K (1 + k_T (T - 25)) (a + bias(T) + K2 a² + white + flicker), in whole quanta.

Its samples are made in the blocks of the gyro it is built in with, and are as little dependent on who asks.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.gyro_parameters import NoiseParameters
from simulated_hw.physics.noise import ROWS_PER_CHUNK, SlowNoise
from simulated_hw.physics.seeker_parameters import AccelerometerParameters
from simulated_hw.physics.streams import Stream

_UG = 1e-6
_PPM = 1e-6
_REFERENCE_DEGC = 25.0
_DPS_PER_DPH = 1.0 / 3600.0

Floats = NDArray[np.float64]


class Accelerometer:
    """One accelerometer of a DUT. name: tells its random streams from those of the others."""

    def __init__(
        self, parameters: AccelerometerParameters, seed: int, serial: str, name: str, frame_s: float, row_s: float
    ) -> None:
        self.parameters = p = parameters
        bias, scale = Stream(seed, serial, name, "hidden").chunk(0).standard_normal(2).tolist()
        self.bias_ug, self.scale_ppm = bias * p.bias_sigma_ug, scale * p.scale_sigma_ppm
        # A density is per hertz of one-sided bandwidth: the mean over dt has the variance density²/(2 dt).
        self._white_g = p.noise_ug_sqrt_hz * _UG / sqrt(2.0 * frame_s)
        self._white = Stream(seed, serial, name, "white noise")
        # The generator of slow noise knows no unit but the hour it divides by: µg go in for deg/h.
        flicker = NoiseParameters(0.0, p.instability_ug, 0.0, 0.0, 0.0)
        self._slow = SlowNoise(flicker, row_s, Stream(seed, serial, name, "slow noise"))
        self._kept_slow: tuple[int, Floats] | None = None

    def output_g(self, number: int, pull_g: Floats, body_degc: Floats, chunk: int, rows: slice) -> Floats:
        """Block `number`: pull_g (n,) the true mean specific force of its frames, body_degc (m,) of its m rows, which
        are these rows of this chunk.
        """
        p = self.parameters
        columns = len(pull_g) // len(body_degc)
        warmer = body_degc - _REFERENCE_DEGC
        bias_g = (self.bias_ug + p.bias_ug_k * warmer + self._slow_ug(chunk)[rows]) * _UG
        gain = (1.0 + self.scale_ppm * _PPM) * (1.0 + p.scale_ppm_k * _PPM * warmer)
        noise = self._white.chunk(number).standard_normal(len(pull_g)) * self._white_g
        felt = pull_g + p.quadratic_ug_g2 * _UG * pull_g**2 + np.repeat(bias_g, columns) + noise
        out = np.clip(np.repeat(gain, columns) * felt, -p.range_g, p.range_g)
        return np.asarray(np.round(out / (p.lsb_ug * _UG)) * (p.lsb_ug * _UG) if p.lsb_ug else out)

    def _slow_ug(self, chunk: int) -> Floats:
        if self._kept_slow is None or self._kept_slow[0] != chunk:
            self._kept_slow = chunk, self._slow.means_dps(chunk) / _DPS_PER_DPH
        return self._kept_slow[1]


def rows_of_block(number: int, rows_per_block: int) -> tuple[int, slice]:
    """Where the rows of a block stand: number of the chunk, and place in it."""
    chunk, at = divmod(number * rows_per_block, ROWS_PER_CHUNK)
    return chunk, slice(at, at + rows_per_block)
