"""What a test gets to look at: a run on a virtual bench, a check, a dry run."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from bench.analyses.context import Judged
from bench.conclude import RunEnd
from bench.errors import FogbenchError
from bench.journal import Entry, load_journal
from bench.resume import prepare_resume
from bench.run import TRUTH_FOLDER, run

if TYPE_CHECKING:
    import pandas as pd

P = ParamSpec("P")
R = TypeVar("R")


def readable(function: Callable[P, R]) -> Callable[P, R]:
    """An error of the product ends in the test's own line, with the paragraph that the command line would print."""

    @wraps(function)
    def surfaced(*args: P.args, **kwargs: P.kwargs) -> R:
        __tracebackhide__ = True
        try:
            return function(*args, **kwargs)
        except FogbenchError as error:
            raise error.with_traceback(None) from None

    return surfaced


@dataclass(frozen=True)
class CheckedPlan:
    """A procedure that passed its check on a bench: what a run of it takes."""

    steps: int
    points: int
    duts: Sequence[str]
    duration_s: float
    disk_bytes: float


@dataclass(frozen=True)
class DryRun:
    """A rehearsal on a healthy bench. `failure` says what would go wrong, or is None; `timeline` as in --json."""

    duration_s: float
    steps: int
    points: int
    warnings: Sequence[str]
    failure: str | None
    timeline: Sequence[dict[str, Any]]


@dataclass(frozen=True)
class VirtualRun:
    """A run on a virtual bench that came to its end, whatever the outcome."""

    end: RunEnd

    @property
    def outcome(self) -> str:
        """PASS, FAIL, ERROR or ABORTED."""
        return self.end.outcome

    @property
    def exit_code(self) -> int:
        """What `fogbench run` would end with: 0, 1, 3 or 130."""
        return int(self.end.exit_code)

    @property
    def message(self) -> str:
        """Why it ended so."""
        return self.end.message

    @property
    def folder(self) -> Path:
        """The run folder."""
        return self.end.folder

    @property
    def metrics(self) -> dict[str, Any]:
        """DUT, model, split, figure; as in metrics.json."""
        return self.end.metrics

    @property
    def limits(self) -> Sequence[Judged]:
        """The limits of the procedure as judged: model, split, quantity, limit, measured, passed."""
        return self.end.limits

    @property
    def manifest(self) -> dict[str, Any]:
        """manifest.json."""
        return self.end.manifest

    @property
    def events(self) -> list[dict[str, Any]]:
        """What the report lists as events: {t_s, kind, text}."""
        events: list[dict[str, Any]] = self.manifest["events"]
        return events

    @property
    def losses(self) -> dict[str, dict[str, int]]:
        """What the receivers counted over the whole run, by DUT: frames, lost, duplicates, bad_checksum and so on."""
        losses: dict[str, dict[str, int]] = self.manifest["data_quality"]
        return losses

    @cached_property
    def points(self) -> pd.DataFrame:
        """points.csv: a row for each point and DUT."""
        return self._table("points")

    @cached_property
    def timeline(self) -> pd.DataFrame:
        """timeline.parquet: a row for each readback."""
        return self._table("timeline")

    @cached_property
    def journal(self) -> list[Entry]:
        """All records of the journal."""
        return load_journal(self.folder / "journal.jsonl")

    @cached_property
    def faults(self) -> list[dict[str, Any]]:
        """What the simulators truly did wrong: the records of their fault logs, of all attempts."""
        logs = sorted((self.folder.parent / TRUTH_FOLDER / self.folder.name).rglob("faults.jsonl"))
        records = [json.loads(line) for log in logs for line in log.read_text(encoding="utf-8").splitlines()]
        # A record without a place in the bench file is none of a fault: frames that the host threw away unread.
        return [record for record in records if record["number"] >= 0]

    @cached_property
    def report(self) -> Path:
        """report.html, written when it is first asked for."""
        from bench.report.render import write_report

        write_report(self.folder)
        return self.folder / "report.html"

    @readable
    def resume(self, accept: Sequence[str] = ()) -> VirtualRun:
        """Take the run up again, as `fogbench resume` does. Raises UserMistake."""
        return VirtualRun(run(prepare_resume(self.folder, accept)))

    def _table(self, name: str) -> pd.DataFrame:
        import pandas as pd

        return pd.read_parquet(self.folder / f"{name}.parquet")

    def __repr__(self) -> str:
        """What pytest shows beside an assertion that failed."""
        name = self.manifest["procedure"]["name"]
        return f"<{name}: {self.outcome} ({self.exit_code}): {self.message} [{self.folder}]>"
