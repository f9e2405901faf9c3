"""Where an interrupted run goes on, decided by physics: what is finished stays, what the bench forgot is done again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from bench.control import Control
from bench.engine import Engine
from bench.journal import Entry
from bench.points import finished_rows
from bench.procedure.conditions import ResumePolicy
from bench.procedure.language import GoToPosition, Power, RampTemperature, SetRate, SetTemperature, Settle, Soak
from bench.procedure.plan import PlannedStep
from bench.units import format_duration


@dataclass(frozen=True)
class Interruption:
    """What a journal says about where its run stopped.

    next_step: index in the plan of the first step that is not done. soaked_s: how long that step had lasted, if it is a
    soak. dut_degc: DUT temperatures last read. at_s: bench time of the last record. dropped: rows of an acquisition
    that was broken off.
    """

    next_step: int
    at_s: float
    soaked_s: float = 0.0
    dut_degc: Mapping[str, float] = field(default_factory=dict)
    dropped: int = 0


def interruption_of(entries: Sequence[Entry]) -> Interruption:
    """Fold a journal to where its run stopped."""
    done = max((entry["step"] for entry in entries if entry["kind"] == "done"), default=0)
    dut_degc: Mapping[str, float] = next(
        (e["dut_degc"] for e in reversed(entries) if e["kind"] == "readback" and e["dut_degc"]), {}
    )
    at_s = float(entries[-1]["t_s"])
    begun = [e for e in entries if e["kind"] == "step" and e["step"] == done + 1 and not e.get("again")]
    # Time on the bench counts towards a soak; once the bench was being made safe it does not.
    left = next((e["t_s"] for e in reversed(entries) if e["kind"] in ("interrupted", "error")), at_s)
    soaked_s = max(0.0, float(left) - float(begun[-1]["t_s"])) if begun and begun[-1]["verb"] == "soak" else 0.0
    rows = sum(entry["kind"] == "point" for entry in entries)
    return Interruption(done, at_s, soaked_s, dict(dut_degc), rows - len(finished_rows(entries)))


def reestablish(
    engine: Engine, plan: Sequence[PlannedStep], stop: Interruption, gap_s: float, policy: ResumePolicy
) -> list[PlannedStep]:
    """Bring the bench back to the conditions of the next step; what of the plan remains, its first step shortened if
    it is a soak that may go on.

    A record that was broken off begins again from its first step. The DUTs' power comes first, then the chamber's
    setpoint, then the soak unless it held over the gap, then the table's rate. On the way to a temperature the one
    before is not gone back to.
    """
    index = stop.next_step if engine.recorder.active else _beginning(plan, stop.next_step)
    before = plan[:index]
    switched = _last(before, (Power,))
    if switched is not None:
        engine.execute(before[switched], again=True)
    moving = index < len(plan) and isinstance(plan[index].args, SetTemperature | RampTemperature)
    chamber = None if moving else _last(before, (SetTemperature, RampTemperature))
    if chamber is not None:
        engine.execute(before[chamber], again=True)
    held = gap_s <= policy.gap_s and _as_warm(engine, stop.dut_degc, policy.band_k)
    soak = _last(before, (Soak,))
    if soak is not None and chamber is not None and soak > chamber and not held:
        engine.execute(before[soak], again=True)
    rate = _last(before, (SetRate, GoToPosition))
    if rate is not None:
        engine.execute(before[rate], again=True)
        settle = _last(before, (Settle,))
        if settle is not None and settle > rate:
            engine.execute(before[settle], again=True)
    rest = list(plan[index:])
    if rest and isinstance(rest[0].args, Soak) and held and stop.soaked_s > 0:
        rest[0] = _shortened(rest[0], rest[0].args, stop.soaked_s)
    return rest


def take_up(
    engine: Engine, plan: Sequence[PlannedStep], stop: Interruption, gap_s: float, policy: ResumePolicy
) -> list[PlannedStep]:
    """As `reestablish`, for a run that goes on in another process: DUTs that should be off and are not are switched off
    again, for as long as the plan has it."""
    if off_before(plan, stop.next_step) and not engine.station.off:
        switched = _last(plan[: _beginning(plan, stop.next_step)], (Power,))
        assert switched is not None
        stop = replace(stop, next_step=switched, soaked_s=0.0)
    return reestablish(engine, plan, stop, gap_s, policy)


def off_before(plan: Sequence[PlannedStep], next_step: int) -> bool:
    """Whether the DUTs are to be off when a run goes on with this step of its plan, or with the record it is in."""
    index = _beginning(plan, next_step)
    return index > 0 and plan[index - 1].off


def _beginning(plan: Sequence[PlannedStep], index: int) -> int:
    """Where the record begins that the step is inside of; the step itself outside of one."""
    inside = plan[index].record_step if index < len(plan) else None
    return index if inside is None else inside - 1


def pauser(
    control: Control, plan: Sequence[PlannedStep], policy: ResumePolicy
) -> Callable[[Engine, PlannedStep], None]:
    """What the engine calls before each step: holds there while a pause is asked for, then brings the bench back.

    A step or record under way is finished first, so a pause costs no soak and no point. The table rests, the chamber
    holds.
    """

    def hold(engine: Engine, step: PlannedStep) -> None:
        # A record is one measurement: a pause waits for its end.
        if not control.paused or step.record_step not in (None, step.number):
            return
        began_s = engine.clock.now()
        engine.log.append("paused", began_s, text=f"before step {step.number} '{step.verb}'", step=step.number)
        engine.log.commit()
        if engine.station.table:
            engine.station.table.set_rate_dps(0.0)
        looked_s = began_s
        while control.paused:
            engine.clock.idle()
            if engine.clock.now() - looked_s >= engine.watch_period_s:
                looked_s = engine.clock.now()
                engine.poll()
        gap_s = engine.clock.now() - began_s
        engine.log.append("continued", engine.clock.now(), text=f"after {format_duration(gap_s)}", step=step.number)
        stop = Interruption(step.number - 1, began_s, 0.0, dict(engine.readbacks.dut_degc))
        reestablish(engine, plan, stop, gap_s, policy)

    return hold


def _last(steps: Sequence[PlannedStep], kinds: tuple[type, ...]) -> int | None:
    return next((i for i in range(len(steps) - 1, -1, -1) if isinstance(steps[i].args, kinds)), None)


def _as_warm(engine: Engine, before_degc: Mapping[str, float], band_k: float) -> bool:
    """Whether every DUT reads what it read before; a DUT that was not read then or is not now has not held."""
    now_degc = engine.poll().dut_degc
    return bool(before_degc) and all(
        dut in now_degc and abs(now_degc[dut] - degc) <= band_k for dut, degc in before_degc.items()
    )


def _shortened(step: PlannedStep, soak: Soak, soaked_s: float) -> PlannedStep:
    remaining = max(1.0, soak.for_s - soaked_s)
    return replace(step, args=soak.model_copy(update={"for_s": remaining}))
