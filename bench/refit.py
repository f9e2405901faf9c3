"""Analyse or show an old run again from what is on disk (law 7)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.analyses.models import model_factories
from bench.conclude import ReportWriter, RunEnd, conclude, failure_of
from bench.errors import InvalidFiles, UserMistake
from bench.journal import Entry, load_journal
from bench.overrides import editor, parse_overrides
from bench.procedure.language import ProcedureHead
from bench.procedure.parse import parse_procedure


def refit(folder: Path, models: Sequence[str], write_report: ReportWriter | None = None) -> RunEnd:
    """Fit the models of the run's procedure, or those named, and write metrics, models and report anew."""
    entries = load_journal(folder / "journal.jsonl")
    head = head_of_run(folder, entries)
    model_factories(models)
    if not (head.analysis or head.cycles or head.calibration or models):
        raise UserMistake(f"{folder}: its procedure has no 'analysis' block. Name what to fit: --model ts_joint")
    return conclude(folder, head, failure_of(entries), write_report, models)


def complete(folder: Path) -> None:
    """Give a run that died what a run that ended has: points, fit, manifest; nothing if it has them."""
    if not (folder / "manifest.json").is_file():
        entries = load_journal(folder / "journal.jsonl")
        conclude(folder, head_of_run(folder, entries), failure_of(entries))


def head_of_run(folder: Path, entries: Sequence[Entry]) -> ProcedureHead:
    """The blocks of the procedure a run was made with, from its copy. Raises InvalidFiles."""
    overrides = parse_overrides(entries[0].get("overrides", []))
    procedure, problems = parse_procedure(
        folder / "procedure.yaml", editor(overrides, "procedure"), follow_includes=False
    )
    if procedure is None:
        raise InvalidFiles(problems)
    return procedure.head
