"""The instruments of a world, live: at wall speed or a multiple of it, on ports that any program can open.

The world is moved along the wall clock, and bytes are carried between its simulated ports and real ends (ptys, TCP
ports, a python-can bus). Nothing ends when a client goes: the table goes on turning, as a real one does. A live server
is the wall by definition, so this module alone in simulated_hw reads it (decision 0006).
"""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import can

from simulated_hw.endpoints import End, PtyEnd, TcpEnd
from simulated_hw.lines import Bus, Line, Port
from simulated_hw.wire.can_bus import SimulatedCanBus
from simulated_hw.wire.slcan import SlcanAdapter
from simulated_hw.world import InstrumentSpec, World, WorldSpec

# How often the world is moved and the ends are looked at, on the wall. A question is answered within two of these and
# the instrument's own time.
TICK_S = 0.002
# Bench time moved at once: what is generated for a host that slept stays small.
_STRIDE_S = 60.0
# A world that stands still for longer is behind: a quarter of a driver's usual reply time-out on the wall, and two
# looks of the engine at a settling table in bench time.
_LATE_WALL_S = 0.25
_LATE_BENCH_S = 0.5
_REPORT_S = 10.0
_BITRATE = 1_000_000
SLCAN = "slcan"

# A serial port or URL, or python-can interface and channel.
Address = str | tuple[str, str]


@dataclass(frozen=True)
class LiveOptions:
    """How the instruments are made reachable.

    Fields:
        speed: bench seconds per wall second.
        tcp: TCP ports of this machine instead of ptys.
        can: python-can interface and channel that all CAN gyros send on; None: a serial CAN adapter (slcan) for each.
        links: folder for symbolic links to the ptys, by the instrument's name; they survive a restart.
        bitrates: of the CAN channels, by address.
    """

    speed: float = 1.0
    tcp: bool = False
    can: tuple[str, str] | None = None
    links: Path | None = None
    bitrates: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 < self.speed < float("inf"):
            raise ValueError(f"speed: {self.speed:g} is not allowed. Allowed: above 0; 1 is the wall's own")
        if self.tcp and self.links:
            raise ValueError("links: a TCP port cannot be linked to. Leave out either --tcp or --links")


def _shown(address: Address) -> str:
    return address if isinstance(address, str) else ":".join(address)


