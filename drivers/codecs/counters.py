"""What was lost on the way, and the frame counter that tells: modulo counters made into an index that never wraps."""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

# How far arrival times are trusted: a reader may be this late, a gyro's clock this wrong.
_LATE_S = 0.1
_CLOCK_ERROR = 0.002
# Beyond this a whole period is not worth keeping as a pattern; such counters are differenced instead.
_LONGEST_PATTERN = 1 << 16


@dataclass(frozen=True)
class Losses:
    """Everything that happened to a stream since it was opened, in counts; a value, so it can be kept and subtracted.

    frames: valid frames handed on. lost: frames missing by their counter. duplicates: frames that repeat the counter
    and bytes of the one before (dropped). bad_checksum: places that began like a frame and failed the check (a damaged
    frame is also in `lost`, if it has a counter). skipped_bytes: bytes in no valid frame; those of bad frames too, not
    those of the frame cut in two by opening the port. resyncs: times the stream went on off its step. bad_status:
    frames handed on with good = False.
    """

    frames: int = 0
    lost: int = 0
    duplicates: int = 0
    bad_checksum: int = 0
    skipped_bytes: int = 0
    resyncs: int = 0
    bad_status: int = 0

    def __add__(self, other: "Losses") -> "Losses":
        return Losses(*(getattr(self, field.name) + getattr(other, field.name) for field in fields(Losses)))

    def __sub__(self, other: "Losses") -> "Losses":
        return Losses(*(getattr(self, field.name) - getattr(other, field.name) for field in fields(Losses)))


