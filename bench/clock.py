"""The one clock (law 3): every wait and every stamp of a run goes through it.

On a virtual bench it is a simpy environment that moves only while somebody waits; on a real bench it is the wall.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from bench.errors import Interrupted

# How long a pause idles before it looks again.
IDLE_S = 0.05
# How often a waiting process looks whether it shall stop, and shows that it is alive.
LOOK_S = 0.1


class Clock(Protocol):
    """Seconds since the clock was made, and waiting.

    A stop that was asked for is noticed where somebody waits, never in the middle of a word on the wire.
    """

    virtual: bool
    stop: StopRequest

    def now(self) -> float:
        """Seconds of bench time."""
        ...

    def wait(self, seconds: float) -> None:
        """Return after `seconds` of bench time; at once if not positive."""
        ...

    def idle(self) -> None:
        """Pass a moment of the wall while nothing shall happen on the bench: a pause stops virtual time."""
        ...


class StopRequest:
    """Asks whoever waits on a clock to stop; set from a signal handler or another thread.

    A plain flag that is looked at, not an Event: setting an Event takes a lock that the interrupted thread may hold.
    """

    def __init__(self) -> None:
        self._asked = self._deaf = False
        # Asked to stop at once: whoever makes the bench safe commands it and waits for nothing.
        self.hurried = False
        # The bench was brought to its safe state; then: its ports are closed too, and what is left is paper work.
        self.safe = self.over = False
        self.alive: Callable[[], None] = lambda: None

    def ask(self) -> None:
        """Make the present or next wait raise Interrupted."""
        self._asked = True

    def hurry(self) -> None:
        """The same, and leave out everything but the commands that make the bench safe."""
        self.hurried = True
        self._asked = True

    def forget(self) -> None:
        """From now on let waits go on, whatever is asked, for bringing the bench to its safe state."""
        self._deaf = True

    def look(self) -> None:
        """Raise Interrupted if asked to stop, but while the bench is made safe."""
        if (self._asked and not self._deaf) or (self.hurried and self.safe):
            raise Interrupted("stopped on request")

    def wait(self, seconds: float) -> None:
        """Wait on the wall until asked or `seconds` have passed; then raise Interrupted if asked.

        `alive` is called at least every LOOK_S, for whoever has to know that this process does not hang.
        """
        end = time.monotonic() + seconds
        while True:
            self.alive()
            self.look()
            left = end - time.monotonic()
            if left <= 0.0:
                return
            time.sleep(min(left, LOOK_S))


class VirtualClock:
    """Bench time of a simpy environment."""

    virtual = True

    def __init__(self, env: Any) -> None:
        self._env = env
        self.stop = StopRequest()

    def now(self) -> float:
        return float(self._env.now)

    def wait(self, seconds: float) -> None:
        end = self._env.now + seconds
        # simpy refuses to run until the present instant.
        if end > self._env.now:
            self._env.run(until=end)
        self.stop.wait(0.0)

    def idle(self) -> None:
        self.stop.wait(IDLE_S)


class WallClock:
    """Bench time of a real bench; immune to steps of the host's calendar clock.

    With live simulators bench time is the wall's times their `speed`.
    """

    virtual = False

    def __init__(self, start_s: float = 0.0, speed: float = 1.0) -> None:
        self._start, self._start_s, self._speed = time.monotonic(), start_s, speed
        self.stop = StopRequest()

    def now(self) -> float:
        return self._start_s + (time.monotonic() - self._start) * self._speed

    def wait(self, seconds: float) -> None:
        self.stop.wait(max(seconds, 0.0) / self._speed)

    def idle(self) -> None:
        self.stop.wait(IDLE_S)


def utc_now() -> str:
    """The host's calendar time, for provenance only, e.g. '2026-11-22T08:44:00Z'."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def seconds_since_changed(path: Path) -> float:
    """Calendar seconds since a file was last written; never negative, whatever the host's clock did meanwhile."""
    return max(0.0, time.time() - path.stat().st_mtime)


def stopwatch() -> float:
    """Wall seconds for measuring how long a computation took; never for deciding anything."""
    return time.perf_counter()
