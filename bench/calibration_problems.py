"""What can be known before hour 0 to be wrong with a `calibration` block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.bench_entries import Site
from bench.earth import earth_rate_dps
from bench.errors import Problem, did_you_mean
from bench.procedure.calibration import CalibrationAnalysis
from bench.procedure.language import Record
from bench.procedure.parse import ParsedProcedure
from bench.procedure.plan import PlannedStep
from bench.yamlfile import Document

Where = tuple[str | int, ...]

# Figure -> the block it comes from; bias stability over a cycle is of the temperature.
_STATIC = ("sigma_min", "Qn", "N", "B", "Krw", "R")
_BLOCKS = {
    **dict.fromkeys(_STATIC, ("static",)),
    "B0": ("static", "temperature", "power_cycles"),
    **dict.fromkeys(("Bt", "B_dT", "B_hys"), ("temperature",)),
    **dict.fromkeys(("K", "F0", "Kn", "Ka", "Kt", "Kr"), ("scale_factor",)),
    **dict.fromkeys(("Br", "t_on"), ("power_cycles",)),
    **dict.fromkeys(("W_th", "W_res", "W_dz"), ("threshold",)),
}
_FEWEST_RATES = 3


def calibration_problems(procedure: ParsedProcedure, plan: Sequence[PlannedStep]) -> Iterator[Problem]:
    """Records and points that the plan does not make, and limits on figures that no block makes."""
    spec = procedure.head.calibration
    if spec is None:
        return
    for where, message in (*_records(spec, plan), *_blocks(spec, plan), *_rates(spec, plan), *_limits(spec)):
        yield Problem(procedure.document.mark(("calibration", *where)), message)


def _named(spec: CalibrationAnalysis) -> Iterator[tuple[Where, str]]:
    """Every place that names a record."""
    if spec.static:
        yield ("static", "record"), spec.static.record
    if spec.temperature and spec.temperature.soaks:
        yield ("temperature", "soaks"), spec.temperature.soaks
    if spec.temperature and spec.temperature.ramps:
        yield ("temperature", "ramps"), spec.temperature.ramps
    if spec.power_cycles:
        yield ("power_cycles", "record"), spec.power_cycles.record


def _made(plan: Sequence[PlannedStep]) -> dict[str, list[Record]]:
    """The records of a plan by the name they were given."""
    made: dict[str, list[Record]] = {}
    for step in plan:
        if step.verb == "record" and isinstance(step.args, Record):
            made.setdefault(step.args.name, []).append(step.args)
    return made


def _records(spec: CalibrationAnalysis, plan: Sequence[PlannedStep]) -> Iterator[tuple[Where, str]]:
    made = _made(plan)
    for where, name in _named(spec):
        if name not in made:
            yield where, f"there is no record '{name}'.{did_you_mean(name, made)}"
    soaks = spec.temperature.soaks if spec.temperature else None
    if soaks and len(made.get(soaks, ())) == 1:
        yield ("temperature", "soaks"), f"one record '{soaks}' is no dependence on temperature. Record three or more."
    if spec.power_cycles and len(made.get(spec.power_cycles.record, ())) == 1:
        where = ("power_cycles", "record")
        yield where, f"one record '{spec.power_cycles.record}' has no repeatability. The standard asks for 6 or more."


def _blocks(spec: CalibrationAnalysis, plan: Sequence[PlannedStep]) -> Iterator[tuple[Where, str]]:
    """Averaging times that are no whole number of rows."""
    made = _made(plan)
    wanted: list[tuple[Where, str, float]] = []
    if spec.static:
        wanted += [(("static", "blocks", k), spec.static.record, one) for k, one in enumerate(spec.static.blocks_s)]
    if spec.temperature and spec.temperature.ramps:
        wanted.append((("temperature", "average"), spec.temperature.ramps, spec.temperature.average_s))
    for where, name, block_s in wanted:
        for record in made.get(name, ())[:1]:
            rows = block_s / record.every_s
            if round(rows) < 1 or abs(rows - round(rows)) > 1e-6:
                every = f"record '{name}' has a row every {record.every_s:g} s"
                yield where, f"{block_s:g} s is no whole number of rows: {every}."


def _rates(spec: CalibrationAnalysis, plan: Sequence[PlannedStep]) -> Iterator[tuple[Where, str]]:
    """A rate set needs three rates in each direction at one temperature."""
    if spec.scale_factor is None:
        return
    by_dwell: dict[int, set[float]] = {}
    for step in plan:
        if step.point is not None and step.rate_dps:
            by_dwell.setdefault(step.dwell, set()).add(step.rate_dps)
    for rates in by_dwell.values():
        if min(sum(rate > 0.0 for rate in rates), sum(rate < 0.0 for rate in rates)) >= _FEWEST_RATES:
            return
    yield (
        ("scale_factor",),
        f"no temperature has points at {_FEWEST_RATES} rates in each direction; GJB 2426A asks for 11 or more.",
    )


def _limits(spec: CalibrationAnalysis) -> Iterator[tuple[Where, str]]:
    for index, limit in enumerate(spec.limits):
        name = "temperature" if limit.figure.startswith("BsT") else "static"
        blocks = _BLOCKS.get(limit.figure, (name,))
        if not any(getattr(spec, block) for block in blocks):
            needed = " or ".join(f"'{block}:'" for block in blocks)
            yield ("limits", index, "figure"), f"{limit.figure} is not made: that takes a block {needed}."


def calibration_site_problems(
    procedure: ParsedProcedure, plan: Sequence[PlannedStep], site: Site, document: Document
) -> Iterator[Problem]:
    """A bias needs the latitude; a threshold scan must pass through zero there."""
    spec = procedure.head.calibration
    if spec is None or not (spec.static or spec.temperature or spec.power_cycles or spec.threshold):
        return
    if site.latitude_deg is None:
        message = "a bias is known only where the earth's rotation is: say the latitude, e.g. site: {latitude: 40 deg}."
        yield Problem(document.mark(("site",)), message)
    elif spec.threshold:
        earth = earth_rate_dps(site.latitude_deg)
        inputs = [step.rate_dps + earth for step in plan if step.point is not None and step.rate_dps is not None]
        inside = [one for one in inputs if abs(one) <= spec.threshold.span_dps]
        if not (any(one > 0.0 for one in inside) and any(one < 0.0 for one in inside) and len(inside) >= _FEWEST_RATES):
            message = (
                f"no scan through zero: within ± {spec.threshold.span_dps * 3600.0:g} deg/h of it are {len(inside)} "
                f"points, on both sides needed. At latitude {site.latitude_deg:g} deg it lies at a table rate of "
                f"{-earth * 3600.0:.4f} deg/h."
            )
            yield Problem(procedure.document.mark(("calibration", "threshold")), message)
