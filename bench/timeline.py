"""A plan and its rehearsed times as a timeline a person can read: one phase per stretch of one kind of step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from bench.procedure.plan import PlannedStep
from bench.units import format_duration

_KINDS = {"set_temperature": "ramp", "ramp_temperature": "ramp", "soak": "soak", "dwell": "dwell", "note": "note"}


@dataclass(frozen=True)
class Phase:
    """Consecutive steps of one kind at one chamber setpoint."""

    began_s: float
    ended_s: float
    temperature_degc: float | None
    kind: str
    points: int

    def row(self) -> list[str]:
        """Cells for a table."""
        temperature = "–" if self.temperature_degc is None else f"{self.temperature_degc:g} degC"
        began, ended = format_duration(self.began_s), format_duration(self.ended_s)
        return [began, ended, temperature, self.kind, str(self.points) if self.points else "–"]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return dict(vars(self))


def phases(plan: Sequence[PlannedStep], ends_s: Sequence[float]) -> list[Phase]:
    """The phases of the steps that have an end."""
    result: list[Phase] = []
    began = 0.0
    for step, ended in zip(plan, ends_s, strict=False):
        kind = _KINDS.get(step.verb, "measure")
        points = int(step.point is not None)
        last = result[-1] if result else None
        if last and last.kind == kind and last.temperature_degc == step.temperature_degc:
            result[-1] = replace(last, ended_s=ended, points=last.points + points)
        else:
            result.append(Phase(began, ended, step.temperature_degc, kind, points))
        began = ended
    return result
