"""A message of a DBC file read as a gyro's frame: which signal is the rate, and what its numbers mean."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from drivers.codecs.batch import Meaning, Quantity, Raw, RawType
from drivers.codecs.channels import unit_of
from drivers.codecs.dbc import EXTENDED, PAYLOAD_BYTES, Message, Payload, Signal, encode_messages, parse_dbc
from drivers.codecs.declared import FrameSpecError, did_you_mean, find_file, packaged_folder, read_small, whole_number

PACKAGED = ("gyros", "frames")
_LARGEST_DBC_BYTES = 16 << 20
_LARGEST_STANDARD_ID = 0x7FF
_LARGEST_ID = 0x1FFFFFFF

DEFAULTS: Mapping[str, Any] = MappingProxyType(
    {
        "dbc": "fog_gyro",
        **dict.fromkeys(("message", "can_id", "rate_unit", "temperature_unit", "counter_modulo", "good_mask")),
        **{role: role for role in ("rate", "temperature", "counter", "status")},
        "good_value": 0,
        "channels": MappingProxyType({}),
    }
)

# What DBC files write as units -> (degrees per unit, 1 if per second, 0 if an increment since the last frame)
RATE_UNITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **dict.fromkeys(("deg/s", "°/s", "dps", "deg/sec"), (1.0, 1.0)),
        "rad/s": (math.degrees(1.0), 1.0),
        **dict.fromkeys(("deg", "°"), (1.0, 0.0)),
        "rad": (math.degrees(1.0), 0.0),
    }
)
# unit -> (factor, offset) to degC
TEMPERATURE_UNITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **dict.fromkeys(("degC", "°C", "C", "deg C"), (1.0, 0.0)),
        **dict.fromkeys(("degF", "°F"), (5.0 / 9.0, -160.0 / 9.0)),
        "K": (1.0, -273.15),
    }
)
# unit of a channel (`drivers.codecs.channels`) -> what DBC files write for it, with (factor, offset) to it
CHANNEL_UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "degC": TEMPERATURE_UNITS,
        "deg/s": MappingProxyType({unit: (f, 0.0) for unit, (f, per_second) in RATE_UNITS.items() if per_second}),
        "g": MappingProxyType({"g": (1.0, 0.0), **dict.fromkeys(("m/s^2", "m/s²", "m/s2"), (1.0 / 9.80665, 0.0))}),
    }
)


@dataclass(frozen=True)
class CanSpec:
    """One message of a DBC read as a gyro's frame.

    signals: those used, keyed rate, temperature, counter, status, and by the names of channels. channel_laws: by name.
    """

    message: Message
    can_id: int
    signals: Mapping[str, Signal]
    counter_modulo: int | None
    rate_law: Quantity
    rate_is_increment: bool
    temperature_law: Quantity | None
    good_mask: int
    good_value: int
    channel_laws: Mapping[str, Quantity] = field(default_factory=dict)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "CanSpec":
        """Read a DBC. settings: the fields of `drivers.gyros.can_dbc.CanGyroSettings`, explained there; any may miss.

        Raises FrameSpecError naming the file and what it has instead.
        """
        settings = {**DEFAULTS, **settings}
        dbc = settings["dbc"]
        file = find_file(dbc, packaged_folder(PACKAGED), ".dbc", "dbc")
        try:
            messages = parse_dbc(read_small(file, "latin-1", _LARGEST_DBC_BYTES))
            return cls._of(_choose(messages, settings["message"]), settings)
        except FrameSpecError as error:
            raise FrameSpecError(f"dbc '{dbc}': {error}") from None

    @classmethod
    def _of(cls, message: Message, settings: Mapping[str, Any]) -> "CanSpec":
        roles = [role for role in ("rate", "temperature", "counter", "status") if settings[role] is not None]
        signals = {role: _pick(message, role, settings[role]) for role in roles}
        factor, per_second = _unit(signals["rate"], "rate", settings["rate_unit"], RATE_UNITS)
        channels = _channels(message, settings["channels"] or {})
        signals |= {name: signal for name, (signal, _) in channels.items()}
        good_mask, good_value = _good(signals.get("status"), settings)
        return cls(
            message=message,
            can_id=_identifier(message, settings["can_id"]),
            signals=MappingProxyType(signals),
            counter_modulo=_modulo(signals.get("counter"), settings["counter_modulo"]),
            rate_law=Quantity(signals["rate"].scale * factor, signals["rate"].offset * factor, "deg"),
            rate_is_increment=not per_second,
            temperature_law=_temperature_law(signals.get("temperature"), settings["temperature_unit"]),
            good_mask=good_mask,
            good_value=good_value,
            channel_laws=MappingProxyType({name: law for name, (_, law) in channels.items()}),
        )

    @property
    def name(self) -> str:
        """How reports call the frame."""
        return f"CAN message {self.message.name} (id {self.can_id & ~EXTENDED:X})"

    def meaning(self, data_rate_hz: float) -> Meaning:
        """How its raw columns are read at a data rate: an increment per frame times frames per second is a rate."""
        factor = data_rate_hz if self.rate_is_increment else 1.0
        rate = Quantity(self.rate_law.scale * factor, self.rate_law.offset * factor, "deg/s")
        return Meaning(rate, self.temperature_law, self.good_mask, self.good_value, self.channel_laws)

    def encode(self, columns: Mapping[str, Raw | int], count: int) -> Payload:
        """Payloads uint8[count, 8] of raw values by role (rate, temperature, counter, status, names of channels)."""
        by_signal = {self.signals[role].name: values for role, values in columns.items()}
        return encode_messages(self.message, by_signal, count)

    @property
    def raw_types(self) -> dict[str, RawType]:
        """Raw type of each column, by role."""
        return {role: signal.raw_type for role, signal in self.signals.items()}


def _choose(messages: Mapping[str, Message], name: str | None) -> Message:
    if name is None and len(messages) == 1:
        return next(iter(messages.values()))
    if name is None or name not in messages:
        asked = "say which message is the gyro's" if name is None else f"there is no message '{name}'"
        raise FrameSpecError(f"message: {asked}. It has: {', '.join(messages)}.{did_you_mean(name, messages)}")
    chosen = messages[name]
    if chosen.length > PAYLOAD_BYTES:
        raise FrameSpecError(f"message {name} has {chosen.length} bytes; only classic CAN (8 bytes) is supported")
    return chosen


def _pick(message: Message, role: str, name: str) -> Signal:
    if name not in message.signals:
        optional = "" if role == "rate" else f", or null if it sends no {role}"
        has = f"message {message.name} has: {', '.join(message.signals)}{optional}"
        raise FrameSpecError(f"{role}: there is no signal '{name}'; {has}.{did_you_mean(name, message.signals)}")
    signal = message.signals[name]
    if signal.multiplexed:
        raise FrameSpecError(f"{role}: signal {name} is multiplexed; only signals present in every message can be used")
    if signal.last_byte >= message.length:
        raise FrameSpecError(f"{role}: signal {name} reaches beyond the {message.length} bytes of {message.name}")
    if role in ("counter", "status") and signal.raw_type.dtype.kind != "u":
        raise FrameSpecError(f"{role}: signal {name} must be an unsigned integer")
    return signal


def _identifier(message: Message, can_id: int | str | None) -> int:
    if can_id is None:
        return message.can_id
    number = whole_number(can_id)
    if number is None or not 0 <= number <= _LARGEST_ID:
        raise FrameSpecError(f"can_id: {can_id} is not allowed. Allowed: 0 to {_LARGEST_ID:#x}, like 0x1A0")
    return number | (EXTENDED if number > _LARGEST_STANDARD_ID else 0)


def _unit(signal: Signal, role: str, unit: str | None, known: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    # a degree sign in a UTF-8 file reads as two characters here
    unit = signal.unit.replace("\xc2", "") if unit is None else unit
    if unit not in known:
        text = f"unit '{unit}' of signal {signal.name} is not known; set {role}_unit to one of {', '.join(known)}"
        raise FrameSpecError(f"{role}: {text}")
    return known[unit]


def _temperature_law(signal: Signal | None, unit: str | None) -> Quantity | None:
    if signal is None:
        return None
    factor, offset = _unit(signal, "temperature", unit, TEMPERATURE_UNITS)
    return Quantity(signal.scale * factor, signal.offset * factor + offset, "degC")


def _channels(message: Message, settings: Mapping[str, str]) -> dict[str, tuple[Signal, Quantity]]:
    """Signal and law of each channel, its value in the unit its name ends in."""
    channels: dict[str, tuple[Signal, Quantity]] = {}
    for name, chosen in settings.items():
        try:
            unit = unit_of(str(name))
        except ValueError as error:
            raise FrameSpecError(f"channels: {error}") from None
        signal = _pick(message, f"channels.{name}", chosen)
        known = CHANNEL_UNITS.get(unit, {unit: (1.0, 0.0)})
        written = signal.unit.replace("\xc2", "") or unit
        if written not in known:
            text = f"signal {signal.name} has the unit '{written}', but the name says {unit}"
            raise FrameSpecError(f"channels.{name}: {text}. Allowed in the DBC: {', '.join(known)}, or none")
        factor, offset = known[written]
        channels[name] = signal, Quantity(signal.scale * factor, signal.offset * factor + offset, unit)
    return channels


def _modulo(signal: Signal | None, modulo: int | None) -> int | None:
    if signal is None:
        return None
    largest = 1 << signal.length
    if modulo is not None and not 2 <= modulo <= largest:
        raise FrameSpecError(f"counter_modulo: {modulo} is not allowed. Allowed: 2 to {largest} ({signal.length} bits)")
    return modulo or largest


def _good(signal: Signal | None, settings: Mapping[str, Any]) -> tuple[int, int]:
    """Mask and value of a good status."""
    if signal is None:
        return 0, 0
    largest = (1 << signal.length) - 1
    numbers = []
    for name in ("good_mask", "good_value"):
        number = largest if settings[name] is None else whole_number(settings[name])
        if number is None or not 0 <= number <= largest:
            text = f"{settings[name]} is not allowed. Allowed: 0 to {largest} ({signal.length} bits)"
            raise FrameSpecError(f"{name}: {text}")
        numbers.append(number)
    return numbers[0], numbers[1]
