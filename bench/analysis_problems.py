"""What can be known before hour 0 to be wrong with what shall be worked out after the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import entry_points

from bench.bench_entries import Site
from bench.calibration_problems import calibration_problems
from bench.errors import Mark, Problem, did_you_mean
from bench.procedure.analyses import CYCLE_MODELS, SEEKING_POSITIONS_DEG, Analysis, CycleAnalysis
from bench.procedure.language import Record
from bench.procedure.parse import ParsedProcedure
from bench.procedure.plan import PlannedStep
from bench.yamlfile import Document

Where = tuple[str | int, ...]


def model_problems(procedure: ParsedProcedure) -> Iterator[Problem]:
    """Models that are not installed, and limits for models that are not fitted."""
    analysis = procedure.head.analysis
    if analysis is None:
        return
    known = [item.name for item in entry_points(group="fogbench.models")]
    for index, name in enumerate(analysis.models):
        if name not in known:
            mark = procedure.document.mark(("analysis", "models", index))
            yield Problem(mark, f"unknown model '{name}'.{did_you_mean(name, known)}")
    for index, limit in enumerate(analysis.limits):
        if limit.model not in analysis.models:
            mark = procedure.document.mark(("analysis", "limits", index, "model"))
            hint = did_you_mean(limit.model, analysis.models)
            yield Problem(mark, f"the limit is for '{limit.model}', which is not fitted.{hint}")


def analysis_problems(procedure: ParsedProcedure, plan: Sequence[PlannedStep]) -> Iterator[Problem]:
    """What the plan does not give that an analysis needs."""
    if procedure.head.analysis:
        yield from _fit_problems(procedure.head.analysis, procedure, [step for step in plan if step.point is not None])
    yield from _cycle_problems(procedure, plan)
    yield from _north_problems(procedure, plan)
    yield from calibration_problems(procedure, plan)


def _fit_problems(analysis: Analysis, procedure: ParsedProcedure, points: Sequence[PlannedStep]) -> Iterator[Problem]:
    def mark(*path: str | int) -> Mark:
        return procedure.document.mark(("analysis", *path))

    if not points:
        yield Problem(mark(), "there is nothing to analyse: the steps hold no acquire.")
        return
    train = analysis.splits.random.train
    if train is not None and train >= len(points):
        message = f"{train} rows for training, but only {len(points)} points are measured."
        yield Problem(mark("splits", "random", "train"), message)
    folds, dwells = analysis.splits.leave_temperatures_out.folds, len({step.dwell for step in points})
    if dwells < folds and any(limit.split == "leave_temperatures_out" for limit in analysis.limits):
        message = f"a limit needs temperatures left out in {folds} folds, but points are measured at {dwells} only."
        yield Problem(mark("splits", "leave_temperatures_out", "folds"), f"{message} Ask for fewer folds.")
    if any(step.rate_dps is None for step in points):
        yield Problem(
            mark(), "some points have no rate setpoint, so there is no reference to fit to. Set a rate first."
        )


def _cycle_problems(procedure: ParsedProcedure, plan: Sequence[PlannedStep]) -> Iterator[Problem]:
    """Models that are not installed, records that are not made, limits for what is not judged."""
    spec = procedure.head.cycles
    if spec is None:
        return
    known = [item.name for item in entry_points(group=CYCLE_MODELS)]
    labels = [step.record for step in plan if step.verb == "record" and step.record]
    choices = [(where, name, known, "model") for where, name in _models(spec)]
    choices += [(where, name, labels, "record") for where, name in _records(spec)]
    choices += [
        (("limits", k, "model"), limit.model, spec.models, "fitted model") for k, limit in enumerate(spec.limits)
    ]
    tests = [*spec.tests, *spec.halves, "train"]
    choices += [(("limits", k, "test"), limit.test, tests, "test") for k, limit in enumerate(spec.limits)]
    for where, name, allowed, what in choices:
        if name not in allowed:
            mark = procedure.document.mark(("cycles", *where))
            yield Problem(mark, f"there is no {what} '{name}'.{did_you_mean(name, allowed)}")


def _models(spec: CycleAnalysis) -> Iterator[tuple[Where, str]]:
    for index, name in enumerate(spec.models):
        yield ("models", index), name


def _records(spec: CycleAnalysis) -> Iterator[tuple[Where, str]]:
    """Every place that names a record."""
    for index, name in enumerate(spec.train):
        yield ("train", index), name
    for test, names in spec.tests.items():
        for index, name in enumerate(names):
            yield ("tests", test, index), name
    for test, half in spec.halves.items():
        yield ("halves", test, "record"), half.record
    if spec.reference:
        yield ("reference", "record"), spec.reference.record


def _north_problems(procedure: ParsedProcedure, plan: Sequence[PlannedStep]) -> Iterator[Problem]:
    """Records that are not made, and positions that no seeking visits."""
    spec = procedure.head.north
    if spec is None:
        return
    made = [step for step in plan if step.verb == "record" and step.record]
    labels = [str(step.record) for step in made]
    for key in ("seek", "still"):
        name = getattr(spec, key)
        if name not in labels:
            mark = procedure.document.mark(("north", key))
            yield Problem(mark, f"there is no record '{name}'.{did_you_mean(name, labels)}")
    visited = {step.position_deg for step in made if isinstance(step.args, Record) and step.args.name == spec.seek}
    missing = [position for position in SEEKING_POSITIONS_DEG if position not in visited]
    if spec.seek in labels and missing:
        positions = ", ".join(f"{position:g} deg" for position in missing)
        mark = procedure.document.mark(("north", "seek"))
        yield Problem(
            mark, f"no record '{spec.seek}' is made at {positions}. Put it into a position sweep of all four."
        )


def site_problems(procedure: ParsedProcedure, site: Site, document: Document) -> Iterator[Problem]:
    """What an analysis must know of where the bench stands."""
    if procedure.head.north is None:
        return
    missing = [key for key, value in (("latitude", site.latitude_deg), ("azimuth", site.azimuth_deg)) if value is None]
    if missing:
        example = "{latitude: 40 deg, azimuth: 35 deg}"
        message = f"north seeking needs {' and '.join(missing)} under 'site:', e.g. {example}."
        yield Problem(document.mark(("site",)), message)
