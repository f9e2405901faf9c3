"""A DUT whose power is switched: while it is off nothing is sent, and its counter begins again when it comes back.

The same as the fault power_reset makes of the frames, at the times at which a supply does it.
"""

from typing import Protocol, runtime_checkable

from simulated_hw.faults.frames import StreamFaults
from simulated_hw.faults.gyro_kinds import PowerReset
from simulated_hw.faults.kinds import FaultSpec
from simulated_hw.faults.log import FaultLog
from simulated_hw.faults.rules import Clock, Rule
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.streams import Stream

# In the log a place in the bench file, from 0; this one stands in none.
BY_THE_SUPPLY = -1


@runtime_checkable
class Streaming(Protocol):
    """A simulated gyro that lets its frames suffer on their way."""

    faults: StreamFaults | None


class Unpowered:
    """The times without power, as the windows of a fault."""

    def __init__(self, power: PowerHistory) -> None:
        self._power = power

    @property
    def complete(self) -> bool:
        """See Times: it can be switched off at any time."""
        return False

    def until(self, now_s: float) -> list[tuple[float, float]]:
        """All windows (begin, end) that began by now."""
        return self._power.gaps(now_s)

    def active(self, now_s: float) -> bool:
        """Whether there is no power at this instant."""
        return not self._power.is_on(now_s)


def follow_power(name: str, simulator: object, gyro: Clock, power: PowerHistory, log: FaultLog | None) -> None:
    """Let a simulated DUT be silent without power, beside what else may happen to its frames.

    Raises ValueError if its simulator cannot be silent.
    """
    if not isinstance(simulator, Streaming):
        raise ValueError(f"{type(simulator).__name__} of {name} cannot be without power: its frames suffer no faults")
    stream = Stream(0, name, "power")
    rule = Rule(BY_THE_SUPPLY, FaultSpec("power_reset", name, PowerReset(at_s=0.0)), Unpowered(power), stream, None)
    if simulator.faults is None:
        simulator.faults = StreamFaults(name, gyro, [], log or FaultLog())
    simulator.faults.add(rule)
