"""The one clock (law 3): every wait and every stamp of a run goes through it.

On a virtual bench it is a simpy environment that moves only while somebody waits; on a real bench it is the wall.
"""

from __future__ import annotations

import threading
import time
from datetime import UTC, datetime
from typing import Any, Protocol

from bench.errors import Interrupted


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


class StopRequest:
    """Asks whoever waits on a clock to stop; set from a signal handler."""

    def __init__(self) -> None:
        self._asked = threading.Event()

    def ask(self) -> None:
        """Make the present or next wait raise Interrupted."""
        self._asked.set()

    def forget(self) -> None:
        """Let waits go on, for bringing the bench to its safe state."""
        self._asked.clear()

    def wait(self, seconds: float) -> None:
        """Wait on the wall until asked or `seconds` have passed; then raise Interrupted if asked."""
        if self._asked.wait(seconds):
            raise Interrupted("stopped on request")


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


class WallClock:
    """Bench time of a real bench; immune to steps of the host's calendar clock."""

    virtual = False

    def __init__(self) -> None:
        self._start = time.monotonic()
        self.stop = StopRequest()

    def now(self) -> float:
        return time.monotonic() - self._start

    def wait(self, seconds: float) -> None:
        self.stop.wait(max(seconds, 0.0))


def utc_now() -> str:
    """The host's calendar time, for provenance only, e.g. '2026-11-22T08:44:00Z'."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def stopwatch() -> float:
    """Wall seconds for measuring how long a computation took; never for deciding anything."""
    return time.perf_counter()
