"""What a finished run still lacks, and the part of its plan that measures exactly that."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from bench.engine import Engine
from bench.journal import Entry
from bench.points import finished_rows
from bench.procedure.language import (
    Acquire,
    EndRecord,
    GoToPosition,
    Note,
    Power,
    RampTemperature,
    Record,
    SetRate,
    SetTemperature,
    Settle,
)
from bench.procedure.plan import PlannedStep
from bench.replacement import left_to_measure, ranges
from bench.series import finished_series

Action = Callable[[Engine, PlannedStep], None]


@dataclass(frozen=True)
class Missing:
    """Points and records (by the number of the step that begins them) that are to be made, each with its DUTs."""

    points: Mapping[int, Collection[str]] = field(default_factory=dict)
    records: Mapping[int, Collection[str]] = field(default_factory=dict)

    @property
    def duts(self) -> set[str]:
        """All DUTs that lack something."""
        return {dut for duts in (*self.points.values(), *self.records.values()) for dut in duts}

    @property
    def text(self) -> str:
        """In words, for the journal: 'FOG-A01: points 3, 12-28'."""
        parts = []
        for dut in sorted(self.duts):
            points = ranges(sorted(point for point, duts in self.points.items() if dut in duts))
            records = sum(dut in duts for duts in self.records.values())
            whats = [f"points {points}"] * bool(points) + [f"{records} records"] * bool(records)
            parts.append(f"{dut}: {', '.join(whats)}")
        return "; ".join(parts) or "nothing"


def missing_of(entries: Sequence[Entry], plan: Sequence[PlannedStep]) -> Missing:
    """What the journal of a run lacks of its plan: not measured, or failed."""
    duts = list(entries[0]["duts"])
    points: dict[int, set[str]] = {}
    planned = sum(step.point is not None for step in plan)
    for dut, left in left_to_measure(finished_rows(entries), duts, planned).items():
        for point in (*left["not_measured"], *left["failed"]):
            points.setdefault(point, set()).add(dut)
    good = {(one["record"], one["dut"]) for one in finished_series(entries) if one["verdict"] != "fail"}
    begins = [step.number for step in plan if isinstance(step.args, Record)]
    records = {number: {dut for dut in duts if (number, dut) not in good} for number in begins}
    return Missing(points, {number: duts for number, duts in records.items() if duts})


def steps_for(plan: Sequence[PlannedStep], missing: Missing) -> list[PlannedStep]:
    """The steps that make what is missing under the conditions of the whole plan, with the numbers they have there.

    Of a temperature with nothing missing no step is left. Of the others those are: the move, with the table and the
    DUTs' power as they were before it; every soak and dwell; the motion right before a point, with its settling.
    """
    kept: list[PlannedStep] = []
    pending: list[PlannedStep] = []
    motion: PlannedStep | None = None
    power: PlannedStep | None = None
    for step in plan:
        args = step.args
        if isinstance(args, SetTemperature | RampTemperature) and step.record_step not in missing.records:
            pending = [*(before for before in (motion, power) if before), step]
        elif step.record_step in missing.records or step.point in missing.points:
            kept += [*pending, step]
            pending = []
        elif isinstance(args, SetRate | GoToPosition):
            pending = [*_without_motion(pending), step]
        elif not isinstance(args, Acquire | Record | EndRecord | Note):
            pending.append(step)
        if isinstance(args, SetRate | GoToPosition):
            motion = step
        elif isinstance(args, Power):
            power = step
    return kept


def _without_motion(pending: list[PlannedStep]) -> list[PlannedStep]:
    """Steps of which a later motion leaves nothing, taken out; what was before the temperature stays."""
    moves = [i for i, step in enumerate(pending) if isinstance(step.args, SetTemperature | RampTemperature)]
    first = moves[-1] + 1 if moves else 0
    later = [step for step in pending[first:] if not isinstance(step.args, SetRate | GoToPosition | Settle)]
    return pending[:first] + later


def only_missing(steps: Mapping[str, Action], missing: Missing) -> dict[str, Action]:
    """The verbs, with those that measure doing so only for the DUTs that lack this point or record."""

    def acquire(engine: Engine, step: PlannedStep) -> None:
        wanted = missing.points.get(step.point or 0, ())
        if not _among(engine, wanted, lambda: steps["acquire"](engine, step)) and step.record_step is not None:
            # The record around it lasts as long as it would.
            engine.watch(cast(Acquire, step.args).duration_s)

    def record(engine: Engine, step: PlannedStep) -> None:
        _among(engine, missing.records.get(step.number, ()), lambda: steps["record"](engine, step))

    return {**steps, "acquire": acquire, "record": record}


def _among(engine: Engine, wanted: Collection[str], measure: Callable[[], None]) -> bool:
    """Measure with no other DUTs than these; whether there was one."""
    station = engine.station
    everybody, off = station.gyros, station.off
    mine = {dut: gyro for dut, gyro in everybody.items() if dut in wanted}
    # A record may begin while its DUTs are off.
    mine_off = {dut: gyro for dut, gyro in off.items() if dut in wanted}
    if not mine and not mine_off:
        return False
    station.gyros, station.off = dict(mine), mine_off
    try:
        measure()
    finally:
        station.off = off
        # Without those that were dropped or lost meanwhile.
        gone = mine.keys() - station.gyros.keys()
        station.gyros = {dut: gyro for dut, gyro in {**everybody, **station.gyros}.items() if dut not in gone}
    return True
