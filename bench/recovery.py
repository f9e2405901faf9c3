"""Going on after trouble: guards that tripped and links that broke are seen to, then the bench is brought back.

The same for a step that was broken off and for a run that is taken up again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from bench.engine import LINK_ERRORS, TROUBLE, Engine, LinkLost, Tripped
from bench.guards import Holds
from bench.links import CommandedLinks
from bench.procedure.conditions import ResumePolicy
from bench.procedure.plan import PlannedStep
from bench.resumption import Interruption, reestablish, take_up
from bench.station import energise

Done = TypeVar("Done")


@dataclass
class Recovery:
    """What overcomes the trouble of one run; `plan` and `policy` say where the bench is brought back to."""

    plan: Sequence[PlannedStep]
    policy: ResumePolicy
    links: CommandedLinks
    holds: Holds = field(default_factory=Holds)

    def recover(self, engine: Engine, step: PlannedStep, trouble: Exception) -> PlannedStep:
        """What the engine calls when a step was broken off: what is left of it, with the bench ready for that.

        Raises BenchFailure if nothing mends the trouble.
        """
        began_s, before_degc = engine.clock.now(), dict(engine.readbacks.dut_degc)
        begun, since_s = engine.begun
        soaked_s = began_s - since_s if begun == step.number else 0.0
        # What the step has lasted is counted once.
        engine.begun = 0, began_s
        plan = [*self.plan]
        plan[step.number - 1] = step

        def back() -> PlannedStep:
            # A DUT that was lost or dropped meanwhile is not asked whether it stayed as warm.
            warm = {name: degc for name, degc in before_degc.items() if name in engine.station.gyros}
            stop = Interruption(step.number - 1, began_s, soaked_s, warm)
            return reestablish(engine, plan, stop, engine.clock.now() - began_s, self.policy)[0]

        return self._overcome(engine, step, trouble, back)

    def take_up(self, engine: Engine, stop: Interruption, gap_s: float) -> list[PlannedStep]:
        """Bring the bench back to where a run stopped, `gap_s` ago; the steps that are left."""
        began_s = engine.clock.now()

        def back() -> list[PlannedStep]:
            return take_up(engine, self.plan, stop, gap_s + engine.clock.now() - began_s, self.policy)

        return self._until_done(engine, self.plan[min(stop.next_step, len(self.plan) - 1)], back)

    def energise(self, engine: Engine) -> None:
        """Take the table under power, before the first step."""
        self._until_done(engine, self.plan[0], lambda: energise(engine.station, engine.clock))

    def _until_done(self, engine: Engine, step: PlannedStep, back: Callable[[], Done]) -> Done:
        try:
            return back()
        except TROUBLE as error:
            trouble = error
        return self._overcome(engine, step, trouble, back)

    def _overcome(self, engine: Engine, step: PlannedStep, trouble: Exception, back: Callable[[], Done]) -> Done:
        """See to the trouble, and to what comes of bringing the bench back, until that worked."""
        while True:
            engine.recorder.disturbed(str(trouble))
            try:
                self._see_to(engine, step, trouble)
                return back()
            except TROUBLE as again:
                trouble = again

    def _see_to(self, engine: Engine, step: PlannedStep, trouble: Exception) -> None:
        if isinstance(trouble, Tripped):
            self.holds.see_to(engine, step, trouble)
        elif isinstance(trouble, LinkLost):
            self.links.see_to(engine, step, trouble)
        else:
            assert isinstance(trouble, LINK_ERRORS)
            self.links.see_to(engine, step, engine.lost(step, trouble))
