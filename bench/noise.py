"""A DUT's own noise so far: what the noise of a point is compared with."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import Any

from bench.procedure.language import Acquire
from bench.procedure.plan import PlannedStep

# Points of one rate that are remembered: enough for a median, few enough to follow a gyro that ages.
REMEMBERED = 10
# Noise grows with the rate (scale-factor noise, ripple of the table): points are alike if their rates are within a
# factor of two, and all are at rest that turn slower than this.
ALIKE, REST_DPS = 2.0, 1.0

Sampling = tuple[str, float, str]


class NoiseHistory:
    """Standard deviations of the samples of a run's points, by DUT, sampling and rate; points that failed are not."""

    def __init__(self) -> None:
        self._seen: defaultdict[Sampling, dict[float, deque[float]]] = defaultdict(dict)

    def add(self, row: Mapping[str, Any], args: Acquire) -> None:
        """Remember a finished point."""
        std = row["rate_std_dps"]
        if row["verdict"] == "fail" or not std:
            return
        rates = self._seen[row["dut"], args.every_s, args.take]
        rates.setdefault(_speed(row["rate_setpoint_dps"]), deque(maxlen=REMEMBERED)).append(std)

    def fold(self, rows: Iterable[Mapping[str, Any]], plan: Sequence[PlannedStep]) -> None:
        """Remember the finished points of a journal, as if they had just been measured."""
        acquisitions = {step.point: step.args for step in plan if isinstance(step.args, Acquire)}
        for row in rows:
            if row["point"] in acquisitions:
                self.add(row, acquisitions[row["point"]])

    def typical_dps(self, dut: str, rate_dps: float | None, args: Acquire, least: int) -> float | None:
        """The median of the DUT's points at comparable conditions; None if there are fewer than `least`."""
        speed = _speed(rate_dps)
        rates = self._seen.get((dut, args.every_s, args.take), {})
        low, high = speed / ALIKE, speed * ALIKE
        values = [std for other, seen in rates.items() if low <= other <= high for std in seen]
        return median(values) if len(values) >= least else None


def _speed(rate_dps: float | None) -> float:
    return max(abs(rate_dps or 0.0), REST_DPS)
