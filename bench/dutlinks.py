"""DUTs whose port goes or that fall silent: left out so that the others are measured, tried again, taken back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from bench.bench_entries import Links
from bench.benchfile import Bench
from bench.engine import Engine
from bench.instruments import Gyro
from bench.journal import Entry
from bench.opening import LISTENING_PERIOD_S, LISTENING_PERIODS, open_instrument
from bench.procedure.plan import PlannedStep
from bench.station import Station
from bench.units import format_duration
from drivers.codecs.batch import FrameBatch, Meaning
from drivers.codecs.counters import Losses
from drivers.errors import DriverError, PortError

# Opening a dead TCP port takes seconds, which the others wait: at most this part of the time goes to trying.
TRYING_SHARE = 0.05
# Frames that must be missing before a slow stream is called silent.
SILENT_FRAMES = 20


class DutLink:
    """A DUT over a port that may go and come back. While it is away nothing is received, and nothing is raised.

    Losses and frame numbers go on over a change of port: frames missed in between are counted as lost.
    """

    def __init__(self, data_rate_hz: float, gyro: Gyro | None, now: Callable[[], float], why: str = "") -> None:
        self.data_rate_hz = data_rate_hz
        self.why = why
        self._gyro, self._known, self._now = gyro, gyro, now
        self._past = Losses()
        # Number and time of the newest frame, and what is added to the numbers of the present driver.
        self._newest: tuple[int, float] | None = None
        self._shift: int | None = 0

    @property
    def connected(self) -> bool:
        """Whether its port is open, as far as is known."""
        return self._gyro is not None

    @property
    def losses(self) -> Losses:
        """Everything counted since the run began."""
        return self._past + self._gyro.losses if self._gyro else self._past

    @property
    def meaning(self) -> Meaning:
        """See the driver; that of its last port while it is away."""
        assert self._known is not None
        return self._known.meaning

    def describe(self) -> str:
        """See the driver; that of its last port while it is away."""
        return self._known.describe() if self._known else "never heard"

    def complaint(self) -> str | None:
        """See the driver."""
        return self._gyro.complaint() if self._gyro else self.why

    def take(self) -> FrameBatch:
        """Everything received since the last call; nothing while it is away."""
        try:
            return self._numbered(self._gyro.take()) if self._gyro else FrameBatch.empty()
        except PortError as error:
            self.leave(str(error))
            return FrameBatch.empty()

    def discard(self) -> None:
        """Throw away everything received so far; frame numbers begin anew."""
        self._newest, self._shift = None, 0
        try:
            if self._gyro:
                self._gyro.discard()
        except PortError as error:
            self.leave(str(error))

    def leave(self, why: str) -> None:
        """Its port is gone."""
        self._past, self._gyro, self._shift, self.why = self.losses, None, None, why

    def join(self, gyro: Gyro) -> None:
        """It has a port again. Raises PortError."""
        gyro.discard()
        self._gyro = self._known = gyro
        self.why = ""

    def _numbered(self, batch: FrameBatch) -> FrameBatch:
        if not len(batch):
            return batch
        now = self._now()
        if self._shift is None:
            self._shift = self._over_the_gap(batch, now)
        shifted = replace(batch, index=batch.index + self._shift) if self._shift else batch
        self._newest = int(shifted.index[-1]), now
        return shifted

    def _over_the_gap(self, batch: FrameBatch, now: float) -> int:
        """What makes the numbers of a new driver go on where the last one's ended, by the time that passed."""
        if self._newest is None:
            return 0
        number, heard_s = self._newest
        by_time = number + round((now - heard_s) * self.data_rate_hz) - int(batch.index[-1])
        shift = max(by_time, number + 1 - int(batch.index[0]))
        self._past += Losses(lost=int(batch.index[0]) + shift - number - 1)
        return shift


@dataclass
class _Away:
    """A DUT that is left out: since when, what was tried, and since when it is listened to again."""

    since_s: float
    next_s: float
    tries: int = 0
    listening_s: float | None = None


