"""What arrives of the frames of a gyro: lost, sent twice, damaged, late, with a counter that begins again; and the log.

The wire front ends ask this when their gyro has faults, and work as ever when it has none.
"""

from collections.abc import Iterable
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.crc import varying_columns
from drivers.codecs.frame_spec import FrameSpec
from simulated_hw.faults.draws import Places
from simulated_hw.faults.fates import Fates, FrameFates
from simulated_hw.faults.log import DISCARD, FaultLog
from simulated_hw.faults.rules import Clock, Rule, runs

Rows = NDArray[np.uint8]


class StreamFaults:
    """The faults of one gyro between its output and the host's port."""

    def __init__(self, name: str, clock: Clock, rules: Iterable[Rule], log: FaultLog) -> None:
        self._name, self._clock, self._log = name, clock, log
        self._fates = FrameFates(clock, rules)
        # Frames before this one are in the log, whoever asks for them again.
        self._logged = 0

    def add(self, rule: Rule) -> None:
        """One more fault."""
        self._fates.add(rule)

    def arrived_until(self, now_s: float) -> int:
        """How many frames have reached the host by now, or were lost on the way."""
        late = (window for rule in self._fates.rules("late") for window in rule.windows.until(now_s))
        return self._clock.frames_until(min([now_s, *(begin_s for begin_s, end_s in late if now_s < end_s)]))

    def due_s(self, frame: int, now_s: float) -> float:
        """When a frame reaches the host, as far as that is known now."""
        sent_s = self._fates.sent_s(frame)
        late = (window for rule in self._fates.rules("late") for window in rule.windows.until(now_s))
        return max([sent_s, *(end_s for begin_s, end_s in late if begin_s < sent_s < end_s)])

    def counters(self, first: int, end: int, modulo: int, step: int = 1) -> NDArray[Any]:
        """What the counters of frames first ... end - 1 show, unsigned[n]: from 0 again after a power reset."""
        origins = {0}
        for rule in self._fates.rules("power_reset"):
            spans = rule.spans(self._clock, self._fates.sent_s(max(end - 1, 0)))
            origins |= {int(stop) for _, stop in spans if stop < inf}
        numbers, restarts = np.arange(first, end), np.array(sorted(origins))
        numbers -= restarts[np.searchsorted(restarts, numbers, side="right") - 1]
        return np.asarray(numbers % (modulo // step) * step).astype(np.min_scalar_type(modulo - 1))

    def discarded(self, first: int, end: int, now_s: float) -> None:
        """The host has thrown frames first ... end - 1 away unread; they are never made."""
        self._log.end_run(self._name)
        self._log.add(now_s, self._name, DISCARD, -1, frame=first, frames=end - first)
        self._logged = max(self._logged, end)

    def close(self, now_s: float) -> None:
        """No more is asked for: what the host took ends here."""
        self._log.end_run(self._name)
        if self._logged:
            self._log.add(now_s, self._name, DISCARD, -1, frame=self._logged, frames=0)

    def numbers(self, first: int, end: int) -> Places:
        """The frame number of each message that `messages` returns."""
        return np.repeat(np.arange(first, end), self._fates.of(first, end).copies())

    def messages(self, first: int, rows: Rows) -> Rows:
        """What arrives of messages first ... (uint8[n, m]) over a bus that repeats damaged ones by itself."""
        fates = self._fates.of(first, first + len(rows))
        self._log_whole(fates, 0)
        self._logged = max(self._logged, fates.end)
        return np.repeat(rows, fates.copies(), axis=0)

    def sent_bytes(self, first: int, rows: Rows, spec: FrameSpec) -> bytes:
        """What arrives of frames first ... (uint8[n, length], changed in place) over a serial line."""
        fates = self._fates.of(first, first + len(rows), 8 * spec.length)
        self._log_whole(fates, spec.length)
        for rule, bits in fates.flipped:
            self._flip(rule, bits, first, rows, spec)
        copies = fates.copies()
        begins = (np.cumsum(copies) - copies) * spec.length
        missing = [
            int(begins[frame - first]) + self._slip(rule, frame, rows[frame - first], spec)
            for rule, frames in fates.slipped
            for frame in frames.tolist()
        ]
        self._logged = max(self._logged, fates.end)
        line = rows if (copies == 1).all() else np.repeat(rows, copies, axis=0)
        return np.delete(line.reshape(-1), missing).tobytes() if missing else line.tobytes()

    def _log_whole(self, fates: Fates, length: int) -> None:
        """Log the frames that are lost or doubled."""
        for taken, count in ((fates.gone, "lost"), (fates.repeated, "duplicates")):
            for rule, frames in taken:
                # What a receiver misses over a power reset its restarted counter hides.
                counted = count if rule.spec.name != "power_reset" else "frames"
                for first, many in runs(frames[frames >= self._logged]):
                    self._add(rule, first, **{"frames": many, counted: many})

    def _add(self, rule: Rule, frame: int, **counts: int) -> None:
        self._log.add_frames(self._fates.sent_s(frame), self._name, rule.spec.name, rule.number, frame, **counts)

    def _flip(self, rule: Rule, bits: Places, first: int, rows: Rows, spec: FrameSpec) -> None:
        """Flip bits in place. A damaged frame that passes all checks is one that no receiver can tell."""
        frame_bits = 8 * spec.length
        frames, within = np.divmod(bits, frame_bits)
        np.bitwise_xor.at(rows, (frames - first, within // 8), np.uint8(0x80) >> (within % 8).astype(np.uint8))
        for frame in np.unique(frames[frames >= self._logged]).tolist():
            row = rows[frame - first]
            known = {"lost": 1, "skipped_bytes": spec.length, "bad_checksum": _begins(row, spec)}
            about = {"frame": frame, "frames": 1, "bits": within[frames == frame].tolist()}
            about |= {"passes_checks": 1} if _valid(row, spec) else known
            self._log.add(self._fates.sent_s(frame), self._name, rule.spec.name, rule.number, **about)

    def _slip(self, rule: Rule, frame: int, row: Rows, spec: FrameSpec) -> int:
        """Which byte of a frame is missing."""
        at = int(rule.detail.chunk(frame).integers(spec.length))
        shifted = np.append(np.delete(row, at), row[:1])
        if _valid(shifted, spec):
            # With the first byte of the next frame it would be a good one, and the damage be the next one's.
            at, shifted = 0, np.append(row[1:], row[:1])
        if frame >= self._logged:
            counts = {"lost": 1, "skipped_bytes": spec.length - 1, "bad_checksum": _begins(shifted, spec), "resyncs": 1}
            sent_s = self._fates.sent_s(frame)
            self._log.add(sent_s, self._name, rule.spec.name, rule.number, frame=frame, frames=1, byte=at, **counts)
        return at


def _begins(row: Rows, spec: FrameSpec) -> int:
    """1 if a receiver takes these bytes for the beginning of a frame."""
    return int(row[: len(spec.header)].tobytes() == spec.header)


def _valid(row: Rows, spec: FrameSpec) -> bool:
    """Whether these bytes are a frame to every receiver."""
    if not _begins(row, spec) or not row.tobytes().endswith(spec.trailer):
        return False
    rows, place = row.reshape(1, -1), spec.checksum
    return place is None or bool((place.computed(rows, varying_columns(rows)) == place.read(rows)).all())
