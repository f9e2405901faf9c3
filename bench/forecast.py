"""The forecast: the whole plan rehearsed by engine and drivers in virtual time against simulators.

Its step ends give the duration and the ETA of the run; what goes wrong in it would have gone wrong on the bench.
"""

from __future__ import annotations

from dataclasses import dataclass

from bench.acquire import RehearsedAcquirer
from bench.check import Checked
from bench.composition import open_rehearsal
from bench.engine import REHEARSED_WATCH_PERIOD_S, Engine, Progress
from bench.errors import FogbenchError
from bench.journal import Entry, MemoryLog
from bench.station import energise
from bench.steps import STEPS
from drivers.errors import DriverError


@dataclass(frozen=True)
class Forecast:
    """When each step of the plan ended in rehearsal, and how the rehearsal ended."""

    ends_s: tuple[float, ...]
    entries: tuple[Entry, ...]
    failure: str | None

    @property
    def duration_s(self) -> float:
        """Bench time of everything that was rehearsed, a step that failed included."""
        return float(self.entries[-1]["t_s"]) if self.entries else 0.0

    @property
    def warnings(self) -> list[str]:
        """What the rehearsal warned of."""
        return [entry["text"] for entry in self.entries if entry["kind"] == "warning"]

    def remaining_s(self, step: int, since_s: float) -> float:
        """Bench time left when step `step` (from 1) has been under way for `since_s`."""
        if not self.ends_s:
            return 0.0
        index = min(step, len(self.ends_s)) - 1
        began = self.ends_s[index - 1] if index else 0.0
        return self.duration_s - min(began + since_s, self.ends_s[index])


def rehearse(checked: Checked, seed: int) -> Forecast:
    """Run the plan in virtual time against simulators of this bench; no hardware, no fit, no record."""
    log = MemoryLog()
    ends: list[float] = []

    def listen(progress: Progress) -> None:
        if progress.finished:
            ends.append(progress.t_s)

    failure = None
    try:
        with open_rehearsal(checked.bench, seed) as (station, clock):
            energise(station, clock)
            engine = Engine(
                STEPS, checked.bench, station, clock, log, RehearsedAcquirer(), listen, REHEARSED_WATCH_PERIOD_S
            )
            engine.run(checked.plan)
    except (FogbenchError, DriverError) as error:
        failure = str(error)
    return Forecast(tuple(ends), tuple(log.entries), failure)
