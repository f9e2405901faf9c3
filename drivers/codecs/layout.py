"""Numbers at fixed places of a frame, read from and written to whole batches of frames."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.batch import Raw, RawType
from drivers.codecs.crc import Checksum

# name -> (bytes on the wire, type once unpacked)
FIELD_TYPES: Mapping[str, tuple[int, RawType]] = MappingProxyType(
    {f"u{bits}": (bits // 8, RawType.integer(bits, signed=False)) for bits in (8, 16, 24, 32)}
    | {f"i{bits}": (bits // 8, RawType.integer(bits, signed=True)) for bits in (8, 16, 24, 32)}
    | {"f32": (4, RawType(np.dtype("f4"))), "f64": (8, RawType(np.dtype("f8")))}
)


@dataclass(frozen=True)
class Field:
    """A number at a fixed place of the frame."""

    name: str
    at: int
    type: str
    byte_order: str

    @property
    def size(self) -> int:
        """Bytes it takes."""
        return FIELD_TYPES[self.type][0]

    @property
    def raw_type(self) -> RawType:
        """Its type once unpacked, and its limits."""
        return FIELD_TYPES[self.type][1]

    @property
    def columns(self) -> range:
        """The bytes of the frame it takes."""
        return range(self.at, self.at + self.size)

    def read(self, rows: NDArray[np.uint8]) -> Raw:
        """Its values in frames uint8[n, length], as a new array of its raw type."""
        part = rows[:, self.at : self.at + self.size]
        if self.size == 3:
            wide = np.zeros((len(rows), 4), np.uint8)
            wide[:, slice(0, 3) if self.byte_order == "big" else slice(1, 4)] = part
            # the number stands in the upper three bytes; an arithmetic shift brings its sign along
            return self._view(wide).astype(self.raw_type.dtype) >> 8
        return self._view(part).astype(self.raw_type.dtype)

    def write(self, rows: NDArray[np.uint8], values: Raw) -> None:
        """Put values of its raw type into frames uint8[n, length]."""
        if self.size == 3:
            wide = np.empty((len(rows), 4), np.uint8)
            self._view(wide)[:] = values
            part = wide[:, slice(1, 4) if self.byte_order == "big" else slice(0, 3)]
            rows[:, self.at : self.at + 3] = part
        else:
            self._view(rows[:, self.at : self.at + self.size])[:] = values

    def _view(self, part: NDArray[np.uint8]) -> Raw:
        return part.view(self.raw_type.dtype.newbyteorder(">" if self.byte_order == "big" else "<"))[:, 0]


@dataclass(frozen=True)
class ChecksumPlace:
    """The checksum of bytes start..stop-1 stands at `at`; `padding` zero bytes are computed but not sent."""

    kind: str
    algorithm: Checksum
    start: int
    stop: int
    at: int
    byte_order: str
    padding: int

    def computed(self, rows: NDArray[np.uint8], varying: list[int] | None = None) -> NDArray[np.uint32]:
        """What it should be, uint32[n], for frames uint8[n, length]; `varying` as in `Checksum.of_rows`."""
        covered = None if varying is None else [at - self.start for at in varying if self.start <= at < self.stop]
        return self.algorithm.of_rows(rows[:, self.start : self.stop], covered, self.padding)

    def read(self, rows: NDArray[np.uint8]) -> NDArray[np.uint32]:
        """What stands there, uint32[n]."""
        return self._field.read(rows).astype(np.uint32, copy=False)

    def write(self, rows: NDArray[np.uint8], values: NDArray[np.uint32]) -> None:
        """Put it there."""
        self._field.write(rows, values)

    @property
    def _field(self) -> Field:
        return Field("checksum", self.at, f"u{8 * self.algorithm.size}", self.byte_order)
