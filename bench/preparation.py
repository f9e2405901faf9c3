"""Before hour 0: a run is checked, rehearsed and named, with neither hardware nor results touched."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.check import Checked, check
from bench.clock import utc_now
from bench.composition import seed_of
from bench.errors import UserMistake
from bench.forecast import Forecast, rehearse
from bench.missing import Missing
from bench.overrides import Override
from bench.resumption import Interruption
from bench.runfolder import new_run_folder


@dataclass(frozen=True)
class RunRequest:
    """What the user asked for."""

    procedure: Path
    bench: Path
    results: Path
    run_id: str | None = None
    seed: int | None = None
    overrides: Sequence[Override] = ()


@dataclass(frozen=True)
class Resumed:
    """The earlier part of a run that goes on: where it stopped, for how long it stood, and which attempt this is.

    missing: of a run whose plan was carried out, what alone is measured now. may_be_absent: DUTs that were lost when it
    stopped. may_be_off: it goes on where the DUTs are to be without power.
    """

    stop: Interruption
    gap_s: float
    attempt: int
    accepted: str = ""
    missing: Missing | None = None
    may_be_absent: Collection[str] = ()
    may_be_off: bool = False

    @property
    def duts(self) -> Collection[str] | None:
        """The only DUTs that are opened; None: all."""
        return None if self.missing is None else self.missing.duts


@dataclass(frozen=True)
class Prepared:
    """A run that may begin or go on: checked, rehearsed, named; nothing was touched yet."""

    folder: Path
    checked: Checked
    seed: int
    forecast: Forecast
    overrides: Sequence[Override] = ()
    resumed: Resumed | None = None


def prepare(request: RunRequest) -> Prepared:
    """Check and rehearse a run. Raises UserMistake; touches neither hardware nor results."""
    checked = check(request.procedure, request.bench, request.overrides)
    run_id = request.run_id
    if run_id is None:
        run_id = f"{checked.head.procedure}-{utc_now().replace('-', '').replace(':', '')}"
    folder = new_run_folder(request.results, run_id)
    _check_disk(request.results, checked.disk_bytes)
    seed = request.seed if request.seed is not None else seed_of(checked.bench)
    return Prepared(folder, checked, seed, rehearse(checked, seed), request.overrides)


def _check_disk(results: Path, needed: float) -> None:
    existing = next(path for path in (results, *results.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if free < needed:
        raise UserMistake(
            f"{results}: {free / 1e9:.1f} GB are free, the run needs about {needed / 1e9:.1f} GB. Free space, choose "
            "another folder with --results, or keep less with --set procedure.raw=samples (or none)."
        )
