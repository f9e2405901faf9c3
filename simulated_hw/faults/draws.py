"""Rare events along a line of numbered places: functions of the place alone, whoever looks where first.

Only the events cost anything, not the places between them: the gaps between events of probability p are geometric.
"""

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.streams import Stream

Places = NDArray[np.int64]

# Places whose events are drawn together. A geometric gap has no memory, so it may begin afresh at every chunk.
_CHUNK = 1 << 20
_BURSTS = 256
# A gap that will not end within any run: 10^12 frames are 30 years at 1 kHz.
_NEVER = 10**12


class Events:
    """Each place has an event with the same probability, independent of the others."""

    def __init__(self, stream: Stream, probability: float) -> None:
        self._stream, self._probability = stream, probability
        self._kept: dict[int, Places] = {}

    def between(self, first: int, end: int) -> Places:
        """Places first <= place < end that have an event, rising."""
        if self._probability == 0.0 or first >= end:
            return np.empty(0, np.int64)
        parts = [self._chunk(number) for number in range(first // _CHUNK, (end - 1) // _CHUNK + 1)]
        places = np.concatenate(parts)
        return places[(places >= first) & (places < end)]

    def _chunk(self, number: int) -> Places:
        if number not in self._kept:
            self._kept = {k: v for k, v in self._kept.items() if abs(k - number) <= 1}
            self._kept[number] = self._drawn(number) + number * _CHUNK
        return self._kept[number]

    def _drawn(self, number: int) -> Places:
        draw, reached = self._stream.chunk(number), -1
        parts = []
        while reached < _CHUNK:
            gaps = np.minimum(draw.geometric(self._probability, 256), _NEVER)
            parts.append(reached + np.cumsum(gaps))
            reached = int(parts[-1][-1])
        places = np.concatenate(parts)
        return places[places < _CHUNK]


class Bursts:
    """Two states (Gilbert, Elliott): `enter` is the probability per place of a burst to begin, its length geometric."""

    def __init__(self, stream: Stream, enter: float, mean_length: float) -> None:
        self._stream, self._enter, self._leave = stream, enter, 1.0 / mean_length
        self._begins: list[int] = []
        # Before the first place all is well.
        self._ends: list[int] = [-1]
        self._batches = 0

    def between(self, first: int, end: int) -> Places:
        """Places first <= place < end that lie in a burst, rising."""
        if self._enter == 0.0:
            return np.empty(0, np.int64)
        while self._ends[-1] < end:
            self._extend()
        ends = self._ends[1:]
        parts = [np.empty(0, np.int64)]
        at = bisect_right(ends, first)
        while at < len(ends) and self._begins[at] < end:
            parts.append(np.arange(max(self._begins[at], first), min(ends[at], end)))
            at += 1
        return np.concatenate(parts)

    def _extend(self) -> None:
        draw = self._stream.chunk(self._batches)
        self._batches += 1
        gaps = np.minimum(draw.geometric(self._enter, _BURSTS), _NEVER).tolist()
        lengths = draw.geometric(self._leave, _BURSTS).tolist()
        for gap, length in zip(gaps, lengths, strict=True):
            # The place where a burst has ended is a good one, the next is the first that can begin another.
            self._begins.append(self._ends[-1] + gap)
            self._ends.append(self._begins[-1] + length)
