"""Declared frames to bytes and back, in whole batches.

Decoding follows one rule, whatever the size of the pieces the bytes come in: from where the last frame ended, the next
frame is the first place at which header, trailer and checksum are all right. Nothing valid is lost because something
that only looks like a header stands before it. A stream without damage takes a short cut to the same result.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.batch import FrameBatch, Raw
from drivers.codecs.counters import Losses, Sequence
from drivers.codecs.crc import varying_columns
from drivers.codecs.frame_spec import FrameSpec

Rows = NDArray[np.uint8]
Places = NDArray[np.int64]

# Bytes looked at together: a batch and its intermediate results stay in the processor's second-level cache.
_WINDOW_BYTES = 1 << 18
# Candidates checked together when bytes are garbage and every place may be one.
_CANDIDATES = 1 << 13


def encode(spec: FrameSpec, columns: Mapping[str, Raw | int | float], count: int) -> Rows:
    """Frames of raw values, as uint8[count, length].

    columns: field name -> raw values [count], or one number for all frames; fields not named are zero. Constant fields
    cost nothing per frame. Values must be of the field's raw type or fit in it; raises ValueError otherwise.
    """
    template = np.zeros((1, spec.length), np.uint8)
    template[0, : len(spec.header)] = np.frombuffer(spec.header, np.uint8)
    template[0, spec.length - len(spec.trailer) :] = np.frombuffer(spec.trailer, np.uint8)
    for name, values in columns.items():
        if np.ndim(values) == 0:
            field = spec.fields[name]
            field.write(template, _fitting(np.asarray([values]), name, spec))
    frames = np.frombuffer(bytearray(template.tobytes()) * count, np.uint8).reshape(count, spec.length)
    varying: list[int] = []
    for name, values in columns.items():
        if np.ndim(values) != 0:
            field = spec.fields[name]
            field.write(frames, _fitting(np.asarray(values), name, spec))
            varying.extend(field.columns)
    if spec.checksum:
        spec.checksum.write(frames, spec.checksum.computed(frames, varying))
    return frames


def _fitting(values: Raw, name: str, spec: FrameSpec) -> Raw:
    kind = spec.fields[name].raw_type
    fits = values.dtype == kind.dtype and spec.fields[name].size == kind.dtype.itemsize
    if fits or kind.low is None or kind.high is None or not len(values):
        return values
    low, high = values.min(), values.max()
    if values.dtype.kind not in "iu" or low < kind.low or high > kind.high:
        text = f"{values.dtype} values {low} to {high} do not fit in {spec.fields[name].type}"
        raise ValueError(f"{spec.name}: field {name}: {text} ({kind.low} to {kind.high})")
    return values


class StreamDecoder:
    """Bytes of a declared frame, in pieces of any size, to batches of frames; every loss is counted.

    data_rate_hz: frames per second the instrument sends: needed for increments, and to resolve long outages.
    """

    def __init__(self, spec: FrameSpec, data_rate_hz: float) -> None:
        self.spec, self.data_rate_hz = spec, data_rate_hz
        self._meaning = spec.meaning(data_rate_hz)
        self._columns = spec.columns
        modulo, step = (spec.counter.modulo, spec.counter.step) if spec.counter else (None, 1)
        self._sequence = Sequence(modulo, step, data_rate_hz)
        self._fixed_columns = frozenset(
            (*range(len(spec.header)), *range(spec.length - len(spec.trailer), spec.length))
        )
        self._fixed = np.array(sorted(self._fixed_columns))
        self._tail = b""
        # Places are counted in bytes from the beginning of the stream.
        self._position = self._end = self._bad_until = 0
        self._joining = True
        self._accepted = self._forgiven = 0
        self._bad_checksum = self._resyncs = self._bad_status = 0

    @property
    def pending(self) -> int:
        """Bytes kept because they may be the beginning of a frame; always less than one frame."""
        return len(self._tail)

    @property
    def losses(self) -> Losses:
        """Everything counted so far."""
        forgiven = self._forgiven + self._fragment(self._position)
        return Losses(
            frames=self._accepted - self._sequence.duplicates,
            lost=self._sequence.lost,
            duplicates=self._sequence.duplicates,
            bad_checksum=self._bad_checksum,
            skipped_bytes=self._position - self._accepted * self.spec.length - forgiven,
            resyncs=self._resyncs,
            bad_status=self._bad_status,
        )

    def reset(self) -> None:
        """The bytes fed next do not follow those fed before; what is missing between them is not counted as lost."""
        self._tail = b""
        self._forgiven += self._fragment(self._position)
        self._joining, self._end, self._bad_until = True, self._position, self._position
        self._sequence.reanchor()

    def feed(self, data: bytes, elapsed_s: float | None = None) -> FrameBatch:
        """Decode what came in.

        elapsed_s: time since the last call (or reset), if known: it resolves outages longer than the counter's period.
        """
        held = self._tail + data if self._tail else data
        everything = np.frombuffer(held, np.uint8)
        window = max(_WINDOW_BYTES, 4 * self.spec.length)
        found: list[Rows] = []
        at = 0
        while len(everything) - at >= self.spec.length:
            rows, used = self._window(everything[at : at + window])
            found.append(rows)
            at += used
            self._position += used
        self._tail = held[at:]
        if not found:
            found.append(np.empty((0, self.spec.length), np.uint8))
        return self._batch(found, elapsed_s)

    def _batch(self, found: list[Rows], elapsed_s: float | None) -> FrameBatch:
        rows = found[0] if len(found) == 1 else np.concatenate(found)
        counter = self.spec.counter.field.read(rows) if self.spec.counter else None
        keep, index = self._sequence.admit(rows, counter, elapsed_s)
        if keep is not None:
            rows = rows[keep]
        batch = self._meaning.batch({name: field.read(rows) for name, field in self._columns.items()}, index)
        self._bad_status += len(batch) - int(np.count_nonzero(batch.good))
        return batch

    def _window(self, view: Rows) -> tuple[Rows, int]:
        """Frames in a piece of the stream that starts where the last one ended, and how many bytes are settled."""
        length = self.spec.length
        count = len(view) // length
        rows = view[: count * length].reshape(count, length)
        varying = varying_columns(rows)
        if self._in_step(rows, varying):
            self._accept(np.zeros(1, np.int64), count)
            return rows, count * length
        return self._search(view)

    def _in_step(self, rows: Rows, varying: list[int]) -> bool:
        """Every row is a valid frame."""
        if not self._begins_and_ends(rows[:1]).all() or not self._fixed_columns.isdisjoint(varying):
            return False
        place = self.spec.checksum
        return place is None or bool((place.computed(rows, varying) == place.read(rows)).all())

    def _begins_and_ends(self, rows: Rows) -> NDArray[np.bool_]:
        fixed = np.frombuffer(self.spec.header + self.spec.trailer, np.uint8)
        matches: NDArray[np.bool_] = (rows[:, self._fixed] == fixed).all(axis=1)
        return matches

    def _search(self, view: Rows) -> tuple[Rows, int]:
        """The same for a damaged piece: look at every place where the header stands."""
        length = self.spec.length
        starts = self._headers(view)
        valid = np.empty(len(starts), np.bool_)
        for at in range(0, len(starts), _CANDIDATES):
            valid[at : at + _CANDIDATES] = self._valid(_cut(view, starts[at : at + _CANDIDATES], length))
        frames = _apart(starts[valid], length, 0)
        self._count_bad(starts[~valid], frames)
        self._accept(frames)
        settled = len(view) - length + 1
        return _cut(view, frames, length), max(settled, int(frames[-1]) + length) if len(frames) else settled

    def _headers(self, view: Rows) -> Places:
        """Places where the header stands and a whole frame fits behind it."""
        header = self.spec.header
        places = np.flatnonzero(view[: len(view) - self.spec.length + 1] == header[0])
        for offset, byte in enumerate(header[1:], 1):
            places = places[view[places + offset] == byte]
        return places

    def _valid(self, rows: Rows) -> NDArray[np.bool_]:
        valid = self._begins_and_ends(rows)
        if self.spec.checksum:
            valid &= self.spec.checksum.computed(rows, varying_columns(rows)) == self.spec.checksum.read(rows)
        return valid

    def _fragment(self, position: int) -> int:
        """Bytes before `position` that are no damage, but the rest of a frame cut in two by opening the port."""
        return (position - self._end) % self.spec.length if self._joining else 0

    def _accept(self, frames: Places, run: int = 1) -> None:
        """Account for frames at these places of the window, `run` of them at the last one, and for the gaps before."""
        if not len(frames):
            return
        length = self.spec.length
        fragment = self._fragment(self._position + int(frames[0]))
        first_gap = self._position + int(frames[0]) - self._end - fragment
        self._forgiven += fragment
        self._joining = False
        # Whole frames that failed their check leave the stream in step.
        self._resyncs += first_gap % length != 0
        if len(frames) > 1:
            self._resyncs += int(np.count_nonzero(np.diff(frames) % length))
        self._accepted += len(frames) + run - 1
        self._end = self._position + int(frames[-1]) + run * length

    def _count_bad(self, places: Places, frames: Places) -> None:
        """Count places that began like a frame and were none: not inside a good one, nor inside one counted."""
        if len(frames):
            before = np.searchsorted(frames, places, side="right") - 1
            places = places[(before < 0) | (places >= frames[before] + self.spec.length)]
        places = _apart(places, self.spec.length, self._bad_until - self._position)
        if len(places):
            self._bad_checksum += len(places)
            self._bad_until = self._position + int(places[-1]) + self.spec.length


def _cut(view: Rows, places: Places, length: int) -> Rows:
    """Frames of `length` bytes at these places, copied."""
    whole = np.ndarray((len(view) - length + 1,), np.dtype((np.void, length)), view, strides=(1,))
    return whole[places].view(np.uint8).reshape(len(places), length)


def _apart(places: Places, length: int, start: int) -> Places:
    """From the left, those not before `start` and at least `length` behind the one taken before."""
    places = places[np.searchsorted(places, start) :]
    if len(places) < 2 or int(np.diff(places).min()) >= length:
        return places
    keep = np.ones(len(places), np.bool_)
    crowded = np.flatnonzero(np.diff(places) < length)
    at = 0
    while at < len(crowded):
        taken = crowded[at]
        following = np.searchsorted(places, places[taken] + length)
        keep[taken + 1 : following] = False
        at = int(np.searchsorted(crowded, following))
    return places[keep]
