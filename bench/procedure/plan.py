"""From the tree of steps to the flat, numbered plan that the engine runs, the journal names and a resume counts."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from bench.errors import Mark, Problem
from bench.fields import YamlMapping
from bench.procedure.language import (
    Acquire,
    EndRecord,
    GoToPosition,
    PositionRange,
    Power,
    RampTemperature,
    RateRange,
    Record,
    Repeat,
    SetRate,
    SetTemperature,
    Sweep,
    TemperatureRange,
)
from bench.procedure.parse import StepNode
from bench.units import number

MAX_STEPS = 500_000
# Values of ranges are rounded: 0.1-steps visit 0.3 and not 0.30000000000000004 (setpoints are keys in the record).
_DIGITS = 9


@dataclass(frozen=True)
class PlannedStep:
    """One step of the plan, with the conditions that hold when it begins.

    `dwell` counts the temperatures visited (0 before the first), `point` the acquisitions (None for other verbs).
    `record` is the label of the record a step begins, ends or is inside of, `record_step` the number of the step that
    begins it. `off`: the DUTs that the supply feeds are switched off.
    """

    number: int
    verb: str
    args: YamlMapping
    mark: Mark
    dwell: int
    temperature_degc: float | None
    rate_dps: float | None
    point: int | None = None
    position_deg: float | None = None
    record: str | None = None
    record_step: int | None = None
    off: bool = False


@dataclass
class _State:
    plan: list[PlannedStep] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    temperature_degc: float | None = None
    rate_dps: float | None = None
    dwell: int = 0
    points: int = 0
    visited: int = 0
    position_deg: float | None = None
    record: str | None = None
    record_step: int | None = None
    off: bool = False
    labels: dict[str, int] = field(default_factory=dict)
    entered: dict[int, int] = field(default_factory=dict)
    malformed: set[int] = field(default_factory=set)

    def add(self, verb: str, args: YamlMapping, mark: Mark) -> None:
        if isinstance(args, SetTemperature | RampTemperature):
            self.temperature_degc = args.to_degc
            self.dwell += 1
        elif isinstance(args, SetRate):
            self.rate_dps, self.position_deg = args.to_dps, None
        elif isinstance(args, GoToPosition):
            self.rate_dps, self.position_deg = 0.0, args.to_deg
        elif isinstance(args, Power):
            self.off = args.to == "off"
        elif isinstance(args, Record):
            self.record, self.record_step = self._label(args.name), len(self.plan) + 1
        point = None
        if isinstance(args, Acquire):
            self.points += 1
            point = self.points
        step = PlannedStep(
            len(self.plan) + 1,
            verb,
            args,
            mark,
            self.dwell,
            self.temperature_degc,
            self.rate_dps,
            point,
            self.position_deg,
            self.record,
            self.record_step,
            self.off,
        )
        self.plan.append(step)
        if isinstance(args, EndRecord):
            self.record = self.record_step = None

    def _label(self, name: str) -> str:
        """The name of a record; from the second of its name on with a number."""
        count = self.labels.get(name, 0) + 1
        while (label := name if count == 1 else f"{name}-{count}") in self.labels and count > 1:
            count += 1
        self.labels[name] = count
        self.labels.setdefault(label, 1)
        return label


class _TooLong(Exception):
    pass


def expand(steps: Sequence[StepNode]) -> tuple[list[PlannedStep], list[Problem]]:
    """Expand sweeps, repeats and includes; malformed sweeps come back as problems."""
    state = _State()
    try:
        _expand(steps, state)
    except _TooLong:
        message = f"the procedure has more than {MAX_STEPS} steps. Are the sweeps and repeats nested as meant?"
        state.problems.append(Problem(steps[0].mark, message))
    return state.plan, state.problems


def _expand(steps: Sequence[StepNode], state: _State) -> None:
    for node in steps:
        # Visits are counted too: repeats of nothing add no step and would not end.
        state.visited += 1
        if max(state.visited, len(state.plan)) > MAX_STEPS:
            raise _TooLong
        if isinstance(node.args, Sweep):
            _expand_sweep(node, node.args, state)
        elif isinstance(node.args, Repeat):
            for _ in range(node.args.times if node.children else 0):
                _expand(node.children, state)
        elif isinstance(node.args, Record):
            _expand_record(node, node.args, state)
        elif node.verb == "include":
            _expand(node.children, state)
        else:
            state.add(node.verb, node.args, node.mark)


def _expand_record(node: StepNode, record: Record, state: _State) -> None:
    if state.record is not None:
        state.problems.append(Problem(node.mark, "a record inside a record. Give the outer one the shorter 'every'."))
        return
    state.add("record", record, node.mark)
    _expand(node.children, state)
    state.add("end_record", EndRecord(), node.mark)


def _expand_sweep(node: StepNode, sweep: Sweep, state: _State) -> None:
    if id(node) in state.malformed:
        return
    try:
        values = sweep_values(sweep)
    except ValueError as error:
        state.malformed.add(id(node))
        state.problems.append(Problem(node.mark, f"sweep: {error}."))
        return
    visits = state.entered.get(id(node), 0)
    state.entered[id(node)] = visits + 1
    for value in _ordered(values, sweep, visits):
        verb, args = _visit(sweep, value)
        state.add(verb, args, node.mark)
        _expand(node.children, state)


def _visit(sweep: Sweep, value: float) -> tuple[str, YamlMapping]:
    """The step that brings the bench to one value of the sweep."""
    if sweep.rate is not None:
        return "set_rate", SetRate.model_construct(to_dps=value)
    if sweep.position is not None:
        return "go_to_position", GoToPosition.model_construct(to_deg=value)
    common: dict[str, Any] = {"to_degc": value, "band_k": sweep.band_k, "timeout_s": sweep.timeout_s}
    if sweep.ramp_degc_min is None:
        return "set_temperature", SetTemperature.model_construct(**common)
    return "ramp_temperature", RampTemperature.model_construct(rate_degc_min=sweep.ramp_degc_min, **common)


def sweep_values(sweep: Sweep) -> list[float]:
    """The values of a sweep as written, before ordering. Raises ValueError for a range that is malformed."""
    if isinstance(sweep.temperature, TemperatureRange):
        spec = sweep.temperature
        return _range(spec.from_degc, spec.to_degc, spec.step_k, "degC", "K")
    if isinstance(sweep.rate, RateRange):
        values = _range(sweep.rate.from_dps, sweep.rate.to_dps, sweep.rate.step_dps, "deg/s", "deg/s")
        return _without(values, sweep.rate.without_dps)
    if isinstance(sweep.position, PositionRange):
        turn = sweep.position
        return _range(turn.from_deg, turn.to_deg, turn.step_deg, "deg", "deg")
    listed: list[float] = list(sweep.temperature or sweep.rate or sweep.position or [])
    if not listed:
        raise ValueError("the list of values is empty")
    return listed


def _range(start: float, end: float, step: float, unit: str, step_unit: str) -> list[float]:
    if end < start:
        raise ValueError(
            f"'from' ({number(start)} {unit}) is above 'to' ({number(end)} {unit}); write them upwards with order: down"
        )
    steps = (end - start) / step
    if steps >= MAX_STEPS:
        raise ValueError(f"a step of {step:g} {step_unit} gives more than {MAX_STEPS} values")
    count = round(steps)
    if abs(steps - count) > 1e-6:
        last, after = number(start + math.floor(steps) * step), number(start + math.ceil(steps) * step)
        raise ValueError(
            f"steps of {number(step)} {step_unit} from {number(start)} {unit} do not end on {number(end)} {unit}: they "
            f"reach {last}, then {after}. Choose a step that divides {number(end - start)} {step_unit}, "
            f"or to: {last} {unit}"
        )
    return [round(start + index * step, _DIGITS) + 0.0 for index in range(count + 1)]


def _without(values: list[float], unwanted: list[float]) -> list[float]:
    visited, left_out = set(values), {round(u, _DIGITS) + 0.0 for u in unwanted}
    kept = [value for value in values if value not in left_out]
    missing = sorted(left_out - visited)
    if missing:
        raise ValueError(f"'without' names {number(missing[0])}, which the range does not visit")
    if not kept:
        raise ValueError("'without' leaves no value")
    return kept


def _ordered(values: list[float], sweep: Sweep, visits: int) -> Iterator[float]:
    if sweep.order is None:
        return iter(values)
    ascending = sorted(values)
    if sweep.order == "random":
        random.Random(f"{sweep.seed}/{visits}").shuffle(ascending)
    elif sweep.order == "down" or (sweep.order == "alternate" and visits % 2):
        ascending.reverse()
    return iter(ascending)
