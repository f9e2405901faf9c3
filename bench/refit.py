"""Analyse an old run again from what is on disk (law 7)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bench.analysis import model_factories
from bench.errors import InvalidFiles, UserMistake
from bench.journal import read_journal
from bench.overrides import editor, parse_overrides
from bench.procedure.language import Analysis
from bench.procedure.parse import parse_procedure
from bench.run import RunEnd, failure_of, finish


def refit(folder: Path, models: Sequence[str], write_report: Callable[[Path], Any] | None = None) -> RunEnd:
    """Fit the models of the run's procedure, or those named, and write metrics, models and report anew."""
    entries = list(read_journal(folder / "journal.jsonl"))
    analysis = _analysis(folder, entries[0].get("overrides", []))
    if models:
        model_factories(models)
        chosen = {"models": list(models)}
        if analysis:
            kept = [limit for limit in analysis.limits if limit.model in models]
            analysis = analysis.model_copy(update={**chosen, "limits": kept})
        else:
            analysis = Analysis.model_validate(chosen)
    if analysis is None:
        raise UserMistake(f"{folder}: its procedure has no 'analysis' block. Name what to fit: --model ts_joint")
    return finish(folder, analysis, failure_of(entries), write_report)


def _analysis(folder: Path, overrides: Sequence[str]) -> Analysis | None:
    procedure, problems = parse_procedure(
        folder / "procedure.yaml", editor(parse_overrides(overrides), "procedure"), follow_includes=False
    )
    if procedure is None:
        raise InvalidFiles(problems)
    return procedure.head.analysis