class Sequence:
    """Drops repeated frames and turns a counter that runs modulo `modulo` in steps of `step` into an index.

    Without a counter (modulo None) nothing can be missed or repeated, and the index counts frames. With the data rate,
    outages longer than the counter's period are resolved by elapsed time.
    """

    def __init__(self, modulo: int | None, step: int = 1, data_rate_hz: float = 0.0) -> None:
        self._period = modulo // step if modulo else None
        self._step = step
        self._data_rate_hz = data_rate_hz
        self._last_index: int | None = None
        self._last_row: tuple[int, bytes] | None = None
        self._silent_s = 0.0
        self._free = True
        self.lost = 0
        self.duplicates = 0

    def reanchor(self) -> None:
        """What comes next is not compared with what came before, as far as losses go; the index still only rises."""
        self._free = True
        self._last_row = None
        self._silent_s = 0.0

    def admit(
        self, rows: NDArray[np.uint8], counter: NDArray[Any] | None, elapsed_s: float | None
    ) -> tuple[NDArray[np.bool_] | None, NDArray[np.int64]]:
        """Take the next n frames.

        rows: uint8[n, m], their bytes; counter: unsigned[n] as on the wire (None if they have none); elapsed_s: time
        since the last call (None: not known).
        Returns which to keep (bool[n], None for all) and int64 indices of those kept.
        """
        if self._period is None or counter is None:
            first = 0 if self._last_index is None else self._last_index + 1
            self._last_index = first + len(rows) - 1
            return None, np.arange(first, first + len(rows))
        if self._step > 1:
            counter = counter // counter.dtype.type(self._step)
        if len(rows) == 0:
            self._silent_s += elapsed_s or 0.0
            return None, np.empty(0, np.int64)
        if self._continues(counter):
            keep, index = None, self._run(counter)
        else:
            keep = self._not_repeated(rows, counter)
            index = self._unwrap(counter if keep is None else counter[keep], elapsed_s)
        if len(index):
            self._silent_s = 0.0
        self._last_row = int(counter[-1]), rows[-1].tobytes()
        return keep, index

    def _continues(self, counter: NDArray[Any]) -> bool:
        """No gap and no repetition anywhere, the one common case."""
        assert self._period is not None
        if self._period > _LONGEST_PATTERN or self._was_silent:
            return False
        first = int(counter[0])
        if first >= self._period:
            return False
        if self._last_index is not None and not self._free and first != (self._last_index + 1) % self._period:
            return False
        pattern = _pattern(self._period, counter.dtype.str, 1 << (len(counter) - 1).bit_length())
        return bool((pattern[first : first + len(counter)] == counter).all())

    @property
    def _was_silent(self) -> bool:
        """Nothing came for so long that a whole period may be missing at the seam."""
        assert self._period is not None
        return not self._free and self._silent_s * self._data_rate_hz > self._period / 2

    def _run(self, counter: NDArray[Any]) -> NDArray[np.int64]:
        assert self._period is not None
        first = int(counter[0])
        if self._last_index is not None:
            first = self._last_index + 1 + (first - self._last_index - 1) % self._period
        self._last_index = first + len(counter) - 1
        self._free = False
        return np.arange(first, first + len(counter))

    def _not_repeated(self, rows: NDArray[np.uint8], counter: NDArray[Any]) -> NDArray[np.bool_] | None:
        suspects = np.flatnonzero(counter[1:] == counter[:-1])
        repeated = suspects[(rows[suspects + 1] == rows[suspects]).all(axis=1)] + 1
        first_repeats = self._last_row == (int(counter[0]), rows[0].tobytes())
        if not first_repeats and not len(repeated):
            return None
        keep = np.ones(len(rows), np.bool_)
        keep[repeated] = False
        keep[0] = not first_repeats
        self.duplicates += len(keep) - int(np.count_nonzero(keep))
        return keep

    def _unwrap(self, counter: NDArray[Any], elapsed_s: float | None) -> NDArray[np.int64]:
        """Index of frames that do not all follow each other; the steps between them are 1..period frames."""
        assert self._period is not None
        if len(counter) == 0:
            self._silent_s += elapsed_s or 0.0
            return np.empty(0, np.int64)
        wide = counter.astype(np.int64)
        before = int(wide[0]) - 1 if self._last_index is None else self._last_index
        # A counter may show more than its declared modulo; what counts is where it stands in the period.
        steps = np.diff(wide, prepend=before)
        outside = (steps < 1) | (steps > self._period)
        steps[outside] = (steps[outside] - 1) % self._period + 1
        if elapsed_s is not None:
            self._add_whole_periods(steps, elapsed_s)
        index = np.cumsum(steps, out=steps)
        index += before
        counted_from = int(index[0]) if self._free else before + 1
        self.lost += int(index[-1]) - counted_from + 1 - len(index)
        self._last_index = int(index[-1])
        self._free = False
        return index

    def _add_whole_periods(self, steps: NDArray[np.int64], elapsed_s: float) -> None:
        """An outage longer than the counter's period hides whole periods; the clock tells how many.

        They are put where frames are seen to be missing (the widest gap), or at the seam after a silence. A stream that
        runs on without a break is believed, whatever the clock says: then it is the declared data rate that is wrong.
        """
        assert self._period is not None
        # The step to the first frame after joining means nothing; neither does silence before it.
        first = 1 if self._free else 0
        if len(steps) == first:
            return
        expected = (elapsed_s + self._silent_s * (1 - first)) * self._data_rate_hz
        surplus = expected - first - int(steps[first:].sum())
        if surplus < self._period / 2 + _LATE_S * self._data_rate_hz + _CLOCK_ERROR * expected:
            return
        widest = first + int(steps[first:].argmax())
        if steps[widest] > 1 or self._was_silent:
            steps[widest if steps[widest] > 1 else 0] += round(surplus / self._period) * self._period


def counter_values(first: int, count: int, modulo: int, step: int = 1) -> NDArray[Any]:
    """What the counters of frames first ... first + count - 1 show, unsigned[count] (read only): the opposite of
    `Sequence`."""
    period = modulo // step
    kind = np.min_scalar_type(modulo - 1).str
    if period > _LONGEST_PATTERN:
        return (np.arange(first, first + count) % period * step).astype(kind)
    phase = first % period
    values = _pattern(period, kind, 1 << max(count - 1, 0).bit_length())[phase : phase + count]
    return values * values.dtype.type(step) if step > 1 else values


@lru_cache(maxsize=32)
def _pattern(period: int, kind: str, length: int) -> NDArray[Any]:
    """0, 1 .. period-1, 0, 1 ...: long enough to hold `length` values from any phase."""
    pattern: NDArray[Any] = np.resize(np.arange(period).astype(kind), length + period)
    pattern.flags.writeable = False
    return pattern
