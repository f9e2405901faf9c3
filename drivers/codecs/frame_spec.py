"""A gyro's serial frame, declared as data, so that a lab adds its own without code.

name: my gyro
length: 19                      # bytes of one frame
header: EB 90                   # what every frame begins with; trailer: 0D 0A, if it ends with something fixed
byte_order: big                 # big or little
fields:                         # only those used need to be declared
  - {name: rate, at: 2, type: i32}           # u8 i8 u16 i16 u24 i24 u32 i32 f32 f64
checksum: {kind: sum-mod-255, over: [0, 18], at: 18}     # over: first byte, byte after the last
counter: {field: counter, modulo: 256, step: 1}          # step: how much it counts from frame to frame
rate: {field: rate, kind: rate, unit: deg, scale: 1e-6}  # kind: rate (per second) or increment (since the last frame)
temperature: {field: temp, unit: degC, scale: 0.01, offset: 0}   # value = raw * scale + offset
status: {field: status, good_mask: 0x01, good_value: 0x01}
channels:                       # what else it carries; names end in the unit (see `drivers.codecs.channels`)
  anode_degc: {field: t1, scale: 0.01, offset: 0}        # value = raw * scale + offset, in the unit of the name
                                                         # a field may be the temperature and a channel too
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from drivers.codecs.batch import Meaning, Quantity
from drivers.codecs.channels import unit_of
from drivers.codecs.crc import CHECKSUMS, Crc
from drivers.codecs.declared import FrameSpecError, Keys, load_declaration, whole_number
from drivers.codecs.layout import FIELD_TYPES, ChecksumPlace, Field

PACKAGED = ("gyros", "frames")
LONGEST_FRAME = 1024
_ROLES = ("rate", "temperature", "counter", "status")

# unit of a temperature -> (factor, offset) to degC
_DEGC: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"degC": (1.0, 0.0), "degF": (5.0 / 9.0, -160.0 / 9.0), "K": (1.0, -273.15)}
)


@dataclass(frozen=True)
class Counter:
    """Which field counts frames: in steps of `step`, modulo `modulo`."""

    field: Field
    modulo: int
    step: int


@dataclass(frozen=True)
class FrameSpec:
    """A declared frame. `rate`, `temperature`, `status` name the fields with these meanings.

    channels, channel_laws: field and law of each channel, by its name.
    """

    name: str
    length: int
    header: bytes
    trailer: bytes
    fields: Mapping[str, Field]
    checksum: ChecksumPlace | None
    counter: Counter | None
    rate: Field
    rate_is_increment: bool
    rate_law: Quantity
    temperature: Field | None
    temperature_law: Quantity | None
    status: Field | None
    good_mask: int
    good_value: int
    channels: Mapping[str, Field]
    channel_laws: Mapping[str, Quantity]

    @classmethod
    def from_mapping(cls, declaration: Mapping[str, Any]) -> "FrameSpec":
        """Read a whole declaration (no base). Raises FrameSpecError."""
        return _Reading(Keys(declaration, "")).spec()

    @classmethod
    def load(cls, declaration: str | Mapping[str, Any]) -> "FrameSpec":
        """Name of a packaged frame, path of a YAML file, or a mapping that may be built on a `base`.

        Raises FrameSpecError, naming the declaration.
        """
        mapping = load_declaration(declaration, PACKAGED)
        try:
            return cls.from_mapping(mapping)
        except FrameSpecError as error:
            name = declaration if isinstance(declaration, str) else mapping.get("name", "?")
            raise FrameSpecError(f"frame '{name}': {error}") from None

    def meaning(self, data_rate_hz: float) -> Meaning:
        """How its raw columns are read at a data rate: an increment per frame times frames per second is a rate."""
        factor = data_rate_hz if self.rate_is_increment else 1.0
        rate = Quantity(self.rate_law.scale * factor, self.rate_law.offset * factor, "deg/s")
        return Meaning(rate, self.temperature_law, self.good_mask, self.good_value, self.channel_laws)

    @property
    def columns(self) -> dict[str, Field]:
        """The fields a FrameBatch keeps, by their meaning: rate, temperature, counter, status, names of channels."""
        counter = self.counter.field if self.counter else None
        fields = {"rate": self.rate, "temperature": self.temperature, "counter": counter, "status": self.status}
        return {meaning: field for meaning, field in fields.items() if field} | dict(self.channels)


class _Reading:
    """From keys to a FrameSpec; every complaint names its key path."""

    def __init__(self, keys: Keys) -> None:
        self.keys = keys
        keys.only("name", "length", "header", "trailer", "byte_order", "fields", "checksum", *_ROLES, "channels")
        self.name = keys.text("name", "what reports call the frame")
        self.length = keys.integer("length", 2, LONGEST_FRAME, what="the bytes of one frame")
        self.byte_order = keys.choice("byte_order", ("big", "little"), "big", "the order of bytes in a number")
        self.header = self._fixed("header", keys.required("header", "the bytes every frame begins with"))
        self.trailer = self._fixed("trailer", keys.get("trailer")) if keys.get("trailer") is not None else b""
        self.taken = dict.fromkeys(range(len(self.header)), "header")
        self.taken |= {self.length - 1 - at: "trailer" for at in range(len(self.trailer))}

    def spec(self) -> FrameSpec:
        fields = {field.name: field for field in map(self._field, self.keys.sections("fields"))}
        checksum = self._checksum()
        counter = self._counter(fields)
        rate, is_increment, rate_law = self._rate(fields)
        temperature, temperature_law = self._temperature(fields)
        status, mask, value = self._status(fields)
        channels = self._channels(fields)
        return FrameSpec(
            self.name, self.length, self.header, self.trailer, MappingProxyType(fields), checksum, counter,
            rate, is_increment, rate_law, temperature, temperature_law, status, mask, value,
            MappingProxyType({name: field for name, (field, _) in channels.items()}),
            MappingProxyType({name: law for name, (_, law) in channels.items()}),
        )  # fmt: skip

    def _fixed(self, key: str, value: Any) -> bytes:
        text = value.replace("0x", "") if isinstance(value, str) else ""
        try:
            fixed = bytes.fromhex(text)
        except ValueError:
            fixed = b""
        if not 1 <= len(fixed) <= min(8, self.length - 1):
            raise self.keys.error(
                key, f"{value!r} is not allowed. Write 1 to 8 bytes in hex and in quotes: 'FE 81 FF 55'"
            )
        return fixed

    def _take(self, keys: Keys, what: str, places: range) -> None:
        if places.stop > self.length:
            text = f"{what} ends at byte {places.stop}, but the frame has {self.length} (0 to {self.length - 1})"
            raise keys.error("at", text)
        for at in places:
            if at in self.taken:
                raise keys.error("at", f"byte {at} belongs to {self.taken[at]} already, {what} cannot be there too")
            self.taken[at] = what

    def _field(self, keys: Keys) -> Field:
        keys.only("name", "at", "type", "byte_order")
        name = keys.text("name", "the field's name")
        at = keys.integer("at", 0, self.length - 1, what="its first byte, counted from 0")
        kind = keys.choice("type", FIELD_TYPES, None, "its type")
        order = keys.choice("byte_order", ("big", "little"), self.byte_order, "the order of its bytes")
        field = Field(name, at, kind, order)
        self._take(keys, f"field {name}", field.columns)
        return field

    def _one_of(self, keys: Keys, fields: Mapping[str, Field], integer: bool) -> Field:
        field = fields[keys.choice("field", fields, None, "the name of one of the fields")]
        if integer and field.type.startswith(("f", "i")):
            raise keys.error(
                "field", f"{field.name} is {field.type}; this needs an unsigned integer (u8, u16, u24, u32)"
            )
        return field

    def _checksum(self) -> ChecksumPlace | None:
        keys = self.keys.section("checksum")
        if keys is None:
            raise self.keys.error("checksum", "is missing; if the frame has none, say so: {kind: none}")
        kind = keys.choice("kind", (*CHECKSUMS, "crc"), None, "the algorithm")
        own = ("width", "polynomial", "start", "reflected", "final_xor") if kind == "crc" else ()
        keys.only("kind", "over", "at", "byte_order", "pad_to", *own)
        if kind == "none":
            return None
        algorithm = _own_crc(keys) if kind == "crc" else CHECKSUMS[kind]
        over = keys.required("over", "the bytes it covers: [first, after the last]")
        ends = [whole_number(at) for at in over] if isinstance(over, list) and len(over) == 2 else [None]
        if None in ends:
            raise keys.error("over", f"{over!r} is not allowed. Allowed: [first byte, byte after the last]")
        start, stop = (at for at in ends if at is not None)
        at = keys.integer("at", 0, self.length - 1, what="its first byte")
        if not 0 <= start < stop <= self.length or (start < at + algorithm.size and at < stop):
            raise keys.error(
                "over", f"[{start}, {stop}] must lie inside the {self.length} bytes and not cover the checksum at {at}"
            )
        order = keys.choice("byte_order", ("big", "little"), self.byte_order, "the order of its bytes")
        pad_to = keys.integer("pad_to", 1, 64, default=1)
        self._take(keys, "checksum", range(at, at + algorithm.size))
        return ChecksumPlace(kind, algorithm, start, stop, at, order, (start - stop) % pad_to)

    def _counter(self, fields: Mapping[str, Field]) -> Counter | None:
        keys = self.keys.section("counter")
        if keys is None:
            return None
        keys.only("field", "modulo", "step")
        field = self._one_of(keys, fields, integer=True)
        full = 1 << 8 * field.size
        modulo = keys.integer("modulo", 2, full, default=full)
        step = keys.integer("step", 1, modulo // 2, default=1)
        if modulo % step:
            raise keys.error("step", f"{step} does not divide the modulo {modulo}")
        return Counter(field, modulo, step)

    def _rate(self, fields: Mapping[str, Field]) -> tuple[Field, bool, Quantity]:
        keys = self.keys.section("rate")
        if keys is None:
            raise self.keys.error("rate", "is missing; it says which field is the rate: {field, kind, unit, scale}")
        keys.only("field", "kind", "unit", "scale", "offset")
        field = self._one_of(keys, fields, integer=False)
        kind = keys.choice("kind", ("rate", "increment"), None, "whether the number is a rate or an angle increment")
        unit = keys.choice("unit", ("deg", "rad"), None, "the unit of angle (a rate is per second)")
        law = _law(keys, math.degrees(1.0) if unit == "rad" else 1.0, 0.0, "deg")
        return field, kind == "increment", law

    def _temperature(self, fields: Mapping[str, Field]) -> tuple[Field | None, Quantity | None]:
        keys = self.keys.section("temperature")
        if keys is None:
            return None, None
        keys.only("field", "unit", "scale", "offset")
        field = self._one_of(keys, fields, integer=False)
        unit = keys.choice("unit", _DEGC, "degC", "the unit")
        return field, _law(keys, *_DEGC[unit], "degC")

    def _status(self, fields: Mapping[str, Field]) -> tuple[Field | None, int, int]:
        keys = self.keys.section("status")
        if keys is None:
            return None, 0, 0
        keys.only("field", "good_mask", "good_value")
        field = self._one_of(keys, fields, integer=True)
        largest = (1 << 8 * field.size) - 1
        mask = keys.integer("good_mask", 0, largest, default=largest)
        value = keys.integer("good_value", 0, largest, what="the status of a healthy unit")
        return field, mask, value

    def _channels(self, fields: Mapping[str, Field]) -> dict[str, tuple[Field, Quantity]]:
        channels: dict[str, tuple[Field, Quantity]] = {}
        listed = self.keys.section("channels")
        for name in listed.names() if listed else ():
            assert listed is not None
            try:
                unit = unit_of(name)
            except ValueError as error:
                raise listed.error(name, str(error)) from None
            keys = listed.section(name)
            if keys is None:
                raise listed.error(name, "is empty; it says which field is the channel: {field, scale, offset}")
            keys.only("field", "scale", "offset")
            channels[name] = self._one_of(keys, fields, integer=False), _law(keys, 1.0, 0.0, unit)
        return channels


def _law(keys: Keys, factor: float, offset: float, unit: str) -> Quantity:
    scale = keys.number("scale", 1.0)
    if scale == 0.0:
        raise keys.error("scale", "0 is not allowed: value = raw * scale + offset")
    return Quantity(scale * factor, keys.number("offset", 0.0) * factor + offset, unit)


def _own_crc(keys: Keys) -> Crc:
    width = keys.integer("width", 8, 32, what="its bits: 8, 16, 24 or 32")
    if width % 8:
        raise keys.error("width", f"{width} is not allowed. Allowed: 8, 16, 24, 32")
    largest = (1 << width) - 1
    polynomial = keys.integer("polynomial", 1, largest, what="its polynomial without the top bit")
    start, final = keys.integer("start", 0, largest, default=0), keys.integer("final_xor", 0, largest, default=0)
    return Crc(width, polynomial, start, keys.flag("reflected"), final)
