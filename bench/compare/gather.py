"""Figures of many models over many seeds: same points, same splits, medians and worst cases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.analyses.models import INPUT_COLUMNS, model_factories
from bench.clock import stopwatch
from bench.compare.cycles import compare_cycles
from bench.compare.line import Line, Tell, parameters_of, predict_us
from bench.errors import UserMistake
from bench.journal import Entry, load_journal
from bench.points import points_of, usable
from bench.procedure.analyses import Analysis, CycleAnalysis, Splits
from bench.refit import head_of_run
from bench.series import finished_series
from fitting.splits import SplitPlan
from fitting.validation import UNCOMPENSATED, evaluate


def compare(folders: Sequence[Path], models: Sequence[str], seeds: int, tell: Tell = lambda text: None) -> list[Line]:
    """Judge `models` (none named: those of each run's procedure) on the points of every DUT of every run.

    Seed k draws another random split, deals the temperatures to other folds and starts random models anew. Raises
    UserMistake for a run without points, or an unknown model.
    """
    lines: list[Line] = []
    for folder in folders:
        entries = load_journal(folder / "journal.jsonl")
        head = head_of_run(folder, entries)
        analysis, points = head.analysis, points_of(entries)
        if points.empty and head.cycles is not None:
            lines += _of_cycles(folder, entries, head.cycles, models, seeds, tell)
            continue
        if points.empty:
            raise UserMistake(
                f"{folder}: it has no points and no cycles to compare models on. Give runs of a temperature x rate "
                "grid, or of thermal cycles."
            )
        names = list(models) or (analysis.models if analysis else [])
        if not names:
            raise UserMistake(f"{folder}: its procedure names no models. Name them: --models linear,ts_joint")
        model_factories(names)
        for dut in entries[0]["duts"]:
            lines += _of_dut(folder.name, str(dut), usable(points, dut), names, analysis, seeds, tell)
    return lines


def _of_cycles(
    folder: Path, entries: Sequence[Entry], spec: CycleAnalysis, models: Sequence[str], seeds: int, tell: Tell
) -> list[Line]:
    asked = spec.model_copy(update={"models": list(models)}) if models else spec
    return list(compare_cycles(folder, finished_series(entries), list(entries[0]["duts"]), asked, seeds, tell))


def _of_dut(
    run: str, dut: str, table: pd.DataFrame, names: Sequence[str], analysis: Analysis | None, seeds: int, tell: Tell
) -> Iterator[Line]:
    splits = analysis.splits if analysis else Splits()
    inputs = analysis.inputs if analysis else ["dut_temperature", "rate"]
    X = table[[INPUT_COLUMNS[name] for name in inputs]].to_numpy(dtype=np.float64)
    for name in names:
        tell(f"{run}, {dut}: {name}")
        factory = model_factories([name])
        judged = [
            evaluate(
                factory,
                X,
                table["rate_reference_dps"].to_numpy(dtype=np.float64),
                u=table["rate_mean_u_dps"].to_numpy(dtype=np.float64),
                groups=pd.factorize(table["chamber_setpoint_degc"])[0],
                splits=SplitPlan(
                    splits.random.share,
                    splits.random.train,
                    splits.random.seed + seed,
                    splits.leave_temperatures_out.folds,
                    "interleaved" if seed == 0 else "seeded",
                ),
                seed=seed,
                timer=stopwatch,
            )
            for seed in range(seeds)
        ]
        fitted = judged[0].fitted[name]
        about = (predict_us(fitted, X), parameters_of(fitted))
        if name == names[0]:
            yield from _lines(run, dut, UNCOMPENSATED, [one.metrics[UNCOMPENSATED] for one in judged], (None, None))
        yield from _lines(run, dut, name, [one.metrics[name] for one in judged], about)


def _lines(
    run: str, dut: str, model: str, metrics: Sequence[Any], about: tuple[float | None, int | None]
) -> Iterator[Line]:
    for split in metrics[0]:
        found = [one[split] for one in metrics if split in one]
        fits = [one["fit_s"] for one in found if one["fit_s"] is not None]
        guarded = [one["guarded"] for one in found if one.get("guarded") is not None]
        yield Line(
            run,
            dut,
            model,
            split,
            np.array([one["std_dps"] for one in found]),
            np.array([one["max_abs_dps"] for one in found]),
            float(np.median([one["floor_dps"] for one in found])),
            int(found[0]["n"]),
            float(np.median(fits)) if fits else None,
            *about,
            max(guarded) if guarded else None,
        )
