"""Cycle models of a run compared: the tests of its procedure, random models started anew with every seed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.analyses.cycles import CycleResult, analyse_dut, cycle_models
from bench.compare.line import Line, Tell, parameters_of, predict_us
from bench.procedure.analyses import CycleAnalysis
from fitting.validation import UNCOMPENSATED


def compare_cycles(
    folder: Path, series: Sequence[Mapping[str, Any]], duts: Sequence[str], spec: CycleAnalysis, seeds: int, tell: Tell
) -> Iterator[Line]:
    """A line for every DUT, model and test. Raises UserMistake or ValidationError, as the analysis itself."""
    random = [name for name, model in cycle_models(spec.models).items() if "random_state" in model.make().get_params()]
    for dut in duts:
        tell(f"{folder.name}, {dut}: {', '.join(spec.models)}")
        results = [analyse_dut(folder, series, dut, spec)]
        for seed in range(1, seeds if random else 1):
            results.append(analyse_dut(folder, series, dut, spec.model_copy(update={"models": random, "seed": seed})))
        for model, tests in results[0].judgement.metrics.items():
            for test in tests:
                yield _line(folder.name, dut, model, test, results)


def _line(run: str, dut: str, model: str, test: str, results: Sequence[CycleResult]) -> Line:
    found = [one.judgement.metrics[model][test] for one in results if model in one.judgement.metrics]
    fits = [one["fit_s"] for one in found if one["fit_s"] is not None]
    guarded = [one["guarded"] for one in found if one["guarded"] is not None]
    first = results[0]
    known = model != UNCOMPENSATED
    return Line(
        run,
        dut,
        model,
        test,
        np.array([one["std_dps"] for one in found]),
        np.array([one["max_abs_dps"] for one in found]),
        float(np.median([one["floor_dps"] for one in found])),
        int(found[0]["n"] or 0),
        float(np.median(fits)) if fits else None,
        predict_us(first.judgement.fitted[model], first.inputs[model]) if known else None,
        parameters_of(first.judgement.fitted[model]) if known else None,
        max(guarded) if guarded else None,
    )
