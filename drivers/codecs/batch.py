"""What a stream of frames becomes: columns as they were on the wire, an index that tells what is missing, and values.

One type for every gyro, whichever wire it came over. Engineering values are computed in float64 from the raw columns
with the linear law of a `Quantity`, so that the raw columns alone are enough to compute them again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Raw = NDArray[Any]
Floats = NDArray[np.float64]
Channels = Mapping[str, Floats]
NO_CHANNELS: Channels = MappingProxyType({})


@dataclass(frozen=True)
class RawType:
    """How a number travels: its numpy type once unpacked, and the counts it can hold (None, None for floats)."""

    dtype: np.dtype[Any]
    low: int | None = None
    high: int | None = None

    @classmethod
    def integer(cls, bits: int, signed: bool) -> "RawType":
        """An integer of 1..64 bits, unpacked into the smallest numpy type that holds it."""
        container = next(width for width in (8, 16, 32, 64) if width >= bits)
        dtype = np.dtype(f"{'i' if signed else 'u'}{container // 8}")
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        return cls(dtype, low, high)


@dataclass(frozen=True)
class Quantity:
    """The law between a raw column and its value: value = raw * scale + offset, in `unit`."""

    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""

    def value(self, raw: Raw) -> Floats:
        """Engineering values, float64, of raw ones of the same shape."""
        value = np.multiply(raw, self.scale, dtype=np.float64)
        return np.add(value, self.offset, out=value) if self.offset else value

    def raw(self, value: Floats, kind: RawType) -> Raw:
        """The opposite: what an instrument would send; counts are rounded and saturate at the ends of their type."""
        scaled = np.divide(value - self.offset if self.offset else value, self.scale)
        if kind.low is None:
            return scaled.astype(kind.dtype)
        if np.isnan(scaled).any():
            # A not-a-number has no count; converters of this kind send zero.
            scaled = np.nan_to_num(scaled)
        return np.rint(scaled, out=scaled).clip(kind.low, kind.high, out=scaled).astype(kind.dtype)


@dataclass(frozen=True)
class FrameBatch:
    """n frames in the order they came, valid and without duplicates.

    columns: raw values as on the wire (counts or float32/float64), keyed rate, temperature, counter, status, and by the
    names of its channels; a frame that does not carry one has no such column.
    index: int64[n], the frame counter without its wrap-around: the first frame ever has its counter's value, a lost
    frame leaves a hole.
    rate_dps, temperature_degc (NaN where the frame has none): float64[n]. good: bool[n], the status says the reading
    is valid, and it is a finite number. channels: float64[n] of what else the frame carries, by name
    (see `drivers.codecs.channels`); not finite where the instrument says so.
    """

    columns: dict[str, Raw]
    index: NDArray[np.int64]
    rate_dps: Floats
    temperature_degc: Floats
    good: NDArray[np.bool_]
    channels: dict[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.index)

    def head(self, count: int) -> "FrameBatch":
        """The first `count` frames, or all if there are no more."""
        return self.part(0, count)

    def part(self, start: int, stop: int) -> "FrameBatch":
        """Frames start … stop - 1, counted from 0 in this batch; the same memory, not a copy."""
        span = slice(start, stop)
        return FrameBatch(
            {name: values[span] for name, values in self.columns.items()},
            self.index[span],
            self.rate_dps[span],
            self.temperature_degc[span],
            self.good[span],
            {name: values[span] for name, values in self.channels.items()},
        )

    @classmethod
    def empty(cls) -> "FrameBatch":
        """No frames and no columns."""
        none = np.empty(0)
        return cls({}, np.empty(0, np.int64), none, none, np.empty(0, np.bool_))

    @classmethod
    def concat(cls, batches: Sequence["FrameBatch"]) -> "FrameBatch":
        """All frames in the order given. Batches must come from the same decoder; columnless empty ones are ignored."""
        batches = [batch for batch in batches if len(batch) or batch.columns]
        if not batches:
            return cls.empty()
        if len(batches) == 1:
            return batches[0]
        return cls(
            {name: np.concatenate([batch.columns[name] for batch in batches]) for name in batches[0].columns},
            np.concatenate([batch.index for batch in batches]),
            np.concatenate([batch.rate_dps for batch in batches]),
            np.concatenate([batch.temperature_degc for batch in batches]),
            np.concatenate([batch.good for batch in batches]),
            {name: np.concatenate([batch.channels[name] for batch in batches]) for name in batches[0].channels},
        )


@dataclass(frozen=True)
class Meaning:
    """What the raw columns of a gyro mean: used by its driver to read them and by its simulator to make them.

    A status is good if (status & good_mask) == (good_value & good_mask); a healthy unit sends good_value.
    channels: the laws of what else the frame carries, by channel name.
    """

    rate: Quantity
    temperature: Quantity | None = None
    good_mask: int = 0
    good_value: int = 0
    channels: Mapping[str, Quantity] = field(default_factory=dict)

    @classmethod
    def of(cls, quantities: Mapping[str, Quantity], good_mask: int, good_value: int) -> "Meaning":
        """The meaning with these `quantities`, as a raw file's metadata has them. Raises KeyError without a rate."""
        others = {name: law for name, law in quantities.items() if name not in ("rate", "temperature")}
        return cls(quantities["rate"], quantities.get("temperature"), good_mask, good_value, others)

    @property
    def quantities(self) -> dict[str, Quantity]:
        """The law of each column that is a number, by column name."""
        temperature = {"temperature": self.temperature} if self.temperature else {}
        return {"rate": self.rate, **temperature, **self.channels}

    def batch(self, columns: dict[str, Raw], index: NDArray[np.int64]) -> FrameBatch:
        """FrameBatch of raw columns (keys as in `FrameBatch.columns`), each of n values, and their int64[n] index."""
        rate_dps = self.rate.value(columns["rate"])
        if self.temperature is None:
            temperature_degc = np.full(len(index), np.nan)
        else:
            temperature_degc = self.temperature.value(columns["temperature"])
        good = np.isfinite(rate_dps)
        if "status" in columns:
            status = columns["status"]
            good &= (status & self.good_mask) == self.good_value & self.good_mask
        channels = {name: law.value(columns[name]) for name, law in self.channels.items()}
        return FrameBatch(columns, index, rate_dps, temperature_degc, good, channels)

    def raw_columns(
        self,
        rate_dps: Floats,
        temperature_degc: Floats,
        good: NDArray[np.bool_],
        kinds: Mapping[str, RawType],
        channels: Channels = NO_CHANNELS,
    ) -> dict[str, Raw | int]:
        """What a gyro would send; `kinds` holds the raw type of each column wanted (rate, temperature, status, ...).

        rate_dps, temperature_degc, each of the channels: float64[n]; good: bool[n]. A status that is good throughout
        comes as one int; a channel that is not given, or that the frame does not carry, does not come.
        """
        columns: dict[str, Raw | int] = {"rate": self.rate.raw(rate_dps, kinds["rate"])}
        if self.temperature is not None:
            columns["temperature"] = self.temperature.raw(temperature_degc, kinds["temperature"])
        if "status" in kinds:
            bad_value = self.good_value ^ self.good_mask
            if good.all():
                columns["status"] = self.good_value
            else:
                columns["status"] = np.where(good, self.good_value, bad_value).astype(kinds["status"].dtype)
        for name, law in self.channels.items():
            if name in channels:
                columns[name] = law.raw(channels[name], kinds[name])
        return columns