class Lag:
    """How long the world stood still, and whether that is too long at this speed."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._allowed_s = min(_LATE_WALL_S, _LATE_BENCH_S / speed)
        self._worst_s = self._since_s = 0.0

    def note(self, wall_s: float, still_s: float) -> bool:
        """At `wall_s` the world had not moved for `still_s`, both on the wall. Whether a report is due."""
        self._worst_s = max(self._worst_s, still_s)
        return wall_s - self._since_s >= _REPORT_S

    def report(self, wall_s: float) -> str | None:
        """A sentence if it stood still for too long since the last report."""
        over_s, worst_s = wall_s - self._since_s, self._worst_s
        self._since_s, self._worst_s = wall_s, 0.0
        if worst_s <= self._allowed_s:
            return None
        return (
            f"the world falls behind the wall: in the last {over_s:.0f} s it stood still for up to "
            f"{worst_s * 1e3:.0f} ms, {worst_s * self._speed:.2g} s of bench time. Results may differ from those at "
            "speed 1: choose a smaller --speed, or give this machine less to do."
        )


class LiveBench:
    """A world on real ends. `addresses` has what a client opens, by the instrument's address in the spec.

    `tell` is called with a sentence when the world falls behind or a client is too slow for a stream.
    """

    def __init__(
        self,
        spec: WorldSpec,
        options: LiveOptions,
        truth_dir: Path | None = None,
        truth_period_s: float = 10.0,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._spec, self._options, self._tell = spec, options, tell
        self.world = World(spec, truth_dir, live_truth_period_s=truth_period_s)
        self._lines: dict[str, Line | Bus] = {}
        self._lost: dict[str, str] = {}
        self._lock = threading.Lock()
        # A flag and not an Event: a signal handler that sets an Event can wait for a lock held by its own thread.
        self._stopping = False
        self.addresses: dict[str, Address] = {}

    def open(self) -> None:
        """Build the world and its ends; time does not pass yet.

        Raises WorldError, can.CanError, or OSError if a pty, port, link or the truth cannot be made; nothing stays.
        """
        try:
            self.world.open()
            if self._options.links:
                self._options.links.mkdir(parents=True, exist_ok=True)
            for name, instrument in self._named():
                if instrument.address not in self.addresses:
                    self._connect(name, instrument.address)
        except BaseException:
            self.close()
            raise

    def _named(self) -> Iterator[tuple[str, InstrumentSpec]]:
        spec = self._spec
        named = {"chamber": spec.chamber, "rate_table": spec.rate_table, "supply": spec.supply}
        yield from ((name, instrument) for name, instrument in named.items() if instrument)
        yield from spec.duts.items()

    def _connect(self, name: str, address: str) -> None:
        options = self._options
        if not address.startswith("can:"):
            port, end = Port(address), self._end(name)
            self._lines[address], self.addresses[address] = Line(end, port), end.address
            return
        bitrate = options.bitrates.get(address, _BITRATE)
        near = SimulatedCanBus(address.removeprefix("can:"))
        if options.can is None:
            end = self._end(name)
            self._lines[address] = Line(end, SlcanAdapter(near, bitrate))
            self.addresses[address] = SLCAN, end.address
            return
        interface, channel = options.can
        far = can.Bus(channel, interface, ignore_config=True, bitrate=bitrate)
        self._lines[address], self.addresses[address] = Bus(near, far), options.can

    def _end(self, name: str) -> End:
        if self._options.tcp:
            return TcpEnd()
        return PtyEnd(self._options.links / name if self._options.links else None)

    def serve(self) -> None:
        """Let time pass until `stop`. Raises OSError if an end or the truth log fails."""
        began_s = moved_s = time.monotonic()
        lag = Lag(self._options.speed)
        while not self._stopping:
            time.sleep(TICK_S)
            before_s, moved_s = moved_s, time.monotonic()
            self._move((moved_s - began_s) * self._options.speed)
            if lag.note(moved_s - began_s, moved_s - before_s):
                self._report(lag, moved_s - began_s)
        self._report(lag, moved_s - began_s)

    def _move(self, until_s: float) -> None:
        """Move the world to that bench time, carrying what it says on the way."""
        env = self.world.env
        while env.now < until_s:
            env.run(until=min(until_s, env.now + _STRIDE_S))
            with self._lock:
                for line in self._lines.values():
                    line.pump()

    def _report(self, lag: Lag, wall_s: float) -> None:
        if text := lag.report(wall_s):
            self._tell(text)
        for address, line in self._lines.items():
            if line.lost and line.lost != self._lost.get(address):
                self._tell(f"{_shown(self.addresses[address])}: too slow a client, {line.lost} lost so far")
                self._lost[address] = line.lost

    def stop(self) -> None:
        """Make `serve` return; may be called from a signal handler or another thread."""
        self._stopping = True

    @contextmanager
    def in_background(self) -> Iterator[None]:
        """Serve from a thread. Raises what `serve` raised, at the end."""
        failures: list[BaseException] = []

        def served() -> None:
            try:
                self.serve()
            except BaseException as error:
                failures.append(error)

        thread = threading.Thread(target=served, name="live bench", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self.stop()
            thread.join()
        if failures:
            raise failures[0]

    def unplug(self, address: str) -> None:
        """Take an instrument's end away, as pulling its USB adapter does; the instrument goes on."""
        with self._lock:
            self._end_of(address).unplug()

    def plug(self, address: str) -> None:
        """Put it in again: at the same TCP port or link, or as another pty."""
        with self._lock:
            end = self._end_of(address)
            end.plug()
            there = self.addresses[address]
            self.addresses[address] = end.address if isinstance(there, str) else (there[0], end.address)

    def _end_of(self, address: str) -> End:
        line = self._lines[address]
        if isinstance(line, Bus):
            raise ValueError(f"{address} is on a shared CAN bus and has no plug of its own")
        return line.end

    def close(self) -> None:
        """Take all ends away and finish the truth log; closing twice is harmless."""
        while self._lines:
            _, line = self._lines.popitem()
            with suppress(OSError, can.CanError):
                line.close()
        self.world.close()

    def __enter__(self) -> "LiveBench":
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