@dataclass
class DutLinks:
    """The links of all DUTs of a run.

    The engine calls `tend` at every poll, never during an acquisition, and `before_step` before every step.
    """

    bench: Bench
    station: Station
    settings: Links
    links: dict[str, DutLink] = field(default_factory=dict)
    _away: dict[str, _Away] = field(default_factory=dict)
    _then: Callable[[Engine, PlannedStep], None] = lambda engine, step: None

    def attach(self, engine: Engine, before_step: Callable[[Engine, PlannedStep], None]) -> None:
        """Put a link under every DUT of the station; those that were not heard when it was opened are away.

        `before_step` is called after these links were looked after.
        """
        station, now = self.station, engine.clock.now
        for among in (station.gyros, station.off):
            for name, gyro in among.items():
                self.links[name] = among[name] = DutLink(gyro.data_rate_hz, gyro, now)
        for name, why in station.unheard.items():
            rate_hz = self.bench.duts[name].settings.data_rate_hz
            self.links[name] = station.absent[name] = DutLink(rate_hz, None, now, why)
            self._leave_out(engine, name, why)
        engine.tend_links, self._then = self.tend, before_step
        engine.before_step = self.before_step

    def losses(self) -> Mapping[str, Losses]:
        """Losses of every DUT over all its ports, those that were dropped included."""
        return {name: link.losses for name, link in self.links.items()}

    def before_step(self, engine: Engine, step: PlannedStep) -> None:
        """Look after the links; wait if no DUT is left, unless some are only off.

        Raises BenchFailure when that was for too long.
        """
        self.tend(engine)
        began_s = engine.clock.now()
        while not (self.station.gyros or self.station.off):
            if engine.clock.now() - began_s >= self.settings.patience_s:
                why = "; ".join(f"{name}: {self.links[name].why or 'silent'}" for name in self.station.absent)
                raise engine.fail(step, f"no DUT was heard for {format_duration(self.settings.patience_s)}: {why}")
            engine.clock.wait(min(self.settings.longest_wait_s, self.settings.patience_s))
            engine.poll()
        self._then(engine, step)

    def tend(self, engine: Engine) -> None:
        """Leave out the DUTs whose port is gone or that were silent for too long; try those that are left out."""
        for name in list(self.station.gyros):
            if why := self._trouble(engine, name):
                self.station.absent[name] = self.station.gyros.pop(name)
                engine.readbacks.dut_degc.pop(name, None)
                engine.history.pop(name, None)
                self._leave_out(engine, name, why)
        for name, away in list(self._away.items()):
            if name not in self.station.absent:  # a guard has dropped it for good
                self.station.shut(name)
                del self._away[name]
                continue
            now = engine.clock.now()
            engine.silent_s[name] = now - engine.heard_s.setdefault(name, away.since_s)
            self._try(engine, name, away, now)

    def _trouble(self, engine: Engine, name: str) -> str | None:
        link = self.links[name]
        if not link.connected:
            return link.why
        silent_s = engine.silent_s.get(name, 0.0)
        if silent_s >= max(self.settings.silent_after_s, SILENT_FRAMES / link.data_rate_hz):
            return f"{link.describe()}: {link.complaint() or 'nothing valid was received'}"
        return None

    def _leave_out(self, engine: Engine, name: str, why: str) -> None:
        now = engine.clock.now()
        if not self.links[name].connected:
            self.station.shut(name)
        self._away[name] = _Away(now, now + self.settings.first_wait_s)
        engine.log.append("link", now, instrument=name, state="lost", text=f"left out: {why}")
        engine.log.commit()

    def _try(self, engine: Engine, name: str, away: _Away, now: float) -> None:
        """Listen if there is a port; open it again if there is none, or if nothing was heard for long enough."""
        link = self.links[name]
        frames = len(link.take())
        if frames and away.listening_s is None:
            # From here on it is listened to for long enough to know its pace.
            link.discard()
            away.listening_s = now
        elif frames and now - (away.listening_s or now) >= LISTENING_PERIODS * LISTENING_PERIOD_S:
            if link.complaint() is None:
                self._take_back(engine, name, away)
                return
            away.listening_s = None
        if now >= away.next_s and not frames:
            self._open(engine, name, away, now)

    def _open(self, engine: Engine, name: str, away: _Away, now: float) -> None:
        link, settings = self.links[name], self.settings
        away.tries += 1
        wait_s = min(settings.first_wait_s * 2.0 ** min(away.tries, 30), settings.longest_wait_s)
        # Long enough to hear something before it is opened once more.
        wait_s = max(wait_s, 2 * LISTENING_PERIODS * LISTENING_PERIOD_S)
        away.listening_s = None
        if link.connected:
            link.leave("nothing valid was received")
        self.station.shut(name)
        try:
            gyro, self.station.closers[name] = open_instrument(self.bench.duts[name], engine.clock)
            link.join(gyro)
            away.listening_s = now
        except DriverError as error:
            link.why = str(error)
            self.station.shut(name)
        tried_s = engine.clock.now() - now
        away.next_s = now + max(wait_s, tried_s / TRYING_SHARE)

    def _take_back(self, engine: Engine, name: str, away: _Away) -> None:
        """It sends again: from the next acquisition on it is measured."""
        now, station = engine.clock.now(), self.station
        here = {**station.gyros, name: station.absent.pop(name)}
        station.gyros.clear()
        station.gyros.update({dut: here[dut] for dut in self.bench.duts if dut in here})
        del self._away[name]
        engine.heard_s[name], engine.silent_s[name] = now, 0.0
        text = f"{self.links[name].describe()}: heard again after {format_duration(now - away.since_s)}"
        engine.log.append("link", now, instrument=name, state="restored", text=text)
        engine.log.commit()


def left_out(entries: Sequence[Entry]) -> set[str]:
    """The DUTs that were lost or dropped when a journal ends: those that a resume need not find."""
    away: set[str] = set()
    for entry in entries:
        if entry["kind"] == "dropped":
            away.add(entry["dut"])
        elif entry["kind"] == "link" and entry["state"] == "lost":
            away.add(entry["instrument"])
        elif entry["kind"] == "link":
            away.discard(entry["instrument"])
        elif entry["kind"] == "identities":
            away -= entry["found"].keys()
    return away
