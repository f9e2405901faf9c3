"""What changes slowly in a gyro, once per row of frames (about a second), for 1024 rows at a time.

Within a row the output is (gain + gain' x) f(Ω) + (bias + bias' x) with x from 0 to 1. The end of the row is predicted
from the temperature and its exact slope at the row's start, so a row depends on nothing that happens after it begins,
and what is left out is the second derivative over one second (below 1e-5 K).
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro_errors import DPH_PER_DPS, ErrorModel
from simulated_hw.physics.gyro_parameters import GyroParameters
from simulated_hw.physics.noise import ROWS_PER_CHUNK, SlowNoise
from simulated_hw.physics.streams import Stream
from simulated_hw.physics.thermal import INNER, OUTER, SENSOR, ThermalChain, coil_degc


@dataclass(frozen=True, slots=True)
class Draws:
    """Errors of one thermal excursion: scale factor, bias, temperature sensor."""

    scale_ppm: float
    bias_dph: float
    sensor_k: float


@dataclass(frozen=True, slots=True)
class Rows:
    """One chunk of rows.

    Fields: gains (1024, 2): gain at the row's start, and its change over the row; biases_dps (1024, 2) likewise;
    sensor_degc (1024,): the temperature in the frames of the row; known_commands: how many the chamber had had by then.
    """

    gains: NDArray[np.float64]
    biases_dps: NDArray[np.float64]
    sensor_degc: NDArray[np.float64]
    known_commands: int


class GyroRows:
    """Gain, bias and sensor temperature of one gyro, row by row."""

    def __init__(self, parameters: GyroParameters, chamber: ChamberPlant, seed: int, serial: str, row_s: float) -> None:
        self.parameters, self.row_s = parameters, row_s
        self._chamber, self._seed, self._serial = chamber, seed, serial
        self.chain = ThermalChain(chamber, parameters.thermal, parameters.sensor)
        self.model = ErrorModel(parameters)
        hidden = Stream(seed, serial, "hidden").chunk(0).standard_normal(2)
        self.turn_on_bias_dph = float(hidden[0]) * parameters.turn_on_bias_sigma_dph
        self.sensor_offset_k = float(hidden[1]) * parameters.sensor.offset_sigma_k
        self._slow = SlowNoise(parameters.noise, row_s, Stream(seed, serial, "slow noise"))
        self._sensor_noise = Stream(seed, serial, "sensor noise")
        self._excursion = Stream(seed, serial, "excursion")
        self._draws: dict[int, Draws] = {}
        self._kept: dict[int, Rows] = {}
        self._kept_slow_dps: dict[int, NDArray[np.float64]] = {}

    def draws(self, excursion: int) -> Draws:
        """The repeatability errors of one thermal excursion."""
        if excursion not in self._draws:
            r = self.parameters.repeatability
            g = self._excursion.chunk(excursion).standard_normal(3).tolist()
            self._draws[excursion] = Draws(g[0] * r.scale_ppm, g[1] * r.bias_dph, g[2] * r.sensor_k)
        return self._draws[excursion]

    def valid_until_s(self, rows: Rows) -> float:
        """The time of the first command the chunk does not know of."""
        later = self._chamber.commands_s[rows.known_commands :]
        return later[0] if later else inf

    def chunk(self, index: int, until_s: float) -> Rows:
        """One chunk, right for all its rows that start at or before until_s."""
        rows = self._kept.get(index)
        if rows is None or self.valid_until_s(rows) < until_s:
            rows = self._compute(index)
            self._kept = {k: v for k, v in self._kept.items() if abs(k - index) == 1} | {index: rows}
        return rows

    def _slow_dps(self, index: int) -> NDArray[np.float64]:
        if index not in self._kept_slow_dps:
            self._kept_slow_dps = {index: self._slow.means_dps(index)}
        return self._kept_slow_dps[index]

    def _compute(self, index: int) -> Rows:
        known = len(self._chamber.commands_s)
        starts_s = (index * ROWS_PER_CHUNK + np.arange(ROWS_PER_CHUNK, dtype=np.float64)) * self.row_s
        nodes = self.chain.temperatures_degc(starts_s)
        outer_slope, inner_slope = self.chain.slopes_k_s(nodes)
        coil = coil_degc(nodes)
        after = coil + 0.5 * (outer_slope + inner_slope) * self.row_s
        draws, hysteresis_dph = self._excursions(starts_s)
        gain = (1.0 + self.model.scale(coil)) * (1.0 + 1e-6 * draws[:, 0])
        gain_after = (1.0 + self.model.scale(after)) * (1.0 + 1e-6 * draws[:, 0])
        bias, bias_after = self.model.bias_dps(coil), self.model.bias_dps(after)
        t = self.parameters.thermal
        extra_dph = t.shupe_c1 * 60.0 * outer_slope + t.shupe_c2 * 60.0 * (outer_slope - inner_slope)
        extra_dph += t.shupe_c3 * (nodes[:, OUTER] - nodes[:, INNER])
        extra_dph += draws[:, 1] + self.turn_on_bias_dph + hysteresis_dph
        total = bias + extra_dph / DPH_PER_DPS + self._slow_dps(index)
        return Rows(
            np.stack([gain, gain_after - gain], axis=1),
            np.stack([total, bias_after - bias], axis=1),
            self._sensor(index, nodes[:, SENSOR] + draws[:, 2]),
            known,
        )

    def _excursions(self, starts_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Per row the repeatability draws, shape (n, 3), and the hysteresis bias."""
        numbers = self._chamber.excursions(starts_s)
        first, last = int(numbers[0]), int(numbers[-1])
        span = range(first, last + 1)
        table = np.array([(d.scale_ppm, d.bias_dph, d.sensor_k) for d in map(self.draws, span)])
        half = 0.5 * self.parameters.thermal.hysteresis_dph
        hysteresis = np.array([half * self._chamber.direction(number) for number in span])
        return table[numbers - first], hysteresis[numbers - first]

    def _sensor(self, index: int, temperature_degc: NDArray[np.float64]) -> NDArray[np.float64]:
        s = self.parameters.sensor
        noise = self._sensor_noise.chunk(index).standard_normal(ROWS_PER_CHUNK)
        reading = temperature_degc + self.sensor_offset_k + s.noise_k * noise
        return np.round(reading / s.lsb_k) * s.lsb_k if s.lsb_k else reading
