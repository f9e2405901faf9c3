"""What a wire front end asks of a gyro: which frames it has sent, and what was in them; nothing of wires."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.codecs.batch import NO_CHANNELS, Channels

# Frames made and encoded together: enough to be fast, few enough to stay in the processor's second-level cache.
SLICE_FRAMES = 8192


class GyroBlock(Protocol):
    """Consecutive frames: float64[n], float64[n], bool[n]; it may have `channels` too, by name float64[n] each."""

    @property
    def rate_dps(self) -> NDArray[np.float64]: ...
    @property
    def temperature_degc(self) -> NDArray[np.float64]: ...
    @property
    def good(self) -> NDArray[np.bool_]: ...


class GyroPhysics(Protocol):
    """Frames 0, 1, 2 ... sent evenly, on its own clock, by a gyro powered from time 0 on."""

    data_rate_hz: float

    def frames_until(self, now_s: float) -> int:
        """How many frames have been sent by then."""
        ...

    def block(self, first: int, end: int, /) -> GyroBlock:
        """Frames first ... end - 1."""
        ...


def channels_of(block: GyroBlock) -> Channels:
    """What physics stands behind a block's channels: by name float64[n]."""
    channels: Channels = getattr(block, "channels", NO_CHANNELS)
    return channels
