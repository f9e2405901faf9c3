"""Any gyro that sends frames of fixed length over a serial line; the frame is declared as data."""

from dataclasses import dataclass
from typing import Any, ClassVar

from drivers.codecs.batch import FrameBatch, Meaning
from drivers.codecs.counters import Losses
from drivers.codecs.frame_spec import FrameSpec
from drivers.codecs.frames import StreamDecoder
from drivers.errors import looks_like, show_bytes
from drivers.gyros.reception import Reception
from drivers.ports import ByteSource

# 8N1: a start bit, eight data bits, a stop bit
_BITS_PER_BYTE = 10
# Bytes without a frame in them that are enough to say so, in frame lengths.
_CONVINCING_FRAMES = 4
_SAMPLE_BYTES = 256


@dataclass(frozen=True)
class SerialGyroSettings:
    """frame: name of a packaged declaration, path of one, or a mapping (see `drivers.codecs.frame_spec`)."""

    frame: str | dict[str, Any] = "kvh_36"
    baud: int = 921_600
    data_rate_hz: float = 100.0

    def __post_init__(self) -> None:
        if self.baud <= 0:
            raise ValueError(f"baud: {self.baud} is not allowed. Allowed: a positive number, like 921600")
        if not 0.0 < self.data_rate_hz < 1e6:
            raise ValueError(f"data_rate: {self.data_rate_hz:g} Hz is not allowed. Allowed: above 0, like 100 Hz")
        spec = FrameSpec.load(self.frame)
        needed = spec.length * _BITS_PER_BYTE * self.data_rate_hz
        if needed > self.baud:
            raise ValueError(
                f"data_rate: {self.data_rate_hz:g} Hz of {spec.length}-byte frames needs {needed:.0f} baud, "
                f"the line has {self.baud}. Lower data_rate or raise baud"
            )


class SerialGyro:
    """Frames of a serial gyro, in batches."""

    Settings: ClassVar[type[SerialGyroSettings]] = SerialGyroSettings

    def __init__(self, source: ByteSource, settings: SerialGyroSettings) -> None:
        self.data_rate_hz = settings.data_rate_hz
        self._source = source
        self._spec = FrameSpec.load(settings.frame)
        self._decoder = StreamDecoder(self._spec, settings.data_rate_hz)
        self._reception = Reception(settings.data_rate_hz)
        self._sample = b""
        self._bad_checksum_before = 0

    @property
    def losses(self) -> Losses:
        """Everything counted since the port was opened."""
        return self._decoder.losses

    @property
    def meaning(self) -> Meaning:
        """The laws from raw columns to values and validity: what a raw file must say to be read again."""
        return self._spec.meaning(self.data_rate_hz)

    def describe(self) -> str:
        """For example 'KVH 36-byte frame, 100 Hz, on sim://gyro-a'."""
        return f"{self._spec.name}, {self.data_rate_hz:g} Hz, on {self._source.name}"

    def take(self) -> FrameBatch:
        """Everything received since the last call, decoded; may be empty. Raises PortError."""
        data, stamp_s = self._source.take()
        batch = self._decoder.feed(data, self._reception.elapsed_s(stamp_s))
        self._reception.took(len(data), batch)
        if len(batch) == 0:
            self._sample = (self._sample + data)[-_SAMPLE_BYTES:]
        else:
            self._sample, self._bad_checksum_before = b"", self.losses.bad_checksum
        return batch

    def discard(self) -> None:
        """Throw away everything received so far. Raises PortError."""
        self._source.discard()
        # what arrives between the two calls goes with the rest; the stamp is what matters
        _, stamp_s = self._source.take()
        self._decoder.reset()
        self._reception.join(stamp_s)
        self._sample, self._bad_checksum_before = b"", self.losses.bad_checksum

    def complaint(self) -> str | None:
        """What is wrong with what comes in, as far as can be told; None if nothing is."""
        received = self._reception.bytes_since_frame
        if received >= _CONVINCING_FRAMES * self._spec.length:
            return f"{received} bytes received since the last valid frame, {self._no_frame()}"
        silence = self._reception.silence()
        if silence:
            return f"{silence}. Is the gyro powered and sending, is the cable right (TX, RX, RS-422 polarity)?"
        return self._reception.pace()

    def _no_frame(self) -> str:
        header = self._spec.header.hex(" ").upper()
        failed = self.losses.bad_checksum - self._bad_checksum_before
        if failed:
            kind = self._spec.checksum.kind if self._spec.checksum else "none"
            return (
                f"header {header} was found {failed} times, but never with a correct checksum ({kind}): "
                "is the frame declaration right (length, checksum)?"
            )
        return (
            f"no frame with header {header}: {show_bytes(self._sample)}, {looks_like(self._sample)}. "
            "Is this the gyro's port, are baud and frame declaration right?"
        )
