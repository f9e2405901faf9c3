"""What is wrong with the power steps of a plan, and with what is measured around them (see `bench.check`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.benchfile import Bench
from bench.errors import Problem, did_you_mean
from bench.procedure.language import Acquire, EndRecord, Power, Soak
from bench.procedure.plan import PlannedStep
from bench.units import number


def power_problems(plan: Sequence[PlannedStep], bench: Bench) -> list[Problem]:
    """One problem for each place and mistake, however often the place is passed."""
    return list(dict.fromkeys([*_steps(plan, bench), *_supply(bench)]))


def _steps(plan: Sequence[PlannedStep], bench: Bench) -> Iterator[Problem]:
    for step in plan:
        if isinstance(step.args, Power):
            messages = list(_switching(step, step.args, bench))
        else:
            messages = list(_while_off(step, bench)) if step.off and bench.supply else []
        yield from (Problem(step.mark, f"'{step.verb}': {message}") for message in messages)
        if isinstance(step.args, EndRecord) and step.off and step.record_step is not None:
            mark = plan[step.record_step - 1].mark
            message = "the DUTs are off from its beginning to its end. Put a 'power: on' into it, or before it."
            yield Problem(mark, f"'record': {message}")


def _switching(step: PlannedStep, args: Power, bench: Bench) -> Iterator[str]:
    if bench.supply is None:
        yield "this bench has no power supply. Add one to the bench file ('supply:'), or leave the step out."
        return
    if step.record is not None and args.to == "off":
        yield "inside a record the DUTs cannot be switched off. End the record before; each turn-on is one of its own."
    if args.duts == "all":
        return
    fed = ", ".join(bench.powered)
    for name in args.duts:
        if name not in bench.duts:
            yield f"there is no DUT '{name}'.{did_you_mean(name, bench.powered)}"
        elif name not in bench.powered:
            yield f"the supply does not feed {name}; it feeds {fed} (the bench file's 'powers')."
    left_out = [name for name in bench.powered if name not in args.duts]
    if left_out and all(name in bench.powered for name in args.duts):
        yield f"the supply has one output: {fed} are switched together. Add {', '.join(left_out)}, or say duts: all."


def _while_off(step: PlannedStep, bench: Bench) -> Iterator[str]:
    fed = ", ".join(bench.powered)
    if isinstance(step.args, Acquire):
        yield f"{fed} would be off here. Put a 'power: on' before it."
    if isinstance(step.args, Soak) and step.args.until and set(bench.powered) == set(bench.duts):
        yield "no DUT tells its temperature while all are off. Leave 'until' out, or use a dwell."


def _supply(bench: Bench) -> Iterator[Problem]:
    """Where the settings of the supply ask for more than its limits allow."""
    if bench.supply is None or bench.file.supply is None:
        return
    settings, limits = bench.supply.settings, bench.file.supply.limits
    for key, asked, allowed, unit in (
        ("voltage", getattr(settings, "voltage_v", None), limits.voltage_v, "V"),
        ("current_limit", getattr(settings, "current_limit_a", None), limits.current_a, "A"),
    ):
        if asked is not None and allowed is not None and asked > allowed:
            message = f"'{key}': {number(asked)} {unit} is above the limit of the supply, {number(allowed)} {unit}."
            yield Problem(bench.document.mark(("supply", "settings", key)), message)
