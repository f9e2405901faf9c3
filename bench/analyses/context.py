"""What an analysis is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.procedure.language import ProcedureHead

if TYPE_CHECKING:
    import pandas as pd

Metrics = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Judged:
    """One limit against what was measured; a figure that could not be measured has not passed."""

    model: str
    split: str
    quantity: str
    limit: float
    measured: dict[str, float | None]

    @property
    def passed(self) -> bool:
        """Whether every DUT is within the limit."""
        return bool(self.measured) and all(v is not None and v <= self.limit for v in self.measured.values())


@dataclass(frozen=True)
class Context:
    """A run that ended, as its journal has it.

    folder: where results are written. recorded: the run folder with the raw files. series: what the journal says of the
    finished records. models: names asked for instead of the procedure's, none if empty. site: latitude_deg and
    azimuth_deg, None if not known.
    """

    folder: Path
    recorded: Path
    head: ProcedureHead
    run_id: str
    duts: Sequence[str]
    points: pd.DataFrame
    series: Sequence[Mapping[str, Any]]
    models: Sequence[str] = ()
    site: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Analysed:
    """What an analysis found.

    metrics: DUT -> model -> split -> figures, as in metrics.json. judged: limits. notes: what could not be done and
    why; they fail the run if `counts`, that is, if the procedure asked for the analysis. documents: name -> what is
    written to analyses/<name>.json.
    """

    metrics: Metrics = field(default_factory=dict)
    judged: Sequence[Judged] = ()
    notes: Sequence[str] = ()
    counts: bool = True
    documents: dict[str, Any] = field(default_factory=dict)
