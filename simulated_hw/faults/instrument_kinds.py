"""The faults of the instruments that are commanded: of their replies, of the rate table, of the chamber."""

from dataclasses import dataclass
from typing import Literal

from simulated_hw.faults.script import Script
from simulated_hw.physics.parameters import require, require_finite, require_not_negative, require_positive


@dataclass(frozen=True)
class NoReply(Script):
    """Requests are carried out and not answered.

    Fields:
        probability: per reply.
    """

    probability: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")


@dataclass(frozen=True)
class LateReply(Script):
    """Replies come late.

    Fields:
        probability: per reply.
        delay_s: by how much; beyond the driver's reply_timeout a reply is as good as none, and worse to the next.
    """

    probability: float = 1.0
    delay_s: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")
        require_positive(self, "delay_s")


@dataclass(frozen=True)
class GarbledReply(Script):
    """Replies have wrong bits. A protocol without checksum (ACL) cannot always see it.

    Fields:
        probability: per reply.
        bits: how many are flipped in each.
    """

    probability: float = 1.0
    bits: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")
        require(self, 1 <= self.bits <= 8, "bits", "from 1 to 8")


@dataclass(frozen=True)
class TableFault(Script):
    """The drive trips: the interlock opens, the axis coasts to rest, everything is refused until a reset.

    Fields:
        reason: what the interlock says.
        for_s: how long a reset does not help.
    """

    reason: str = "drive"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_begin()
        require(self, 0 < len(self.reason) <= 40 and self.reason.isprintable(), "reason", "1 to 40 characters")
        require(self, self.reason.isascii() and ";" not in self.reason, "reason", "ASCII without ';'")


@dataclass(frozen=True)
class OverSpeed(Script):
    """The servo runs away from its demand; at the trip rate the interlock opens and the axis coasts to rest.

    Fields:
        trip: the trip rate over the table's maximum rate; 1.05 to 1.1 is usual.
        for_s: how long a reset does not help.
    """

    trip: float = 1.05

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_begin()
        require(self, 1.0 <= self.trip <= 2.0, "trip", "from 1 to 2")


@dataclass(frozen=True)
class EStop(Script):
    """Somebody presses the emergency stop: the brake stops the axis, everything is refused until a reset.

    Fields:
        for_s: how long the button stays pressed; a reset does not help before.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_begin()


@dataclass(frozen=True)
class EncoderError(Script):
    """The table's readbacks are wrong; its motion is not.

    Fields:
        rate_offset_dps, position_offset_deg: added to the readback.
        rate_ripple_dps: amplitude of an error of the rate that repeats once per turn.
    """

    rate_offset_dps: float = 0.1
    rate_ripple_dps: float = 0.0
    position_offset_deg: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "rate_offset_dps", "position_offset_deg")
        require_not_negative(self, "rate_ripple_dps")


@dataclass(frozen=True)
class Stuck(Script):
    """The axis stops and stays where it is, although demands are acknowledged; freed, it follows the last of them."""


@dataclass(frozen=True)
class Alarm(Script):
    """The chamber's controller reports an alarm (registers 102 and 106); it goes on controlling.

    Fields:
        alarm: which one.
        state: which side.
    """

    alarm: Literal[1, 2] = 1
    state: Literal["high", "low"] = "high"


@dataclass(frozen=True)
class SensorBreak(Script):
    """The chamber's temperature reads full scale; the control loop has a sensor of its own and goes on.

    Fields:
        reading_degc: full scale of the input.
    """

    reading_degc: float = 800.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "reading_degc")


@dataclass(frozen=True)
class DoorOpen(Script):
    """The chamber's door is open: heat flows to and from the room many times faster. The controller shows it if it has
    a register for its switch (setting door_register of the watlow_f4).

    Fields:
        leak: how many times; 20 to 50 is usual.
    """

    leak: float = 30.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, 1.0 <= self.leak <= 1000.0, "leak", "from 1 to 1000")


@dataclass(frozen=True)
class WeakCooling(Script):
    """The compressor is weak; with the usual plant and a fifth of its power it does not get below about -17 °C.

    Fields:
        remaining: the part of its power that is left, 0 to 1.
    """

    remaining: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, 0.0 <= self.remaining <= 1.0, "remaining", "from 0 to 1")
