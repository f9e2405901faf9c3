"""The faults of a gyro: of its output, and of its frames on their way."""

from dataclasses import dataclass

from simulated_hw.faults.script import Script
from simulated_hw.physics.parameters import require, require_positive


@dataclass(frozen=True)
class Loss(Script):
    """Single frames are never sent.

    Fields:
        probability: per frame.
    """

    probability: float = 1e-5

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")


@dataclass(frozen=True)
class BurstLoss(Script):
    """Frames are lost in bursts (Gilbert and Elliott's two states).

    Fields:
        enter: probability per frame of a burst to begin.
        mean_frames: mean length of a burst.
    """

    enter: float = 1e-6
    mean_frames: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("enter")
        require(self, 1.0 <= self.mean_frames <= 1e6, "mean_frames", "from 1 to 1e6")


@dataclass(frozen=True)
class BitError(Script):
    """Bits of frames are flipped on the line. Not within 32 frames behind a slipped byte, so that both can be told.

    Fields:
        probability: per bit.
    """

    probability: float = 1e-8

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")


@dataclass(frozen=True)
class Duplicate(Script):
    """Frames are sent twice.

    Fields:
        probability: per frame.
    """

    probability: float = 1e-6

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")


@dataclass(frozen=True)
class SyncSlip(Script):
    """One byte of a frame is missing, so that everything behind it stands one byte earlier. At most one in 32 frames.

    Fields:
        probability: per frame.
    """

    probability: float = 1e-6

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")


@dataclass(frozen=True)
class Frozen(Script):
    """The rate repeats itself; checksum, counter, status and temperature are as they should be."""


@dataclass(frozen=True)
class Spike(Script):
    """Single frames have a rate that is far off, up or down.

    Fields:
        probability: per frame.
        size_dps: how far off.
    """

    probability: float = 1e-7
    size_dps: float = 100.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_probability("probability")
        require_positive(self, "size_dps")


@dataclass(frozen=True)
class Silence(Script):
    """The gyro sends nothing; its counter runs on."""


@dataclass(frozen=True)
class PowerReset(Script):
    """The gyro is without power for a while; then its counter starts at 0 and its turn-on bias is drawn anew.

    It does not cool down meanwhile.

    Fields:
        for_s: how long the power is off.
    """

    for_s: float | None = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_begin()
        require(self, self.for_s is not None, "for_s", "given: how long the power is off")


@dataclass(frozen=True)
class Late(Script):
    """Nothing arrives for a while, then everything that was sent meanwhile.

    Fields:
        for_s: how long nothing arrives.
    """

    for_s: float | None = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_begin()
        require(self, self.for_s is not None, "for_s", "given: how long nothing arrives")
