"""What guards watch: whether each condition holds now, judged by the newest readbacks and what the DUTs sent."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from bench.benchfile import Instrument
from bench.engine import Engine
from bench.instruments import Gyro
from bench.procedure.conditions import Guard
from bench.units import format_duration
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses
from drivers.errors import DriverError, Refused

Trip = tuple[Guard, str | None, str]
Driver = TypeVar("Driver")

# A DUT is silent if nothing valid came from it for this long and for this many of its frames.
SILENT_S, SILENT_FRAMES = 2.0, 20
# The part of its window that a stream must have been watched before losses are judged.
WINDOW_SEEN = 0.5
# A readback of chamber or table that is older is taken again before it is judged.
READ_AGAIN_S = 90.0


class _NoSignal(Exception):
    """The instrument is away."""


@dataclass
class Stream:
    """What one DUT sent within a window of time."""

    over_s: float
    counts: deque[tuple[float, Losses]] = field(default_factory=deque)
    newest: FrameBatch | None = None
    value: Any = None
    same_since_s: float | None = None

    def take(self, now_s: float, gyro: Gyro, batch: FrameBatch) -> None:
        """Note the newest batch; the same one again changes nothing."""
        if batch is self.newest:
            return
        self.newest = batch
        losses = gyro.losses
        if self.counts and losses.frames < self.counts[-1][1].frames:
            self.counts.clear()  # a reader that was opened anew counts from zero
        self.counts.append((now_s, losses))
        while len(self.counts) > 1 and self.counts[1][0] <= now_s - self.over_s:
            self.counts.popleft()
        if len(batch.index):
            self._compare(now_s, batch.columns["rate"], gyro.data_rate_hz)

    def _compare(self, now_s: float, raw: Any, data_rate_hz: float) -> None:
        """Since when the raw output is what it is now."""
        last = raw[-1]
        if len(raw) > 1 and raw[-2] != last:
            self.same_since_s = now_s
        else:
            others = np.flatnonzero(raw != last)
            if len(others) or last != self.value:
                repeats = len(raw) - 2 - (others[-1] if len(others) else -1)
                self.same_since_s = now_s - repeats / data_rate_hz
        self.value = last

    def complaint(self, now_s: float, lost_ppm: float) -> str | None:
        """What is wrong with the samples of the window."""
        if self.same_since_s is not None and now_s - self.same_since_s >= self.over_s:
            return f"the output has not changed for {format_duration(now_s - self.same_since_s)}"
        if not self.counts or now_s - self.counts[0][0] < self.over_s * WINDOW_SEEN:
            return None
        seen = self.counts[-1][1] - self.counts[0][1]
        # A damaged frame is missing by its counter as well, if it has one.
        missing = max(seen.lost, seen.bad_checksum)
        bad_ppm = (missing + seen.bad_status) / max(seen.frames + missing, 1) * 1e6
        if bad_ppm <= lost_ppm:
            return None
        return f"{bad_ppm:.4g} ppm of its frames were lost or invalid, allowed are {lost_ppm:g} ppm"


class Watches:
    """The guards of a run with what they remember."""

    def __init__(self, guards: Sequence[Guard]) -> None:
        self._guards = guards
        self._streams: dict[tuple[str, str], Stream] = {}
        self._answered_s: dict[str, float] = {}

    def tripped(self, engine: Engine) -> Iterator[Trip]:
        """The guards that do not hold now."""
        for guard in self._guards:
            if guard.watch in ("dut_temperature", "sample_quality"):
                yield from self._of_duts(engine, guard)
            elif (text := self._of_bench(engine, guard)) is not None:
                yield guard, None, text

    def _of_bench(self, engine: Engine, guard: Guard) -> str | None:
        """Why a guard on chamber or table does not hold."""
        now = engine.clock.now()
        try:
            text = _CHECKS[guard.watch](engine, guard)
        except Refused as error:
            return f"no signal: {error}"
        except (DriverError, _NoSignal) as error:
            # A link that comes back is not the guard's affair.
            silent_s = now - self._answered_s.setdefault(guard.name, now)
            return f"no signal for {format_duration(silent_s)}: {error}" if silent_s > guard.lost_after_s else None
        self._answered_s[guard.name] = now
        return text

    def _of_duts(self, engine: Engine, guard: Guard) -> Iterator[Trip]:
        for name, gyro in {**engine.station.gyros, **engine.station.absent}.items():
            silent_s = engine.silent_s.get(name, 0.0)
            if silent_s > max(SILENT_S, SILENT_FRAMES / gyro.data_rate_hz):
                text: str | None = f"nothing valid was received for {format_duration(silent_s)}"
            elif guard.watch == "dut_temperature":
                text = _outside(guard, "it", engine.readbacks.dut_degc.get(name))
            else:
                text = self._samples(engine, guard, name, gyro)
            if text is not None:
                yield guard, name, f"{name}: {text}"

    def _samples(self, engine: Engine, guard: Guard, name: str, gyro: Gyro) -> str | None:
        stream = self._streams.setdefault((guard.name, name), Stream(guard.over_s))
        now = engine.clock.now()
        if name in engine.newest:
            stream.take(now, gyro, engine.newest[name])
        return stream.complaint(now, guard.lost_ppm or 0.0)


def _chamber_temperature(engine: Engine, guard: Guard) -> str | None:
    chamber, now = _there(engine.station.chamber, engine.bench.chamber, "chamber"), engine.readbacks
    if chamber is None:
        return "this bench has no chamber"
    if _stale(engine, now.chamber_s):
        now.chamber_degc, now.chamber_s = chamber.temperature_degc(), engine.clock.now()
    return _outside(guard, "the chamber", now.chamber_degc)


def _rate(engine: Engine, guard: Guard) -> str | None:
    table, now = _there(engine.station.table, engine.bench.rate_table, "rate table"), engine.readbacks
    if table is None:
        return "this bench has no rate table"
    if _stale(engine, now.rate_s):
        now.rate_dps, now.rate_s = table.rate_dps(), engine.clock.now()
    limit = guard.max_rate_dps or 0.0
    if now.rate_dps is None or abs(now.rate_dps) <= limit:
        return None
    return f"the table turns at {now.rate_dps:g} deg/s, allowed are ± {limit:g}"


def _chamber_alarm(engine: Engine, guard: Guard) -> str | None:
    chamber = _there(engine.station.chamber, engine.bench.chamber, "chamber")
    alarm = chamber.alarm() if chamber else None
    return f"the chamber reports {alarm}" if alarm else None


def _table_fault(engine: Engine, guard: Guard) -> str | None:
    table = _there(engine.station.table, engine.bench.rate_table, "rate table")
    fault = table.fault() if table else None
    return f"the rate table reports {fault}" if fault else None


def _chamber_door(engine: Engine, guard: Guard) -> str | None:
    tell = getattr(_there(engine.station.chamber, engine.bench.chamber, "chamber"), "door_open", None)
    opened = tell() if tell else None
    if opened is None:
        return "nothing tells whether the chamber's door is open: its driver cannot, or lacks the setting for it"
    return "the chamber's door is open" if opened else None


_CHECKS = {
    "chamber_temperature": _chamber_temperature,
    "rate": _rate,
    "chamber_alarm": _chamber_alarm,
    "table_fault": _table_fault,
    "chamber_door": _chamber_door,
}


def _there(driver: Driver | None, declared: Instrument | None, what: str) -> Driver | None:
    """The driver of an instrument; None if the bench has none. One that stands in for a lost instrument is false."""
    if not driver and declared is not None:
        raise _NoSignal(f"the {what} is away")
    return driver


def _stale(engine: Engine, read_s: float | None) -> bool:
    return read_s is None or engine.clock.now() - read_s > READ_AGAIN_S


def _outside(guard: Guard, what: str, degc: float | None) -> str | None:
    band = guard.inside
    if band is None or degc is None or band.from_degc <= degc <= band.to_degc:
        return None
    return f"{what} reads {degc:g} degC, allowed are {band.from_degc:g} to {band.to_degc:g} degC"
