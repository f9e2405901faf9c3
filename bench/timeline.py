"""A plan and its rehearsed times as a timeline a person can read: one phase per stretch of one kind of step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from bench.procedure.language import RampTemperature, Soak
from bench.procedure.plan import PlannedStep
from bench.units import format_duration

_KINDS = {"set_temperature": "ramp", "ramp_temperature": "ramp"} | {
    verb: verb for verb in ("soak", "dwell", "power", "note")
}


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


# A ramp may take this much longer than its rate says before it is worth a word: probe lag and the band at its end.
RAMP_ALLOWANCE_S = 600.0
ROOM_DEGC = 25.0


def remarks(plan: Sequence[PlannedStep], ends_s: Sequence[float]) -> list[str]:
    """Where the rehearsed bench could not keep to what the procedure states: ramps not followed, soaks drawn out."""
    found: list[str] = []
    began, temperature = 0.0, ROOM_DEGC
    for step, ended in zip(plan, ends_s, strict=False):
        args, took = step.args, ended - began
        if isinstance(args, RampTemperature):
            stated = abs(args.to_degc - temperature) / args.rate_degc_min * 60.0
            if took > stated + RAMP_ALLOWANCE_S:
                found.append(
                    f"{step.mark}: the ramp to {args.to_degc:g} degC took {format_duration(took)}; at "
                    f"{args.rate_degc_min:g} degC/min it is {format_duration(stated)}. The chamber is at its limit."
                )
        elif isinstance(args, Soak) and took > args.for_s + RAMP_ALLOWANCE_S:
            found.append(
                f"{step.mark}: the soak at {temperature:g} degC took {format_duration(took)} instead of "
                f"{format_duration(args.for_s)}: the DUTs' slope was outside its band for longer."
            )
        began = ended
        temperature = temperature if step.temperature_degc is None else step.temperature_degc
    return found
