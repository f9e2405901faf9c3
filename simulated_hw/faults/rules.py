"""One fault of one gyro: when it is on, as numbers of frames, and its random draws."""

from dataclasses import dataclass
from math import inf
from typing import Protocol

import numpy as np

from simulated_hw.faults.draws import Bursts, Events, Places
from simulated_hw.faults.gyro_kinds import BurstLoss
from simulated_hw.faults.kinds import FaultSpec
from simulated_hw.faults.script import Times
from simulated_hw.physics.streams import Stream


class Clock(Protocol):
    """How a gyro numbers its frames: 0, 1, 2 ... from power-on, frame k sent at (k + 1) frame_s."""

    @property
    def frame_s(self) -> float: ...
    def frames_until(self, now_s: float) -> int: ...


@dataclass(frozen=True)
class Rule:
    """A fault with its place in the bench file, the times at which it is on, and its random streams.

    draws: which places (frames, bits, replies) it strikes, if it strikes some only; detail: what it does there, a chunk
    for each place.
    """

    number: int
    spec: FaultSpec
    windows: Times
    detail: Stream
    draws: Events | Bursts | None

    @classmethod
    def of(cls, number: int, spec: FaultSpec, windows: Times, seed: int) -> "Rule":
        """The streams' keys are the seed, the instrument and the place in the bench file: no fault changes another."""
        stream = Stream(seed, spec.on, f"fault {number}")
        detail = Stream(seed, spec.on, f"fault {number}", "detail")
        fault = spec.fault
        draws: Events | Bursts | None = None
        if isinstance(fault, BurstLoss):
            draws = Bursts(stream, fault.enter, fault.mean_frames)
        elif hasattr(fault, "probability"):
            draws = Events(stream, fault.probability)
        return cls(number, spec, windows, detail, draws)

    def spans(self, clock: Clock, sent_s: float) -> list[tuple[int, int | float]]:
        """The frames (first, behind the last) sent while it is on, as far as known at the time sent_s."""
        return [
            (clock.frames_until(begin_s), inf if end_s == inf else clock.frames_until(end_s))
            for begin_s, end_s in self.windows.until(sent_s)
        ]

    def frames(self, clock: Clock, first: int, end: int, sent_s: float) -> Places:
        """Frames first ... end - 1 that it concerns: those drawn, or all sent while it is on."""
        parts = [np.empty(0, np.int64)]
        for begin, stop in self.spans(clock, sent_s):
            a, b = max(begin, first), int(min(stop, end))
            if a < b:
                parts.append(np.arange(a, b) if self.draws is None else self.draws.between(a, b))
        return np.concatenate(parts)


def runs(places: Places) -> list[tuple[int, int]]:
    """Rising places as runs that follow each other: (first, how many)."""
    if not len(places):
        return []
    starts = np.flatnonzero(np.diff(places, prepend=places[0] - 2) != 1)
    lengths = np.diff(starts, append=len(places))
    return list(zip(places[starts].tolist(), lengths.tolist(), strict=True))
