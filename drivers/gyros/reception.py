"""Watching over a stream of frames: how long since what, and whether its pace is the declared one."""

from drivers.codecs.batch import FrameBatch

# Silence shorter than this is no silence, however fast the stream.
_SILENCE_S = 1.0
_SILENCE_FRAMES = 20
# A pace is told from the declared one after this long and this many frames, if it is off by more than this.
_PACE_S = 2.0
_PACE_FRAMES = 20
_PACE_TOLERANCE = 0.1


class Reception:
    """What came in since the stream was joined; times are the stamps of the source."""

    def __init__(self, data_rate_hz: float) -> None:
        self._data_rate_hz = data_rate_hz
        self._stamp_s: float | None = None
        self._joined_s: float | None = None
        self._heard_s: float | None = None
        self._first_index: int | None = None
        self._last_index = 0
        self.bytes_since_frame = 0

    def join(self, stamp_s: float) -> None:
        """The stream is joined at this time; what came before does not matter."""
        self._stamp_s = self._joined_s = self._heard_s = stamp_s
        self._first_index = None
        self.bytes_since_frame = 0

    def elapsed_s(self, stamp_s: float) -> float | None:
        """Time since the last call, or since the stream was joined; None the very first time."""
        before, self._stamp_s = self._stamp_s, stamp_s
        if self._joined_s is None:
            self._heard_s = stamp_s
        return None if before is None else stamp_s - before

    def took(self, size: int, batch: FrameBatch) -> None:
        """So many bytes came in, and these frames were in them."""
        if size:
            self._heard_s = self._stamp_s
        self.bytes_since_frame = 0 if len(batch) else self.bytes_since_frame + size
        if len(batch):
            if self._first_index is None:
                self._first_index = int(batch.index[0])
            self._last_index = int(batch.index[-1])

    def silence(self) -> str | None:
        """A sentence if nothing at all has come in for a while."""
        if self._stamp_s is None or self._heard_s is None:
            return None
        silent_s = self._stamp_s - self._heard_s
        if silent_s < max(_SILENCE_S, _SILENCE_FRAMES / self._data_rate_hz):
            return None
        return f"nothing received for {silent_s:.3g} s"

    def pace(self) -> str | None:
        """A sentence if frames come at another rate than declared."""
        if self._joined_s is None or self._stamp_s is None or self._first_index is None:
            return None
        seconds, frames = self._stamp_s - self._joined_s, self._last_index - self._first_index + 1
        if seconds < _PACE_S or frames < _PACE_FRAMES:
            return None
        pace_hz = frames / seconds
        if abs(pace_hz / self._data_rate_hz - 1.0) < _PACE_TOLERANCE:
            return None
        return (
            f"frames come at {pace_hz:.4g} Hz, but data_rate says {self._data_rate_hz:g} Hz; "
            "angle increments would be read wrong by that factor. Correct data_rate, or the gyro's output rate"
        )
