"""Which frames of a gyro suffer which fault on their way: a function of the frame's number and of bench time.

A frame suffers one fault at most, in the order below, so that each can be counted: what is lost cannot be damaged as
well, and only undamaged frames are doubled.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulated_hw.faults.draws import Events, Places
from simulated_hw.faults.rules import Clock, Rule

Mask = NDArray[np.bool_]
Taken = list[tuple[Rule, Places]]

_GONE = ("power_reset", "silence", "loss", "burst_loss")
# Frames behind a slipped byte that are left alone: a receiver must have found its step before it can count the next.
_CALM = 32


@dataclass(frozen=True)
class Fates:
    """What happens to frames first ... end - 1: by rule the frames concerned, of flipped bits their numbers (frame
    number times bits of a frame, plus the bit, the first one sent being the highest of its byte)."""

    first: int
    end: int
    gone: Taken
    repeated: Taken
    flipped: Taken
    slipped: Taken

    def copies(self) -> Places:
        """How often each frame is sent: 0, 1 or 2."""
        counts = np.ones(self.end - self.first, np.int64)
        for taken, count in ((self.gone, 0), (self.repeated, 2)):
            for _, frames in taken:
                counts[frames - self.first] = count
        return counts


class FrameFates:
    """The rules of one gyro that act on its frames as they are sent."""

    def __init__(self, clock: Clock, rules: Iterable[Rule]) -> None:
        self._clock = clock
        self._rules: dict[str, list[Rule]] = {}
        for rule in rules:
            self.add(rule)

    def add(self, rule: Rule) -> None:
        """One more rule."""
        self._rules.setdefault(rule.spec.name, []).append(rule)

    def rules(self, name: str) -> list[Rule]:
        """The rules with this fault's name."""
        return self._rules.get(name, [])

    def sent_s(self, frame: int) -> float:
        """When a frame is sent."""
        return (frame + 1) * self._clock.frame_s

    def of(self, first: int, end: int, frame_bits: int = 0) -> Fates:
        """The fates of frames first ... end - 1, of frame_bits bits each (0: their bits are safe)."""
        free = np.ones(end - first, np.bool_)
        gone = [self._take(rule, first, end, free) for name in _GONE for rule in self.rules(name)]
        repeated = [self._take(rule, first, end, free) for rule in self.rules("duplicate")]
        if not frame_bits:
            return Fates(first, end, gone, repeated, [], [])
        begin = max(first - _CALM, 0)
        drawn = [(rule, self._frames(rule, begin, end)) for rule in self.rules("sync_slip")]
        slips = np.unique(np.concatenate([np.empty(0, np.int64), *(frames for _, frames in drawn)]))
        places = np.arange(first, end)
        free &= np.searchsorted(slips, places) == np.searchsorted(slips, places - _CALM)
        slipped = [(rule, _free(frames, first, free)) for rule, frames in drawn]
        free &= ~np.isin(places, slips)
        flipped = [self._flipped(rule, first, end, frame_bits, free) for rule in self.rules("bit_error")]
        return Fates(first, end, gone, repeated, flipped, slipped)

    def _frames(self, rule: Rule, first: int, end: int) -> Places:
        return rule.frames(self._clock, first, end, self.sent_s(end - 1))

    def _take(self, rule: Rule, first: int, end: int, free: Mask) -> tuple[Rule, Places]:
        frames = _free(self._frames(rule, first, end), first, free)
        free[frames - first] = False
        return rule, frames

    def _flipped(self, rule: Rule, first: int, end: int, frame_bits: int, free: Mask) -> tuple[Rule, Places]:
        assert isinstance(rule.draws, Events)
        parts = [np.empty(0, np.int64)]
        for begin, stop in rule.spans(self._clock, self.sent_s(end - 1)):
            parts.append(rule.draws.between(max(begin, first) * frame_bits, int(min(stop, end)) * frame_bits))
        bits = np.concatenate(parts)
        bits = bits[free[bits // frame_bits - first]]
        free[bits // frame_bits - first] = False
        return rule, bits


def _free(frames: Places, first: int, free: Mask) -> Places:
    frames = frames[frames >= first]
    return frames[free[frames - first]]
