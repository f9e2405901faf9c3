"""`check`: everything that can be known to be wrong before hour 0, all at once, without touching hardware (law 7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.analysis_problems import analysis_problems, model_problems, site_problems
from bench.benchfile import Bench, load_bench
from bench.calibration_problems import calibration_site_problems
from bench.composition import check_simulation
from bench.errors import InvalidFiles, Mark, Problem
from bench.guard_problems import guard_problems
from bench.overrides import Override, editor
from bench.power_problems import power_problems
from bench.procedure.conditions import Band
from bench.procedure.language import (
    Acquire,
    Dwell,
    GoToPosition,
    ProcedureHead,
    RampTemperature,
    Record,
    SetRate,
    SetTemperature,
    Settle,
    Soak,
)
from bench.procedure.parse import ParsedProcedure, parse_procedure
from bench.procedure.plan import PlannedStep, expand
from bench.reach import reach_problems, safe_reach_problems
from bench.units import counted, format_duration, number

# Bytes on disk per raw frame: float32 noise, 16-bit temperature and counters as Parquet, measured 1.8 (docs/reference).
BYTES_PER_FRAME = 2.5
BYTES_PER_SAMPLE = 12.0
# A row of a record is kept twice: in its part and in the joined series.
BYTES_PER_ROW = 100.0
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

    @property
    def content(self) -> str:
        """What it measures, in words, e.g. '703 points' or '2 records'."""
        counts = {"point": self.points, "record": self.records}
        return " and ".join(counted(count, what) for what, count in counts.items() if count) or "0 points"

    @property
    def records(self) -> int:
        """Records made (each gives one time series per DUT)."""
        return sum(isinstance(step.args, Record) for step in self.plan)


def check(
    procedure_path: Path,
    bench_path: Path,
    overrides: Sequence[Override] = (),
    included: Sequence[Path] = (),
    beside: Path | None = None,
) -> Checked:
    """Check a procedure against a bench. Raises InvalidFiles with every mistake found.

    For copies in a run folder `included` are those of the included files, and `beside` is the folder of declarations.
    """
    procedure, problems = parse_procedure(procedure_path, editor(overrides, "procedure"), recorded=included)
    bench, bench_problems = load_bench(bench_path, editor(overrides, "bench"), beside)
    plan: list[PlannedStep] = []
    if procedure:
        plan, sweep_problems = expand(procedure.steps)
        # What only a whole plan can tell would be said wrongly of what is left of a plan with mistakes in it.
        whole = not problems and not sweep_problems
        problems += [*sweep_problems, *model_problems(procedure), *(_plan_problems(procedure, plan) if whole else ())]
    problems += bench_problems
    if bench:
        problems += [*_safe_problems(bench), *safe_reach_problems(bench), *check_simulation(bench)]
        problems += guard_problems(procedure, bench)
    if procedure and bench:
        problems += [problem for step in plan for problem in _step_problems(step, bench)]
        problems += site_problems(procedure, bench.file.site, bench.document)
        problems += calibration_site_problems(procedure, plan, bench.file.site, bench.document)
        problems += [*_limit_problems(plan, procedure.head, bench), *reach_problems(plan, bench)]
        problems += power_problems(plan, bench)
    if problems or procedure is None or bench is None:
        raise InvalidFiles(problems)
    duration_s = estimate_duration_s(plan)
    return Checked(procedure, bench, plan, duration_s, _disk_bytes(plan, procedure.head, bench))


def estimate_duration_s(plan: Sequence[PlannedStep]) -> float:
    """Rough duration by adding up stated times; a dry run says better, because instruments take their own time."""
    return sum(_durations_s(plan))


def _durations_s(plan: Sequence[PlannedStep]) -> Iterator[float]:
    """The stated time of each step."""
    last = ROOM_DEGC
    for step in plan:
        args, lasts_s = step.args, 0.0
        if isinstance(args, RampTemperature):
            lasts_s = abs(args.to_degc - last) / args.rate_degc_min * 60.0
        if isinstance(args, SetTemperature | RampTemperature):
            last = args.to_degc
        elif isinstance(args, Soak | Dwell | Settle):
            lasts_s = args.for_s
        elif isinstance(args, Acquire):
            lasts_s = args.duration_s
        yield lasts_s


def _disk_bytes(plan: Sequence[PlannedStep], head: ProcedureHead, bench: Bench) -> float:
    per_second = sum(dut.settings.data_rate_hz for dut in bench.duts.values()) * BYTES_PER_FRAME
    total, every_s = BYTES_PER_STEP * len(plan), 0.0
    for step, lasts_s in zip(plan, _durations_s(plan), strict=True):
        every_s = step.args.every_s if isinstance(step.args, Record) else every_s
        if step.record is not None:
            total += lasts_s / every_s * BYTES_PER_ROW * len(bench.duts)
        if isinstance(step.args, Acquire) and head.raw == "samples":
            total += step.args.samples * BYTES_PER_SAMPLE * len(bench.duts)
        if (isinstance(step.args, Acquire) or step.record is not None) and head.raw == "frames":
            total += lasts_s * per_second
    return total


def _step_problems(step: PlannedStep, bench: Bench) -> Iterator[Problem]:
    args, missing = step.args, "Add one to the bench file, or leave the step out."
    messages: list[str] = []
    if isinstance(args, SetTemperature | RampTemperature) and bench.file.chamber is None:
        messages = [f"this bench has no chamber. {missing}"]
    elif isinstance(args, SetRate | Settle | GoToPosition) and bench.rate_table is None:
        messages = [f"this bench has no rate table. {missing}"]
    elif isinstance(args, Acquire):
        messages = list(_acquire_messages(args, bench))
        if step.record is not None:
            messages.append("a point cannot be measured inside a record. Put a dwell there, or the acquire outside it.")
    elif isinstance(args, Record):
        messages = list(_too_fast(args.every_s, "a row", bench))
    yield from (Problem(step.mark, f"'{step.verb}': {message}") for message in messages)


@dataclass(frozen=True)
class _Breach:
    """A setpoint beyond a limit: whose limit and which end of it, by how much, and in words."""

    limit: tuple[str, str]
    value: float
    excess: float
    message: str


def _limit_problems(plan: Sequence[PlannedStep], head: ProcedureHead, bench: Bench) -> Iterator[Problem]:
    """One problem for each place and limit: the value farthest out, and how many others of a sweep are out too."""
    found: dict[tuple[Mark, str, tuple[str, str]], dict[float, _Breach]] = {}
    for step in plan:
        for breach in _breaches(step, head, bench):
            found.setdefault((step.mark, step.verb, breach.limit), {})[breach.value] = breach
    for (mark, verb, _), breaches in found.items():
        worst = max(breaches.values(), key=lambda breach: breach.excess)
        others = len(breaches) - 1
        more = f" So {'is' if others == 1 else 'are'} {others} more of the values visited here." if others else ""
        yield Problem(mark, f"'{verb}': {worst.message}{more}")


def _breaches(step: PlannedStep, head: ProcedureHead, bench: Bench) -> Iterator[_Breach]:
    args = step.args
    if isinstance(args, SetTemperature | RampTemperature):
        yield from _temperature_breaches(args.to_degc, head, bench)
    if isinstance(args, RampTemperature):
        yield from _ramp_breaches(args.rate_degc_min, head, bench)
    if isinstance(args, SetRate):
        yield from _rate_breaches(args.to_dps, head, bench)


def _temperature_breaches(value: float, head: ProcedureHead | None, bench: Bench) -> Iterator[_Breach]:
    bands: list[tuple[str, Band | None]] = [("the procedure's own limits", head.limits.temperature if head else None)]
    if bench.file.chamber:
        bands.append(("the chamber", bench.file.chamber.limits.temperature))
    bands += [(f"DUT {serial}", dut.limits.temperature) for serial, dut in bench.file.duts.items()]
    for owner, band in bands:
        if band and not band.from_degc <= value <= band.to_degc:
            end, excess = ("low", band.from_degc - value) if value < band.from_degc else ("high", value - band.to_degc)
            message = (
                f"{number(value)} degC is outside {owner}: {number(band.from_degc)} to {number(band.to_degc)} degC."
            )
            yield _Breach((owner, end), value, excess, message)


def _ramp_breaches(value: float, head: ProcedureHead | None, bench: Bench) -> Iterator[_Breach]:
    limits = [("the procedure", head.limits.ramp_degc_min if head else None)]
    if bench.file.chamber:
        limits.append(("the chamber", bench.file.chamber.limits.ramp_degc_min))
    for owner, limit in limits:
        if limit is not None and value > limit:
            message = f"a ramp of {number(value)} degC/min is above the limit of {owner}, {number(limit)} degC/min."
            yield _Breach((owner, "ramp"), value, value - limit, message)


def _rate_breaches(value: float, head: ProcedureHead, bench: Bench) -> Iterator[_Breach]:
    limits = [("the procedure's own limit", head.limits.rate_dps)]
    if bench.file.rate_table:
        limits.append(("the rate table's limit", bench.file.rate_table.limits.rate_dps))
    limits += [(f"the full scale of DUT {serial}", dut.limits.rate_dps) for serial, dut in bench.file.duts.items()]
    for owner, limit in limits:
        if limit is not None and abs(value) > limit:
            message = f"{number(value)} deg/s is above {owner}, ± {number(limit)} deg/s."
            yield _Breach((owner, "rate"), value, abs(value) - limit, message)


def _too_fast(every_s: float, what: str, bench: Bench) -> Iterator[str]:
    for serial, dut in bench.duts.items():
        rate_hz = dut.settings.data_rate_hz
        if every_s * rate_hz < 1 - 1e-9:
            yield f"{what} every {every_s:g} s is faster than the {rate_hz:g} Hz of DUT {serial}."


def _acquire_messages(args: Acquire, bench: Bench) -> Iterator[str]:
    yield from _too_fast(args.every_s, "a sample", bench)
    for serial, dut in bench.duts.items():
        rate_hz = dut.settings.data_rate_hz
        if args.duration_s * rate_hz > MAX_FRAMES_PER_POINT:
            yield (
                f"{args.duration_s * rate_hz:.3g} frames of DUT {serial} in one point are more than "
                f"{MAX_FRAMES_PER_POINT:.0e}. Split it with repeat."
            )


def _safe_problems(bench: Bench) -> Iterator[Problem]:
    """Where the safe state of the chamber breaks the limits of the bench."""
    if bench.file.chamber is None or bench.file.chamber.safe.action != "go_to":
        return
    safe = bench.file.chamber.safe
    for key, breaches in (
        ("temperature", _temperature_breaches(safe.temperature_degc, None, bench)),
        ("rate", _ramp_breaches(safe.rate_degc_min, None, bench)),
    ):
        for breach in breaches:
            yield Problem(bench.document.mark(("chamber", "safe", key)), f"the safe state: {breach.message}")


def _plan_problems(procedure: ParsedProcedure, plan: Sequence[PlannedStep]) -> Iterator[Problem]:
    """What depends on the order of the steps and on their sum."""
    for step in plan:
        if isinstance(step.args, Settle) and step.rate_dps is None:
            yield Problem(step.mark, "'settle': no rate was set before it. Put a set_rate or a rate sweep around it.")
    limit_s, duration_s = procedure.head.limits.duration_s, estimate_duration_s(plan)
    if limit_s is not None and duration_s > limit_s:
        mark = procedure.document.mark(("limits", "duration"))
        message = f"the procedure takes about {format_duration(duration_s)}, its limit is {format_duration(limit_s)}."
        yield Problem(mark, message)
    yield from analysis_problems(procedure, plan)
