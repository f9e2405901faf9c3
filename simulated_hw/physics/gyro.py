"""A gyro on the table in the chamber: its frames, made only when somebody looks at them.

Frame k is the mean over [k, k + 1) intervals of the gyro's own clock. Frames are made in blocks of whole rows (about a
minute) on one absolute grid, ahead of time, as the plants will move if no further command comes; a block is made again
when a command has come before the frames asked for. The frames before a command come out the same to the last bit, so
no result depends on who asked for what, or when.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import floor, inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.axes import InputAxis, VerticalAxis
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro_errors import stuck_in_dead_band
from simulated_hw.physics.gyro_parameters import GyroParameters
from simulated_hw.physics.gyro_rows import GyroRows, Rows
from simulated_hw.physics.noise import ROWS_PER_CHUNK, white_sigma_dps
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.streams import Stream

_FRAMES_PER_BLOCK = 8192
# A frame that ends within this part of a frame after `now` has been sent: 10 ns at 100 Hz, and float seconds need it.
_EDGE = 1e-6
# The residue of the angle counter is drawn anew once in so many blocks, to bound how far back it must be followed.
_BLOCKS_PER_RESIDUE = 64


@dataclass(frozen=True, slots=True)
class GyroBlock:
    """Consecutive frames: rate (deg/s), temperature (°C) and whether the status is good; read-only, shape (n,) each.

    channels: what else the gyro measures, by a name that ends in the unit, shape (n,) each.
    """

    rate_dps: NDArray[np.float64]
    temperature_degc: NDArray[np.float64]
    good: NDArray[np.bool_]
    channels: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def part(self, span: slice) -> "GyroBlock":
        """Some of its frames; the same memory."""
        channels = {name: values[span] for name, values in self.channels.items()}
        return GyroBlock(self.rate_dps[span], self.temperature_degc[span], self.good[span], channels)


@dataclass(frozen=True, slots=True)
class _Made:
    """A block as made, with what the plants had been told by then, and the angle quanta left over at its end."""

    block: GyroBlock
    rows: Rows
    table_commands: int
    residue: float


class Companion(Protocol):
    """Other sensors in the same housing, in the same frames. truth_names: the keys of `truth`."""

    truth_names: tuple[str, ...]

    def block(self, number: int, stop: int, rows: Rows) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.bool_]]:
        """Channels by name of a whole block, right for its frames before `stop`, and whether they are good."""
        ...

    def truth(self, times_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """What else is true of the DUT, at rising times."""
        ...

    def hidden(self) -> dict[str, object]:
        """What else was drawn once."""
        ...


class GyroUnit:
    """One gyro, powered from time 0 on unless `power` is switched.

    axis: what it feels; along the table's axis and up if not given, with `earth_dps` of the earth's rotation.
    companion: other sensors in the same frames.
    """

    def __init__(
        self,
        parameters: GyroParameters,
        chamber: ChamberPlant,
        table: TablePlant,
        *,
        seed: int,
        serial: str,
        earth_dps: float = 0.0,
        axis: InputAxis | None = None,
        power: PowerHistory | None = None,
    ) -> None:
        self.parameters, self.serial = parameters, serial
        self.data_rate_hz = parameters.data_rate_hz
        self._frame_s = 1.0 / (parameters.data_rate_hz * (1.0 + 1e-6 * parameters.clock_offset_ppm))
        self._columns = max(1, round(parameters.data_rate_hz))
        self._rows_per_block = _power_of_two(_FRAMES_PER_BLOCK // self._columns)
        self._size = self._rows_per_block * self._columns
        self._table, self._chamber = table, chamber
        self._axis: InputAxis = VerticalAxis(table, earth_dps) if axis is None else axis
        self.earth_dps = self._axis.earth_dps
        # What nobody can switch is no part of the truth that changes.
        self.truth_names = ("turn_on_bias_dph",) if power else ()
        self.power = power or PowerHistory()
        self.rows = GyroRows(parameters, chamber, seed, serial, self._columns * self._frame_s, self.power)
        self.companion: Companion | None = None
        self._white = Stream(seed, serial, "white noise")
        self._drawn_residue = Stream(seed, serial, "quantisation")
        self._white_dps = np.float32(white_sigma_dps(parameters.noise, self._frame_s))
        self._dead_band_dps = self.rows.model.dead_band_dps
        fraction = (np.arange(self._columns) + 0.5) / self._columns
        self._line = np.stack([np.ones(self._columns), fraction])
        self._all_good = np.ones(self._size, dtype=np.bool_)
        self._all_good.flags.writeable = False
        self._made: dict[int, _Made] = {}
        self._residues: dict[int, float] = {}

    @property
    def frame_s(self) -> float:
        """Time from frame to frame on the world's clock."""
        return self._frame_s

    @property
    def grid(self) -> tuple[int, int]:
        """Rows of a block, and frames of a row."""
        return self._rows_per_block, self._columns

    def frames_until(self, now_s: float) -> int:
        """How many frames have been sent by then."""
        return floor(now_s / self._frame_s + _EDGE)

    def block(self, first: int, end: int) -> GyroBlock:
        """Frames first … end - 1. Raises ValueError if first < 0 or end < first.

        Ask for frames that have been sent (`frames_until`): later ones are only as the plants stand now.
        """
        if not 0 <= first <= end:
            raise ValueError(f"gyro {self.serial}: no frames from {first} to {end}; need 0 <= first <= end")
        parts = []
        at = first
        while at < end:
            number = at // self._size
            begin = number * self._size
            stop = min(end, begin + self._size)
            parts.append(self.whole(number, stop).part(slice(at - begin, stop - begin)))
            at = stop
        return parts[0] if len(parts) == 1 else _joined(parts)

    def whole(self, number: int, stop: int) -> GyroBlock:
        """A whole block, right for its frames before `stop`."""
        made = self._made.get(number)
        if made is None or self._stale_from_s(made) < (stop - _EDGE) * self._frame_s:
            made = self._make(number, stop)
            self._made = {k: v for k, v in self._made.items() if k == number - 1} | {number: made}
        return made.block

    def _stale_from_s(self, made: _Made) -> float:
        later = self._table.commands_s[made.table_commands :]
        return min(self.rows.valid_until_s(made.rows), later[0] if later else inf)

    def _make(self, number: int, stop: int) -> _Made:
        row = number * self._rows_per_block
        chunk, at = divmod(row, ROWS_PER_CHUNK)
        rows = self.rows.chunk(chunk, stop * self._frame_s)
        mine = slice(at, at + self._rows_per_block)
        known = len(self._table.commands_s)
        rate = self._rate(number, rows.gains[mine], rows.biases_dps[mine])
        residue = self._quantise(number, rate) if self.parameters.noise.lsb_arcsec else 0.0
        good = self._saturate(rate)
        temperature = np.repeat(rows.sensor_degc[mine], self._columns)
        channels = {name: np.repeat(values[mine], self._columns) for name, values in rows.probes_degc.items()}
        if self.companion:
            others, others_good = self.companion.block(number, stop, rows)
            channels |= others
            good = good & others_good
        for values in (rate, temperature, good, *channels.values()):
            values.flags.writeable = False
        return _Made(GyroBlock(rate, temperature, good, channels), rows, known, residue)

    def _rate(self, number: int, gains: NDArray[np.float64], biases: NDArray[np.float64]) -> NDArray[np.float64]:
        shape = (self._rows_per_block, self._columns)
        rate = self._axis.mean_rate_of_frames(number * self._size, *shape, self._frame_s).reshape(shape)
        rate = self.rows.model.respond(rate)
        rate *= gains @ self._line
        rate += biases @ self._line
        out = rate.reshape(-1)
        if self._white_dps:
            white = self._white.chunk(number).standard_normal(self._size, dtype=np.float32)
            white *= self._white_dps
            out += white
        return stuck_in_dead_band(out, self._dead_band_dps) if self._dead_band_dps else out

    def _saturate(self, rate_dps: NDArray[np.float64]) -> NDArray[np.bool_]:
        limit = self.parameters.max_rate_dps
        if rate_dps.max() <= limit and rate_dps.min() >= -limit:
            return self._all_good
        good = np.asarray(np.abs(rate_dps) <= limit)
        np.clip(rate_dps, -limit, limit, out=rate_dps)
        good.flags.writeable = False
        return good

    def _quantise(self, number: int, rate_dps: NDArray[np.float64]) -> float:
        """Whole angle quanta per frame, in place, what is left over going to the next frame; returns the last of it."""
        quantum_dps = self.parameters.noise.lsb_arcsec / 3600.0 / self._frame_s
        angle = self._residue(number) + np.cumsum(rate_dps / quantum_dps)
        counts = np.floor(angle)
        rate_dps[:] = np.diff(counts, prepend=0.0) * quantum_dps
        return float(angle[-1] - counts[-1])

    def _residue(self, number: int) -> float:
        """The residue at the start of a block, in quanta, followed from block to block since it was last drawn."""
        begin = number
        while begin % _BLOCKS_PER_RESIDUE and begin not in self._residues:
            begin -= 1
        if begin % _BLOCKS_PER_RESIDUE == 0:
            self._residues[begin] = float(self._drawn_residue.chunk(begin).random())
        for earlier in range(begin, number):
            self.whole(earlier, (earlier + 1) * self._size)
            self._residues[earlier + 1] = self._made[earlier].residue
        return self._residues[number]

    def truth(self, times_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """At rising times: body temperature, input rate without ripple, draws of thermal excursion and power-on."""
        draws = [self.rows.draws(number) for number in self._chamber.excursions(times_s).tolist()]
        truth = {
            "coil_degc": self.rows.thermal.body_degc(self.rows.chain.temperatures_degc(times_s)),
            "input_rate_dps": self._axis.rate_dps(times_s),
            "scale_ppm": np.array([draw.scale_ppm for draw in draws]),
            "bias_dph": np.array([draw.bias_dph for draw in draws]),
            "sensor_k": np.array([draw.sensor_k for draw in draws]),
            "turn_on_bias_dph": np.array([self.rows.turn_on(n)[0] for n in self.power.cycles(times_s).tolist()]),
        }
        return truth | (self.companion.truth(times_s) if self.companion else {})


def _power_of_two(number: int) -> int:
    """The largest power of two not above a number, at least 1 and at most the rows of a chunk."""
    return 1 << (min(max(number, 1), ROWS_PER_CHUNK).bit_length() - 1)


def _joined(parts: list[GyroBlock]) -> GyroBlock:
    if not parts:
        return GyroBlock(np.empty(0), np.empty(0), np.empty(0, dtype=np.bool_))
    return GyroBlock(
        np.concatenate([part.rate_dps for part in parts]),
        np.concatenate([part.temperature_degc for part in parts]),
        np.concatenate([part.good for part in parts]),
        {name: np.concatenate([part.channels[name] for part in parts]) for name in parts[0].channels},
    )
