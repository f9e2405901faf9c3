"""Chamber, table, supply that stop answering: the bench waits at rest, links are tried again, the step is done again.

A question may be asked again at any time; a command that was under way may have been half done, so it is never simply
repeated: the setpoints are re-established and the broken-off step begins anew. The instrument may have been off.
"""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from bench.benchfile import Bench, Instrument
from bench.engine import LINK_ERRORS, Engine, LinkLost, Tripped
from bench.errors import BenchFailure
from bench.instruments import RateTable
from bench.opening import open_known, recognise
from bench.procedure.plan import PlannedStep
from bench.station import energise
from bench.units import format_duration
from drivers.errors import DriverError, Refused

# A step that was broken off this often fails in a way that trying again does not mend.
MOST_BREAKS = 10
# The table is taken for standing below this.
AT_REST_DPS = 0.05
LOOK_S = 0.25


class Silent:
    """Stands in for an instrument that does not answer: nobody reads it, and a guard that asks it hears nothing."""

    def __init__(self, why: str) -> None:
        self._why = why

    def __bool__(self) -> bool:
        return False

    def __getattr__(self, name: str) -> Any:
        raise DriverError(self._why)


@dataclass
class CommandedLinks:
    """What is done when chamber, table or supply did not answer in a step."""

    bench: Bench
    _breaks: Counter[int] = field(default_factory=Counter)

    def see_to(self, engine: Engine, step: PlannedStep, lost: LinkLost) -> None:
        """Get the lost instruments back, at rest and under power.

        Raises BenchFailure if that takes longer than the patience of the bench file, or if another instrument answers;
        Tripped if a guard wants to end the run meanwhile.
        """
        self._breaks[step.number] += 1
        if self._breaks[step.number] > MOST_BREAKS:
            raise BenchFailure(f"{lost} (given up after {MOST_BREAKS} tries)")
        back = _Search(self.bench, engine, step, lost).run(self._breaks[step.number])
        if self.bench.rate_table in back and engine.station.table:
            _take_up(engine, self.bench.rate_table, engine.station.table)


@dataclass
class _Search:
    """One time of looking for the instruments that do not answer, the others resting."""

    bench: Bench
    engine: Engine
    step: PlannedStep
    lost: LinkLost
    away: dict[str, Any] = field(default_factory=dict)
    why: str = ""

    def run(self, times: int) -> list[Instrument]:
        """Returns the instruments that were lost and answer again; `times` counts the losses in this step."""
        engine, settings = self.engine, self.bench.file.links
        began_s = engine.clock.now()
        engine.log.append("warning", began_s, step=self.step.number, text=str(self.lost))
        try:
            self._ask_all()
            gone = list(self.away)
            wait_s = min(settings.first_wait_s * 2.0 ** (times - 1), settings.longest_wait_s)
            while True:
                engine.clock.wait(wait_s)
                self._listen()
                gone += [name for name in self.away if name not in gone]
                for name in list(self.away):
                    self._try(name, began_s)
                if not self.away:
                    return [item for item in self._instruments() if item.name in gone]
                if engine.clock.now() - began_s >= settings.patience_s:
                    spent = format_duration(engine.clock.now() - began_s)
                    raise BenchFailure(f"{self.lost}; tried again for {spent}, at last: {self.why}")
                wait_s = min(2.0 * wait_s, settings.longest_wait_s)
        finally:
            # Whoever makes the bench safe must not take a lost instrument for one that is not there.
            for name, driver in self.away.items():
                engine.station.put(self._named(name).role, driver)

    def _instruments(self) -> list[Instrument]:
        return [item for item in (self.bench.rate_table, self.bench.chamber, self.bench.supply) if item]

    def _named(self, name: str) -> Instrument:
        return next(item for item in self._instruments() if item.name == name)

    def _ask_all(self) -> None:
        """Ask everybody; who does not answer is taken out. The table, if it answers, is brought to rest."""
        for item in self._instruments():
            driver = self.engine.station.commanded(item.role)
            if not driver:
                continue
            try:
                recognise(self.engine.station, item, driver)
                if item.role == "rate_table":
                    # One that is not under power refuses, and need not be brought to rest.
                    with suppress(Refused):
                        driver.set_rate_dps(0.0)
            except LINK_ERRORS as error:
                self._take_out(item, driver, str(error))
            except BenchFailure as another:
                raise self._exchanged(another) from another

    def _take_out(self, item: Instrument, driver: Any, why: str) -> None:
        engine = self.engine
        self.away[item.name], self.why = driver, why
        engine.station.put(item.role, Silent(why))
        engine.log.append("link", engine.clock.now(), instrument=item.name, state="lost", text=f"lost: {why}")
        engine.log.commit()

    def _listen(self) -> None:
        """Go on reading the others and guarding them; a guard that holds is content, for the bench is held."""
        engine = self.engine
        try:
            engine.poll()
        except LINK_ERRORS:
            self._ask_all()
        except Tripped as trip:
            if trip.trips[0][0].action != "hold":
                raise

    def _try(self, name: str, began_s: float) -> None:
        """Open the port anew and ask who is there."""
        engine, item = self.engine, self._named(name)
        try:
            open_known(engine.station, item, engine.clock)
        except LINK_ERRORS as error:
            self.why = str(error)
            return
        except BenchFailure as another:
            raise self._exchanged(another) from another
        del self.away[name]
        text = (
            f"'{engine.station.identities[name]}' answers again after {format_duration(engine.clock.now() - began_s)}"
        )
        engine.log.append("link", engine.clock.now(), instrument=name, state="restored", text=text)
        engine.log.commit()

    def _exchanged(self, another: BenchFailure) -> BenchFailure:
        return self.engine.fail(self.step, f"{another} Then go on with: fogbench resume.")


def _take_up(engine: Engine, item: Instrument, table: RateTable) -> None:
    """Bring a table that answers again to rest and under power: it may have turned on, or have been off meanwhile."""
    if fault := table.fault():
        raise BenchFailure(f"{item.where} answers again and reports: {fault}. Look at the table before it is moved.")
    table.stop()
    engine.readbacks.rate_setpoint_dps = 0.0
    began_s, timeout_s = engine.clock.now(), engine.bench.file.rate_table.safe.timeout_s  # type: ignore[union-attr]
    while abs(rate := table.rate_dps()) > AT_REST_DPS:
        if engine.clock.now() - began_s > timeout_s:
            raise BenchFailure(f"{item.where} answers again and does not stop: {rate:g} deg/s. Use the E-stop.")
        engine.clock.wait(LOOK_S)
    energise(engine.station, engine.clock)
