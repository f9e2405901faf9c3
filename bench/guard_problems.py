"""Guards whose signal this bench can never give: told before hour 0 and not by a run that ends at its first step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.benchfile import Bench
from bench.errors import Problem
from bench.procedure.conditions import Guard
from bench.procedure.parse import ParsedProcedure
from bench.yamlfile import Document


def guard_problems(procedure: ParsedProcedure | None, bench: Bench) -> Iterator[Problem]:
    """The guards of the bench file, and those of a procedure, that would have tripped from the beginning.

    Those on DUTs always have a signal to wait for: a bench has at least one.
    """
    yield from _of(bench.file.guards, bench.document, bench)
    if procedure:
        yield from _of(procedure.head.guards, procedure.document, bench)


def _of(guards: Sequence[Guard], document: Document, bench: Bench) -> Iterator[Problem]:
    for number, guard in enumerate(guards):
        if (message := _unheard(guard, bench)) is not None:
            yield Problem(document.mark(("guards", number, "watch")), f"guard '{guard.name}': {message}")


def _unheard(guard: Guard, bench: Bench) -> str | None:
    """Why there is nothing to watch."""
    if guard.watch.startswith("chamber_") and bench.chamber is None:
        return "this bench has no chamber. Leave the guard out, or add one to the bench file."
    if guard.watch in ("rate", "table_fault") and bench.rate_table is None:
        return "this bench has no rate table. Leave the guard out, or add one to the bench file."
    if guard.watch == "chamber_door" and bench.chamber is not None:
        if not hasattr(bench.chamber.driver_class, "door_open"):
            return f"the driver '{bench.chamber.driver}' cannot tell whether the chamber's door is open."
        if not getattr(bench.chamber.settings, "tells_of_door", True):
            return (
                "nothing tells whether the chamber's door is open. Say in the chamber's settings what does, e.g. "
                "door_register: 106."
            )
    return None
