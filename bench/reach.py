"""Whether what a procedure waits for can come within its timeouts, from what is declared of chamber and table.

What a machine really takes is the rehearsal's matter: here stands what no machine with these limits can do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.benchfile import Bench
from bench.errors import Mark, Problem
from bench.procedure.language import GoToPosition, RampTemperature, SetRate, SetTemperature, Settle, Soak
from bench.procedure.plan import PlannedStep
from bench.units import format_duration, number


@dataclass(frozen=True)
class _Late:
    """A wait that cannot end in time: by how much, and in words."""

    mark: Mark
    verb: str
    excess_s: float
    message: str


def reach_problems(plan: Sequence[PlannedStep], bench: Bench) -> Iterator[Problem]:
    """One problem for each place: the worst of a sweep, and how many others of it are as bad."""
    found: dict[tuple[Mark, str], list[_Late]] = {}
    for late in (*_chamber(plan, bench), *_table(plan, bench), *_soaks(plan)):
        found.setdefault((late.mark, late.verb), []).append(late)
    for (mark, verb), places in found.items():
        worst = max(places, key=lambda late: late.excess_s)
        others = len(places) - 1
        more = f" So {'is' if others == 1 else 'are'} {others} more of the values visited here." if others else ""
        yield Problem(mark, f"'{verb}': {worst.message}{more}")


def _chamber(plan: Sequence[PlannedStep], bench: Bench) -> Iterator[_Late]:
    """Ramps that take longer than their timeout; the first has no known beginning."""
    limits = bench.file.chamber.limits if bench.file.chamber else None
    own = limits.ramp_degc_min if limits and "ramp_degc_min" in limits.model_fields_set else None
    last: float | None = None
    for step in plan:
        args = step.args
        if not isinstance(args, SetTemperature | RampTemperature):
            continue
        pace, whose = own, "the chamber's limit"
        if isinstance(args, RampTemperature):
            pace, whose = args.rate_degc_min, "its rate"
        if last is not None and pace is not None:
            needed_s = (abs(args.to_degc - last) - args.band_k) / pace * 60.0
            if needed_s > args.timeout_s:
                message = (
                    f"from {number(last)} to {number(args.to_degc)} degC takes at least {format_duration(needed_s)} at "
                    f"{whose}, {number(pace)} degC/min; the timeout is {format_duration(args.timeout_s)}. Raise "
                    "'timeout', or ramp faster."
                )
                yield _Late(step.mark, step.verb, needed_s - args.timeout_s, message)
        last = args.to_degc


def _table(plan: Sequence[PlannedStep], bench: Bench) -> Iterator[_Late]:
    """Rates that are not reached, or not held for long enough, within the timeout of the settle."""
    acceleration = _acceleration_dps2(bench)
    before: float | None = None
    now: float | None = None
    for step in plan:
        args = step.args
        if isinstance(args, SetRate):
            before, now = now, args.to_dps
        elif isinstance(args, GoToPosition):
            before, now = None, 0.0
        elif isinstance(args, Settle):
            change = abs(now - before) if now is not None and before is not None and acceleration else 0.0
            needed_s = max(0.0, change - args.band_dps) / (acceleration or 1.0) + args.for_s
            if needed_s > args.timeout_s:
                way = f"{number(change)} deg/s at {number(acceleration or 0.0)} deg/s^2 and " if change else ""
                message = (
                    f"{way}{number(args.for_s)} s in the band take at least {needed_s:.3g} s; the timeout is "
                    f"{number(args.timeout_s)} s. Raise 'timeout'."
                )
                yield _Late(step.mark, step.verb, needed_s - args.timeout_s, message)
            before = now


def _soaks(plan: Sequence[PlannedStep]) -> Iterator[_Late]:
    """Slopes over more time than the soak has: what it would judge lies before it."""
    for step in plan:
        args = step.args
        if isinstance(args, Soak) and args.until and args.timeout_s and args.until.over_s > args.timeout_s:
            over, timeout = format_duration(args.until.over_s), format_duration(args.timeout_s)
            message = f"the slope is taken over {over}, longer than the timeout, {timeout}. Raise 'timeout'."
            yield _Late(step.mark, step.verb, args.until.over_s - args.timeout_s, message)


def safe_reach_problems(bench: Bench) -> Iterator[Problem]:
    """Where the safe state of the bench cannot be reached by what is declared."""
    table, chamber = bench.file.rate_table, bench.file.chamber
    acceleration = _acceleration_dps2(bench)
    if table and acceleration and table.limits.rate_dps / acceleration > table.safe.timeout_s:
        needed_s = table.limits.rate_dps / acceleration
        message = (
            f"the safe state: from {number(table.limits.rate_dps)} deg/s at {number(acceleration)} deg/s^2 the table "
            f"comes to rest in {needed_s:.3g} s; the timeout is {number(table.safe.timeout_s)} s."
        )
        yield Problem(bench.document.mark(("rate_table", "safe", "timeout")), message)
    if chamber and chamber.safe.action == "off":
        settings = bench.chamber.settings if bench.chamber else None
        if not getattr(settings, "can_switch_off", False):
            message = (
                "the safe state: nothing says how this chamber is switched off. With a Watlow F4 that is "
                "conditioning_event: 1..8 under 'settings:'. Or use hold or go_to."
            )
            yield Problem(bench.document.mark(("chamber", "safe", "action")), message)


def _acceleration_dps2(bench: Bench) -> float | None:
    """What the driver demands of the table, if its settings say."""
    settings = bench.rate_table.settings if bench.rate_table else None
    acceleration = getattr(settings, "acceleration_dps2", None)
    return float(acceleration) if acceleration else None
