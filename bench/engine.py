"""The engine: runs a plan step by step on a station, on one clock, and logs what it did."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from bench.benchfile import Bench
from bench.clock import Clock
from bench.errors import BenchFailure, FogbenchError
from bench.instruments import Gyro
from bench.journal import Log
from bench.procedure.conditions import Guard
from bench.procedure.plan import PlannedStep
from bench.reduction import slope
from bench.station import Station
from drivers.codecs.batch import FrameBatch
from drivers.errors import BadReply, DriverError, NoReply, PortError

# How often readbacks are taken while waiting. Every frame received in between is decoded, so this is also the largest
# block but one that a reader buffer has to hold.
WATCH_PERIOD_S = 30.0
REHEARSED_WATCH_PERIOD_S = 120.0
# DUT temperatures kept for the slope condition of a soak.
HISTORY_S = 4 * 3600.0
# What a link does that may get well by itself; an instrument that refuses has understood.
LINK_ERRORS = (NoReply, BadReply, PortError)


@dataclass
class Readbacks:
    """The newest readback of everything; None where nothing was read yet.

    chamber_s, rate_s: when chamber temperature and table rate were last read.
    """

    t_s: float = 0.0
    chamber_setpoint_degc: float | None = None
    chamber_degc: float | None = None
    rate_setpoint_dps: float | None = None
    rate_dps: float | None = None
    dut_degc: dict[str, float] = field(default_factory=dict)
    chamber_s: float | None = None
    rate_s: float | None = None


@dataclass(frozen=True)
class Progress:
    """What a listener is told after each step and each readback."""

    step: PlannedStep
    steps: int
    finished: bool
    t_s: float
    readbacks: Readbacks


Listener = Callable[[Progress], None]


class Tripped(FogbenchError):
    """Guards do not hold; `trips` are (guard, DUT or None, what was read), the most severe action first."""

    def __init__(self, trips: Sequence[tuple[Guard, str | None, str]]) -> None:
        severity = {"abort": 0, "hold": 1, "drop": 2}
        self.trips = sorted(trips, key=lambda trip: severity[trip[0].action])
        super().__init__("; ".join(f"guard '{guard.name}': {text}" for guard, _, text in self.trips))


class LinkLost(BenchFailure):
    """Chamber or table did not answer, or not sensibly, in a step."""


# What may be overcome: see `recovery`.
TROUBLE = (Tripped, LinkLost, *LINK_ERRORS)


class Acquirer(Protocol):
    """How the acquire verb is carried out: for a record, or for a rehearsal that only lets the time pass."""

    def acquire(self, engine: Engine, step: PlannedStep) -> None:
        """Carry out one acquire step."""
        ...


class Recorder(Protocol):
    """How the record verb is carried out; `SilentRecorder` is that of a rehearsal."""

    @property
    def active(self) -> bool:
        """Whether a record is under way."""
        ...

    def begin(self, engine: Engine, step: PlannedStep) -> None:
        """Listen from now on."""
        ...

    def heard(self, dut: str, batch: FrameBatch) -> None:
        """Add what a DUT sent."""
        ...

    def disturbed(self, why: str) -> None:
        """Note what happened to the bench meanwhile."""
        ...

    def end(self, engine: Engine) -> None:
        """Finish the record, durably."""
        ...


class SilentRecorder:
    """Records nothing."""

    active = False

    def begin(self, engine: Engine, step: PlannedStep) -> None:
        """The steps run as they would."""

    def heard(self, dut: str, batch: FrameBatch) -> None:
        """Not kept."""

    def disturbed(self, why: str) -> None:
        """Not kept."""

    def end(self, engine: Engine) -> None:
        """Nothing to finish."""


@dataclass
class Engine:
    """The state of one execution of a plan. Steps are functions of it: `steps` has one for each verb."""

    steps: Mapping[str, Callable[[Engine, PlannedStep], None]]
    bench: Bench
    station: Station
    clock: Clock
    log: Log
    acquirer: Acquirer
    listener: Listener = lambda progress: None
    watch_period_s: float = WATCH_PERIOD_S
    before_step: Callable[[Engine, PlannedStep], None] = lambda engine, step: None
    check_guards: Callable[[Engine], None] = lambda engine: None
    recover: Callable[[Engine, PlannedStep, Exception], PlannedStep] | None = None
    tend_links: Callable[[Engine], None] = lambda engine: None
    recorder: Recorder = field(default_factory=SilentRecorder)
    readbacks: Readbacks = field(default_factory=Readbacks)
    history: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)
    heard_s: dict[str, float] = field(default_factory=dict)
    silent_s: dict[str, float] = field(default_factory=dict)
    newest: dict[str, FrameBatch] = field(default_factory=dict)
    begun: tuple[int, float] = (0, 0.0)
    _step: PlannedStep | None = None
    _steps: int = 0

    def run(self, plan: Sequence[PlannedStep]) -> None:
        """Run every step. Raises BenchFailure with the step's place if an instrument or a deadline fails."""
        self._steps = len(plan)
        for step in plan:
            todo: PlannedStep | None = step
            while todo is not None:
                todo = self._carried_out(todo)
            self.log.append("done", self.clock.now(), step=step.number)
            self._tell(finished=True)
        self.log.commit()

    def _carried_out(self, step: PlannedStep) -> PlannedStep | None:
        """Carry out a step; None once it is done, else what is left of it, with the bench ready for that."""
        try:
            self.before_step(self, step)
            self.execute(step)
            return None
        except TROUBLE as error:
            if self.recover is None:
                if isinstance(error, LINK_ERRORS):
                    raise self.lost(step, error) from error
                raise
            trouble = error
        return self.recover(self, step, trouble)

    def execute(self, step: PlannedStep, again: bool = False) -> None:
        """Carry out one step; `again` if it was done before and only brings the bench back to where it was."""
        self._step = step
        if not again:
            self.begun = step.number, self.clock.now()
        repeated = {"again": True} if again else {}
        self.log.append("step", self.clock.now(), step=step.number, verb=step.verb, at=str(step.mark), **repeated)
        self.log.commit()
        try:
            self.check_guards(self)
            self.steps[step.verb](self, step)
        except LINK_ERRORS as error:
            raise self.lost(step, error) from error
        except DriverError as error:
            raise self.fail(step, str(error)) from error

    def _tell(self, finished: bool) -> None:
        if self._step is not None:
            self.listener(Progress(self._step, self._steps, finished, self.clock.now(), self.readbacks))

    def watch(self, seconds: float) -> None:
        """Wait, taking readbacks on the way."""
        end = self.clock.now() + seconds
        while (left := end - self.clock.now()) > 1e-9:
            self.clock.wait(min(left, self.watch_period_s))
            self.poll()

    def poll(self) -> Readbacks:
        """Take a readback of everything and listen to the DUTs, those that were lost included."""
        self.tend_links(self)
        for name, gyro in self.station.gyros.items():
            self.heard(name, gyro, gyro.take())
        return self.read_instruments()

    def heard(self, name: str, gyro: Gyro, batch: FrameBatch) -> None:
        """Note the DUT temperature of a batch: the mean of its newest second; and for how long there was none."""
        now = self.clock.now()
        self.recorder.heard(name, batch)
        self.newest[name] = batch
        if len(batch.index):
            newest = max(1, round(gyro.data_rate_hz))
            degc = float(np.mean(batch.temperature_degc[-newest:]))
            self.readbacks.dut_degc[name] = degc
            self.heard_s[name] = now
            kept = self.history.setdefault(name, deque())
            kept.append((now, degc))
            while kept[0][0] < now - HISTORY_S:
                kept.popleft()
        self.silent_s[name] = now - self.heard_s.setdefault(name, now)

    def read_instruments(self) -> Readbacks:
        """Read chamber and table, log the readbacks."""
        now = self.clock.now()
        current = self.readbacks
        current.t_s = now
        fields: dict[str, Any] = {"dut_degc": {k: round(v, 4) for k, v in current.dut_degc.items()}}
        if self.station.chamber:
            current.chamber_degc, current.chamber_s = self.station.chamber.temperature_degc(), now
            fields |= {"chamber_setpoint_degc": current.chamber_setpoint_degc, "chamber_degc": current.chamber_degc}
        if self.station.table:
            current.rate_dps, current.rate_s = self.station.table.rate_dps(), now
            fields |= {"rate_setpoint_dps": current.rate_setpoint_dps, "rate_dps": current.rate_dps}
        self.log.append("readback", now, **fields)
        self._tell(finished=False)
        self.check_guards(self)
        return current

    def dut_slopes(self, over_s: float) -> dict[str, float] | None:
        """Each DUT's temperature slope (degC/min) over the last `over_s`; None until that much has been seen of all."""
        since = self.clock.now() - over_s
        slopes: dict[str, float] = {}
        for name in self.station.gyros:
            seen = np.array([pair for pair in self.history.get(name, ()) if pair[0] >= since - self.watch_period_s])
            if len(seen) < 3 or seen[-1, 0] - seen[0, 0] < over_s * 0.9:
                return None
            slopes[name] = slope(seen[:, 0] / 60.0, seen[:, 1])
        return slopes

    def fail(self, step: PlannedStep, message: str) -> BenchFailure:
        """The error for a step whose condition was not met."""
        return BenchFailure(f"step {step.number} '{step.verb}' ({step.mark}): {message}")

    def lost(self, step: PlannedStep, error: DriverError) -> LinkLost:
        """The error for a step in which an instrument did not answer."""
        return LinkLost(str(self.fail(step, str(error))))
