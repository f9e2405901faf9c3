"""When a fault is on: by bench time, by what chamber and table really do, or both.

Windows are a function of time alone. Conditions are looked at once a second of bench time, on the plants' own history,
so it does not matter who reads an instrument, or when.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite
from typing import Any, Protocol

import numpy as np
import simpy
from numpy.typing import NDArray

from simulated_hw.physics.parameters import require

# How often a condition is looked at; a chamber moves some hundredths of a degree in it.
GRID_S = 1.0

Floats = NDArray[np.float64]


class Chamber(Protocol):
    """What a condition asks of the chamber."""

    def air_degc(self, times_s: Floats) -> Floats: ...
    def setpoint_degc(self, now_s: float) -> float: ...


class Table(Protocol):
    """What a condition asks of the rate table."""

    def true_rate_dps(self, now_s: float) -> float: ...


@dataclass(frozen=True)
class Condition:
    """Where in the procedure a fault comes: what chamber and table truly do. All that is given must hold.

    Fields:
        chamber_below_degc, chamber_above_degc: the true air temperature.
        setpoint_below_degc, setpoint_above_degc: the chamber's setpoint, on its way along the ramp.
        table_below_dps, table_above_dps: the table's true rate, without its sign.
    """

    chamber_below_degc: float | None = None
    chamber_above_degc: float | None = None
    setpoint_below_degc: float | None = None
    setpoint_above_degc: float | None = None
    table_below_dps: float | None = None
    table_above_dps: float | None = None

    def __post_init__(self) -> None:
        if all(value is None for value in vars(self).values()):
            raise ValueError("when: states no condition; give one, such as {chamber_below: -10 degC}")

    def holds(self, times_s: Floats, chamber: Chamber, table: Table) -> NDArray[np.bool_]:
        """Whether it holds at these times, bool[n]."""
        seconds: list[float] = times_s.tolist()
        # The air, which costs most, is asked for last.
        measured: tuple[tuple[float | None, float | None, Callable[[], Floats]], ...] = (
            (self.table_above_dps, self.table_below_dps, lambda: np.abs([table.true_rate_dps(t) for t in seconds])),
            (
                self.setpoint_above_degc,
                self.setpoint_below_degc,
                lambda: np.array([chamber.setpoint_degc(t) for t in seconds]),
            ),
            (self.chamber_above_degc, self.chamber_below_degc, lambda: chamber.air_degc(times_s)),
        )
        true = np.ones(len(times_s), np.bool_)
        for above, below, values_of in measured:
            if (above is not None or below is not None) and true.any():
                values = values_of()
                true &= (values > (-inf if above is None else above)) & (values < (inf if below is None else below))
        return true


@dataclass(frozen=True)
class Script:
    """When a fault is on. Without any of the three it is on all the time.

    Fields:
        at_s: bench time from which on it may come.
        when: the place in the procedure at which it comes.
        for_s: how long it lasts from then on, once. Without it the fault lasts as long as `when` holds, or for ever.
    """

    at_s: float | None = None
    for_s: float | None = None
    when: Condition | None = None

    def __post_init__(self) -> None:
        at, lasts = self.at_s, self.for_s
        require(self, at is None or (isfinite(at) and at >= 0.0), "at_s", "a time, 0 s or later")
        require(self, lasts is None or (isfinite(lasts) and lasts > 0.0), "for_s", "a time above 0 s")

    @property
    def once_by_place(self) -> bool:
        """It comes the first time that the place is reached, and never again."""
        return self.when is not None and self.for_s is not None

    def require_begin(self) -> None:
        """It is nothing that could be on from the beginning. Raises ValueError."""
        require(self, self.at_s is not None or self.when is not None, "at_s", "given, or a 'when'")

    def require_probability(self, *fields: str) -> None:
        """Each field must be a probability. Raises ValueError."""
        for field in fields:
            require(self, 0.0 <= getattr(self, field) <= 1.0, field, "a probability, 0 to 1")


class Times(Protocol):
    """When a fault is on."""

    @property
    def complete(self) -> bool:
        """No further window can come."""
        ...

    def until(self, now_s: float) -> list[tuple[float, float]]:
        """All windows (begin, end) that began by now, in order; the end of one that is open is infinite."""
        ...

    def active(self, now_s: float) -> bool:
        """Whether the fault is on at this instant."""
        ...


class Windows:
    """The times during which a script's fault is on, found as far as somebody asks.

    start_s: when the world began; conditions are not looked at before. begun_s: when it began in an earlier world of
    the same run; what comes by place and once has then come. `on_begin` is told when such a fault begins.
    """

    def __init__(
        self, script: Script, chamber: Chamber, table: Table, start_s: float = 0.0, begun_s: float | None = None
    ) -> None:
        self._condition, self._chamber, self._table = script.when, chamber, table
        self._for_s = inf if script.for_s is None else script.for_s
        self._scanned = ceil(max(script.at_s or 0.0, start_s) / GRID_S)
        self._found: list[tuple[float, float]] = []
        self.on_begin: Callable[[float], None] = lambda begin_s: None
        has_come = begun_s is not None and script.once_by_place
        self._complete = script.when is None or has_come
        if self._complete:
            begin = begun_s if begun_s is not None and has_come else script.at_s or 0.0
            self._found.append((begin, begin + self._for_s))

    @property
    def complete(self) -> bool:
        """No further window can come."""
        return self._complete

    def until(self, now_s: float) -> list[tuple[float, float]]:
        """All windows (begin, end) that began by now, in order; the end of one that is open is infinite."""
        if not self._complete:
            stop = floor(now_s / GRID_S + 1e-9) + 1
            if stop > self._scanned:
                self._scan(np.arange(self._scanned, stop, dtype=np.float64) * GRID_S)
                self._scanned = stop
        return [window for window in self._found if window[0] <= now_s]

    def active(self, now_s: float) -> bool:
        """Whether the fault is on at this instant."""
        return any(begin <= now_s < end for begin, end in self.until(now_s))

    def _scan(self, times_s: Floats) -> None:
        assert self._condition is not None
        true = self._condition.holds(times_s, self._chamber, self._table)
        is_open = bool(self._found) and self._found[-1][1] == inf
        for at in np.flatnonzero(np.diff(true, prepend=is_open)).tolist():
            if not true[at]:
                self._found[-1] = (self._found[-1][0], float(times_s[at]))
                continue
            self._found.append((float(times_s[at]), float(times_s[at]) + self._for_s))
            if self._for_s != inf:
                self._complete = True
                self.on_begin(float(times_s[at]))
                return


def follow(
    env: simpy.Environment, windows: Times, begin: Callable[[], None], end: Callable[[], None], instant: bool
) -> Generator[simpy.Event, Any, None]:
    """A process of the world that calls `begin` and `end` where windows begin and end.

    In a world that begins later (a resumed run) what is over is over, and what happened at an instant has happened.
    """
    if windows.complete:
        ((begin_s, end_s),) = windows.until(inf)
        if end_s <= env.now or (instant and begin_s < env.now):
            return
        yield env.timeout(max(begin_s - env.now, 0.0))
        begin()
        if end_s != inf:
            yield env.timeout(end_s - env.now)
            end()
        return
    # On the same seconds as conditions are looked at, in a world that begins between two of them too.
    yield env.timeout(ceil(env.now / GRID_S) * GRID_S - env.now)
    inside = False
    while inside or not windows.complete or windows.active(env.now):
        if windows.active(env.now) != inside:
            inside = not inside
            (begin if inside else end)()
        yield env.timeout(GRID_S)
