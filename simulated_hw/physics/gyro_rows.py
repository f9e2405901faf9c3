"""What changes slowly in a gyro, once per row of frames (about a second), for 1024 rows at a time.

Within a row the output is (gain + gain' x) f(Ω) + (bias + bias' x) with x from 0 to 1. The end of the row is predicted
from the temperature and its exact slope at the row's start, so a row depends on nothing that happens after it begins,
and what is left out is the second derivative over one second (below 1e-5 K).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro_errors import DPH_PER_DPS, ErrorModel
from simulated_hw.physics.gyro_parameters import GyroParameters
from simulated_hw.physics.noise import ROWS_PER_CHUNK, SlowNoise
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.streams import Stream
from simulated_hw.physics.thermal import ThermalChain
from simulated_hw.physics.thermal_errors import thermal_model


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
    sensor_degc (1024,): the temperature in the frames of the row; probes_degc (1024,) each: what other temperature
    sensors there are, by channel name; body_degc (1024,): the true temperature at the row's start; known_commands: how
    many chamber and power switch had had by then.
    """

    gains: NDArray[np.float64]
    biases_dps: NDArray[np.float64]
    sensor_degc: NDArray[np.float64]
    probes_degc: Mapping[str, NDArray[np.float64]]
    body_degc: NDArray[np.float64]
    known_commands: tuple[int, int]


class GyroRows:
    """Gain, bias and sensor temperature of one gyro, row by row."""

    def __init__(
        self,
        parameters: GyroParameters,
        chamber: ChamberPlant,
        seed: int,
        serial: str,
        row_s: float,
        power: PowerHistory | None = None,
    ) -> None:
        self.parameters, self.row_s = parameters, row_s
        self.power = power or PowerHistory()
        self._chamber, self._seed, self._serial = chamber, seed, serial
        self.model = ErrorModel(parameters)
        self.thermal = thermal_model(parameters, self.model)
        self.chain = ThermalChain(chamber, self.thermal.network, self.power)
        hidden = Stream(seed, serial, "hidden").chunk(0).standard_normal(2)
        self.turn_on_bias_dph = float(hidden[0]) * parameters.turn_on_bias_sigma_dph
        self.sensor_offset_k = float(hidden[1]) * parameters.sensor.offset_sigma_k
        self._slow = SlowNoise(parameters.noise, row_s, Stream(seed, serial, "slow noise"))
        self._sensor_noise = Stream(seed, serial, "sensor noise")
        self._probe_noise: dict[str, Stream] = {}
        self._excursion = Stream(seed, serial, "excursion")
        self._turn_on = Stream(seed, serial, "turn-on")
        self._turn_ons: dict[int, tuple[float, float]] = {}
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

    def turn_on(self, cycle: int) -> tuple[float, float]:
        """Bias (deg/h) and scale-factor error (ppm) of one power-on; 0 is the one before time 0."""
        if cycle not in self._turn_ons:
            p = self.parameters
            bias, scale = self._turn_on.chunk(cycle).standard_normal(2).tolist()
            bias_dph = bias * p.turn_on_bias_sigma_dph if cycle else self.turn_on_bias_dph
            self._turn_ons[cycle] = bias_dph, scale * p.turn_on_scale_sigma_ppm
        return self._turn_ons[cycle]

    def _commands_s(self) -> tuple[list[float], list[float]]:
        return self._chamber.commands_s, self.power.commands_s

    def valid_until_s(self, rows: Rows) -> float:
        """The time of the first command the chunk does not know of."""
        later = [at_s[known:] for at_s, known in zip(self._commands_s(), rows.known_commands, strict=True)]
        return min((at_s[0] for at_s in later if at_s), default=inf)

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
        chamber_s, power_s = self._commands_s()
        known = len(chamber_s), len(power_s)
        starts_s = (index * ROWS_PER_CHUNK + np.arange(ROWS_PER_CHUNK, dtype=np.float64)) * self.row_s
        found = self.thermal.errors(self.chain.temperatures_degc(starts_s), self.row_s)
        draws, hysteresis_dph = self._excursions(starts_s)
        turn_on_dph, turn_on_ppm = self._turn_ons_of(starts_s)
        gain = (1.0 + found.scale) * (1.0 + 1e-6 * (draws[:, 0] + turn_on_ppm))
        gain_after = (1.0 + found.scale_after) * (1.0 + 1e-6 * (draws[:, 0] + turn_on_ppm))
        extra_dph = found.extra_dph + (draws[:, 1] + turn_on_dph + hysteresis_dph)
        total = found.bias_dps + extra_dph / DPH_PER_DPS + self._slow_dps(index)
        probes = {name: felt + draws[:, 2] for name, felt in found.probes_degc.items()}
        sensor_degc = self._sensor(index, probes.pop(""))
        read = {name: self._read(self._stream(name), index, felt) for name, felt in probes.items()}
        main = self.thermal.main_probe
        return Rows(
            np.stack([gain, gain_after - gain], axis=1),
            np.stack([total, found.bias_after_dps - found.bias_dps], axis=1),
            sensor_degc,
            {main: sensor_degc, **read} if main else read,
            found.body_degc,
            known,
        )

    def _turn_ons_of(self, starts_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Turn-on bias (deg/h) and scale error (ppm) per row; a row in which power comes back has the new ones."""
        cycles = self.power.cycles(starts_s + self.row_s)
        first, last = int(cycles[0]), int(cycles[-1])
        table = np.array([self.turn_on(cycle) for cycle in range(first, last + 1)])
        return table[cycles - first, 0], table[cycles - first, 1]

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
        return self._read(self._sensor_noise, index, temperature_degc)

    def _read(self, stream: Stream, index: int, temperature_degc: NDArray[np.float64]) -> NDArray[np.float64]:
        s = self.parameters.sensor
        noise = stream.chunk(index).standard_normal(ROWS_PER_CHUNK)
        reading = temperature_degc + self.sensor_offset_k + s.noise_k * noise
        return np.round(reading / s.lsb_k) * s.lsb_k if s.lsb_k else reading

    def _stream(self, probe: str) -> Stream:
        if probe not in self._probe_noise:
            self._probe_noise[probe] = Stream(self._seed, self._serial, "sensor noise", probe)
        return self._probe_noise[probe]
