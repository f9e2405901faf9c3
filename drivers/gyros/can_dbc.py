"""Any gyro that sends its readings in one CAN message described by a DBC file."""

from dataclasses import asdict, dataclass, field
from typing import ClassVar, Literal

import numpy as np

from drivers.can_ports import CanSource
from drivers.codecs.batch import FrameBatch, Meaning
from drivers.codecs.can_frames import CanDecoder
from drivers.codecs.can_spec import CanSpec
from drivers.codecs.counters import Losses
from drivers.codecs.dbc import EXTENDED
from drivers.gyros.reception import Reception

_SHOWN_IDS = 8


@dataclass(frozen=True)
class CanGyroSettings:
    """Which message of which DBC file, and which of its signals are what.

    dbc: name of a packaged DBC or path of one. message: may be left out if the DBC has only one. can_id: if the gyro
    was given another identifier than the DBC says, like 0x1A1; above 0x7FF it is a 29-bit one. rate, temperature,
    counter, status: names of signals; all but the rate may be null. rate_unit, temperature_unit: if the DBC does not
    say; 'deg' and 'rad' are angle increments since the last message. counter_modulo: if it does not use all its bits.
    A status is good if (status & good_mask) == (good_value & good_mask); good_mask null: all bits.
    channels: signals with what else the message carries, by a name that ends in the unit: {case_degc: t_case}.
    """

    dbc: str = "fog_gyro"
    message: str | None = None
    can_id: int | str | None = None
    data_rate_hz: float = 100.0
    rate: str = "rate"
    rate_unit: Literal["deg/s", "rad/s", "deg", "rad"] | None = None
    temperature: str | None = "temperature"
    temperature_unit: Literal["degC", "degF", "K"] | None = None
    counter: str | None = "counter"
    counter_modulo: int | None = None
    status: str | None = "status"
    good_mask: int | str | None = None
    good_value: int | str = 0
    channels: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 < self.data_rate_hz < 1e6:
            raise ValueError(f"data_rate: {self.data_rate_hz:g} Hz is not allowed. Allowed: above 0, like 100 Hz")
        self.spec()

    def spec(self) -> CanSpec:
        """The message as a gyro's frame. Raises FrameSpecError (a ValueError)."""
        return CanSpec.from_settings(asdict(self))


class CanGyro:
    """Frames of a CAN gyro, in batches."""

    Settings: ClassVar[type[CanGyroSettings]] = CanGyroSettings

    def __init__(self, source: CanSource, settings: CanGyroSettings) -> None:
        self.data_rate_hz = settings.data_rate_hz
        self._source = source
        self._spec = settings.spec()
        self._decoder = CanDecoder(self._spec, settings.data_rate_hz)
        self._reception = Reception(settings.data_rate_hz)
        self._other_ids: set[int] = set()

    @staticmethod
    def can_id(settings: CanGyroSettings) -> int:
        """Identifier a bus must let through for this gyro; bit 31 marks a 29-bit one."""
        return settings.spec().can_id

    @property
    def losses(self) -> Losses:
        """Everything counted since the bus was opened."""
        return self._decoder.losses

    @property
    def meaning(self) -> Meaning:
        """The laws from raw columns to values and validity: what a raw file must say to be read again."""
        return self._spec.meaning(self.data_rate_hz)

    def describe(self) -> str:
        """For example 'CAN message GyroFrame (id 1A0), 100 Hz, on can:gyro-b'."""
        return f"{self._spec.name}, {self.data_rate_hz:g} Hz, on {self._source.name}"

    def take(self) -> FrameBatch:
        """Everything received since the last call, decoded; may be empty. Raises PortError."""
        ids, payload, lengths, stamp_s = self._source.take()
        batch = self._decoder.feed(ids, payload, lengths, self._reception.elapsed_s(stamp_s))
        self._reception.took(int(lengths.sum(dtype=np.int64)), batch)
        if len(batch):
            self._other_ids.clear()
        elif len(ids):
            self._other_ids.update(np.unique(ids).tolist())
        return batch

    def discard(self) -> None:
        """Throw away everything received so far. Raises PortError."""
        self._source.discard()
        # what arrives between the two calls goes with the rest; the stamp is what matters
        *_, stamp_s = self._source.take()
        self._decoder.reset()
        self._reception.join(stamp_s)
        self._other_ids.clear()

    def complaint(self) -> str | None:
        """What is wrong with what comes in, as far as can be told; None if nothing is."""
        wanted = self._spec.can_id & ~EXTENDED
        if self._other_ids == {self._spec.can_id}:
            length = self._spec.message.length
            return f"messages with id {wanted:X} have fewer than the {length} bytes of the DBC: is it the right DBC?"
        if self._other_ids:
            seen = ", ".join(f"{number & ~EXTENDED:X}" for number in sorted(self._other_ids)[:_SHOWN_IDS])
            return f"messages with id {seen} received, none with {wanted:X}: is can_id right?"
        silence = self._reception.silence()
        if silence:
            return f"{silence} with id {wanted:X}. Is the gyro powered, are bitrate, termination and can_id right?"
        return self._reception.pace()
