"""`check`: everything that can be known to be wrong before hour 0, all at once, without touching hardware (law 7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from bench.benchfile import Bench, load_bench
from bench.composition import check_simulation
from bench.errors import InvalidFiles, Mark, Problem, did_you_mean
from bench.overrides import Override, editor
from bench.procedure.language import (
    Acquire,
    Band,
    Dwell,
    GoToPosition,
    ProcedureHead,
    RampTemperature,
    SetRate,
    SetTemperature,
    Settle,
    Soak,
)
from bench.procedure.parse import ParsedProcedure, parse_procedure
from bench.procedure.plan import PlannedStep, expand
from bench.units import format_duration

# Bytes on disk per raw frame: float32 noise, 16-bit temperature and counters as Parquet, measured 1.8 (docs/reference).
BYTES_PER_FRAME = 2.5
BYTES_PER_SAMPLE = 12.0
BYTES_PER_STEP = 2000.0
MAX_FRAMES_PER_POINT = 50_000_000
ROOM_DEGC = 25.0


@dataclass(frozen=True)
class Checked:
    """A procedure and a bench that fit each other, with the plan and what it will take."""

    procedure: ParsedProcedure
    bench: Bench
    plan: list[PlannedStep]
    duration_s: float
    disk_bytes: float

    @property
    def head(self) -> ProcedureHead:
        """The blocks of the procedure around its steps."""
        return self.procedure.head

    @property
    def points(self) -> int:
        """Conditions measured (each gives one point per DUT)."""
        return sum(step.point is not None for step in self.plan)


def check(procedure_path: Path, bench_path: Path, overrides: Sequence[Override] = ()) -> Checked:
    """Check a procedure against a bench. Raises InvalidFiles with every mistake found."""
    procedure, problems = parse_procedure(procedure_path, editor(overrides, "procedure"))
    bench, bench_problems = load_bench(bench_path, editor(overrides, "bench"))
    problems += bench_problems
    plan: list[PlannedStep] = []
    if procedure:
        plan, sweep_problems = expand(procedure.steps)
        problems += sweep_problems
    if bench:
        problems += check_simulation(bench)
    if procedure and bench:
        problems += [problem for step in plan for problem in _step_problems(step, procedure.head, bench)]
        problems += _analysis_problems(procedure, plan)
    duration_s = estimate_duration_s(plan)
    if procedure and procedure.head.limits.duration_s and duration_s > procedure.head.limits.duration_s:
        limit = format_duration(procedure.head.limits.duration_s)
        mark = procedure.document.mark(("limits", "duration"))
        problems.append(
            Problem(mark, f"the procedure takes about {format_duration(duration_s)}, its limit is {limit}.")
        )
    if problems or procedure is None or bench is None:
        raise InvalidFiles(problems)
    return Checked(procedure, bench, plan, duration_s, _disk_bytes(plan, procedure.head, bench))


def estimate_duration_s(plan: Sequence[PlannedStep]) -> float:
    """Rough duration by adding up stated times; a dry run says better, because instruments take their own time."""
    total, last = 0.0, ROOM_DEGC
    for step in plan:
        args = step.args
        if isinstance(args, RampTemperature):
            total += abs(args.to_degc - last) / args.rate_degc_min * 60.0
        if isinstance(args, SetTemperature | RampTemperature):
            last = args.to_degc
        elif isinstance(args, Soak | Dwell | Settle):
            total += args.for_s
        elif isinstance(args, Acquire):
            total += args.duration_s
    return total


def _disk_bytes(plan: Sequence[PlannedStep], head: ProcedureHead, bench: Bench) -> float:
    total = BYTES_PER_STEP * len(plan)
    for step in plan:
        if isinstance(step.args, Acquire) and head.raw != "none":
            for dut in bench.duts.values():
                frames = step.args.duration_s * dut.settings.data_rate_hz
                total += frames * BYTES_PER_FRAME if head.raw == "frames" else step.args.samples * BYTES_PER_SAMPLE
    return total


def _step_problems(step: PlannedStep, head: ProcedureHead, bench: Bench) -> Iterator[Problem]:
    args = step.args

    def problem(message: str) -> Problem:
        return Problem(step.mark, f"'{step.verb}': {message}")

    if isinstance(args, SetTemperature | RampTemperature):
        yield from map(problem, _temperature_messages(args, head, bench))
    if isinstance(args, SetRate | Settle | GoToPosition) and bench.rate_table is None:
        yield problem("this bench has no rate table. Add one to the bench file, or leave the step out.")
    if isinstance(args, SetRate):
        yield from map(problem, _rate_messages(args.to_dps, head, bench))
    if isinstance(args, Settle) and step.rate_dps is None:
        yield problem("no rate was set before it. Put a set_rate or a rate sweep around it.")
    if isinstance(args, Acquire):
        yield from map(problem, _acquire_messages(args, bench))


def _temperature_messages(args: SetTemperature | RampTemperature, head: ProcedureHead, bench: Bench) -> Iterator[str]:
    if bench.file.chamber is None:
        yield "this bench has no chamber. Add one to the bench file, or leave the step out."
        return
    bands: list[tuple[str, Band | None]] = [
        ("the procedure's own limits", head.limits.temperature),
        ("the chamber", bench.file.chamber.limits.temperature),
        *((f"DUT {serial}", dut.limits.temperature) for serial, dut in bench.file.duts.items()),
    ]
    for owner, band in bands:
        if band and not band.from_degc <= args.to_degc <= band.to_degc:
            yield f"{args.to_degc:g} degC is outside {owner}: {band.from_degc:g} to {band.to_degc:g} degC."
    if isinstance(args, RampTemperature):
        ramps = [("the chamber", bench.file.chamber.limits.ramp_degc_min), ("the procedure", head.limits.ramp_degc_min)]
        for owner, limit in ramps:
            if limit is not None and args.rate_degc_min > limit:
                yield f"a ramp of {args.rate_degc_min:g} degC/min is above the limit of {owner}, {limit:g} degC/min."


def _rate_messages(rate_dps: float, head: ProcedureHead, bench: Bench) -> Iterator[str]:
    limits = [("the procedure's own limit", head.limits.rate_dps)]
    if bench.file.rate_table:
        limits.append(("the rate table's limit", bench.file.rate_table.limits.rate_dps))
    limits += [(f"the full scale of DUT {serial}", dut.limits.rate_dps) for serial, dut in bench.file.duts.items()]
    for owner, limit in limits:
        if limit is not None and abs(rate_dps) > limit:
            yield f"{rate_dps:g} deg/s is above {owner}, ± {limit:g} deg/s."


def _acquire_messages(args: Acquire, bench: Bench) -> Iterator[str]:
    for serial, dut in bench.duts.items():
        rate_hz = dut.settings.data_rate_hz
        if args.every_s * rate_hz < 1 - 1e-9:
            yield f"a sample every {args.every_s:g} s is faster than the {rate_hz:g} Hz of DUT {serial}."
        if args.duration_s * rate_hz > MAX_FRAMES_PER_POINT:
            yield (
                f"{args.duration_s * rate_hz:.3g} frames of DUT {serial} in one point are more than "
                f"{MAX_FRAMES_PER_POINT:.0e}. Split it with repeat."
            )


def _analysis_problems(procedure: ParsedProcedure, plan: Sequence[PlannedStep]) -> Iterator[Problem]:
    analysis = procedure.head.analysis
    if analysis is None:
        return
    known = [item.name for item in entry_points(group="fogbench.models")]

    def mark(*path: str | int) -> Mark:
        return procedure.document.mark(("analysis", *path))

    for index, name in enumerate(analysis.models):
        if name not in known:
            yield Problem(mark("models", index), f"unknown model '{name}'.{did_you_mean(name, known)}")
    for index, limit in enumerate(analysis.limits):
        if limit.model not in analysis.models:
            hint = did_you_mean(limit.model, analysis.models)
            yield Problem(mark("limits", index), f"the limit is for '{limit.model}', which is not fitted.{hint}")
    points = [step for step in plan if step.point is not None]
    if not points:
        yield Problem(mark(), "there is nothing to analyse: the steps hold no acquire.")
        return
    if analysis.splits.random.train is not None and analysis.splits.random.train >= len(points):
        message = f"{analysis.splits.random.train} rows for training, but only {len(points)} points are measured."
        yield Problem(mark("splits", "random"), message)
    if any(step.rate_dps is None for step in points):
        yield Problem(
            mark(), "some points have no rate setpoint, so there is no reference to fit to. Set a rate first."
        )
