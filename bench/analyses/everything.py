"""All analyses a procedure asks for, one after the other."""

from __future__ import annotations

from bench.analyses import calibration, cycles, models, north
from bench.analyses.context import Analysed, Context

KINDS = (models.analyse, cycles.analyse, north.analyse, calibration.analyse)


def analyse(context: Context) -> Analysed:
    """Do what the procedure asks for; the metrics are those of the points."""
    done = [kind(context) for kind in KINDS]
    return Analysed(
        done[0].metrics,
        [item for one in done for item in one.judged],
        [note for one in done for note in one.notes],
        any(one.counts for one in done if one.notes),
        {name: document for one in done for name, document in one.documents.items()},
    )
