"""A gyro whose output lies: frozen, with spikes, or with another turn-on bias after a power reset.

Stands between a gyro and its wire front end; frames keep a valid checksum and a running counter.
"""

from collections.abc import Sequence

import numpy as np

from simulated_hw.faults.draws import Places
from simulated_hw.faults.fates import FrameFates
from simulated_hw.faults.gyro_kinds import Spike
from simulated_hw.faults.log import FaultLog
from simulated_hw.faults.rules import Rule, runs
from simulated_hw.physics.gyro import GyroBlock, GyroUnit
from simulated_hw.physics.gyro_errors import DPH_PER_DPS


class LyingGyro:
    """The frames of a gyro with false rates."""

    def __init__(self, gyro: GyroUnit, rules: Sequence[Rule], log: FaultLog) -> None:
        self.data_rate_hz = gyro.data_rate_hz
        self._gyro, self._log = gyro, log
        self._rules = FrameFates(gyro, rules)
        self._repeated: dict[int, float] = {}
        self._logged = 0

    def frames_until(self, now_s: float) -> int:
        """How many frames have been sent by then."""
        return self._gyro.frames_until(now_s)

    def turn_on_bias_dph(self, rule: Rule) -> float:
        """The turn-on bias behind this power reset."""
        return float(rule.detail.chunk(0).standard_normal()) * self._gyro.parameters.turn_on_bias_sigma_dph

    def block(self, first: int, end: int) -> GyroBlock:
        """Frames first … end - 1."""
        true = self._gyro.block(first, end)
        rate = true.rate_dps.copy()
        for rule in self._rules.rules("power_reset"):
            for _, stop in rule.spans(self._gyro, self._rules.sent_s(end - 1)):
                if stop < end:
                    change_dph = self.turn_on_bias_dph(rule) - self._gyro.rows.turn_on_bias_dph
                    rate[max(int(stop) - first, 0) :] += change_dph / DPH_PER_DPS
        for rule in self._rules.rules("spike"):
            self._add_spikes(rule, first, end, rate)
        for rule in self._rules.rules("frozen"):
            for begin, stop in rule.spans(self._gyro, self._rules.sent_s(end - 1)):
                a, b = max(begin, first), int(min(stop, end))
                if a < b:
                    rate[a - first : b - first] = self._held_dps(begin)
                    self._note(rule, np.arange(a, b))
        self._logged = max(self._logged, end)
        return GyroBlock(rate, true.temperature_degc, true.good, true.channels)

    def _held_dps(self, begin: int) -> float:
        """The rate that is repeated from frame `begin` on."""
        if begin not in self._repeated:
            self._repeated[begin] = float(self._gyro.block(begin, begin + 1).rate_dps[0])
        return self._repeated[begin]

    def _add_spikes(self, rule: Rule, first: int, end: int, rate: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        assert isinstance(rule.spec.fault, Spike)
        frames = rule.frames(self._gyro, first, end, self._rules.sent_s(end - 1))
        for frame in frames.tolist():
            up = rule.detail.chunk(frame).random() < 0.5
            rate[frame - first] += rule.spec.fault.size_dps if up else -rule.spec.fault.size_dps
        self._note(rule, frames)

    def _note(self, rule: Rule, frames: Places) -> None:
        for first, many in runs(frames[frames >= self._logged]):
            sent_s = self._rules.sent_s(first)
            self._log.add_frames(sent_s, self._gyro.serial, rule.spec.name, rule.number, first, frames=many)
