"""The `faults:` of a bench file's simulation: a list of named faults, each on one instrument, with its own keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from bench.benchfile import Bench, CanPort, Instrument
from bench.errors import Problem, did_you_mean
from bench.fields import validate_dataclass
from bench.mistakes import sentence
from bench.units import shown
from bench.yamlfile import Path_

FAULTS_PATH: Path_ = ("simulation", "faults")
EXAMPLE = "{name: loss, on: FOG-A01, probability: 1e-5}"

# Name of the fault, instrument it is on ('chamber', 'rate_table', 'supply' or a serial number), and its settings class.
NamedFault = tuple[str, str, Any]


def without_faults(bench: Bench) -> Bench:
    """The same bench in good health."""
    healthy = {key: value for key, value in bench.file.simulation.items() if key != "faults"}
    return dataclasses.replace(bench, file=bench.file.model_copy(update={"simulation": healthy}))


def read_faults(
    bench: Bench,
    known: Mapping[str, type],
    possible: Callable[[Any, bool], list[str]],
    problems: list[Problem],
) -> list[NamedFault]:
    """The faults of a bench file, checked; mistakes go to `problems`, each with its place.

    known: settings dataclass by fault name. possible: the names that an instrument of a role can have, and whether its
    port is a CAN bus.
    """
    written = bench.file.simulation.get("faults")
    if written is None:
        return []
    if not isinstance(written, list):
        message = f"'faults': expected a list of faults, such as - {EXAMPLE}, not {shown(written)}."
        problems.append(Problem(bench.document.mark(FAULTS_PATH), message))
        return []
    read = [_fault(bench, (*FAULTS_PATH, number), known, possible, problems) for number in range(len(written))]
    return [fault for fault in read if fault]


def _fault(
    bench: Bench,
    path: Path_,
    known: Mapping[str, type],
    possible: Callable[[Any, bool], list[str]],
    problems: list[Problem],
) -> NamedFault | None:
    written = bench.file.simulation["faults"][path[-1]]
    if not isinstance(written, dict):
        message = f"a fault is expected here, such as {EXAMPLE}, not {shown(written)}."
        problems.append(Problem(bench.document.mark(path), message))
        return None
    name = _word(bench, path, "name", written, list(known), "fault", problems)
    instruments = {item.name if item.role == "dut" else item.role: item for item in bench.instruments}
    on = _word(bench, path, "on", written, list(instruments), "instrument of this bench", problems)
    if name is None:
        return None
    if on is not None:
        problems += _impossible(bench, path, name, on, instruments[on], possible)
    settings = {key: value for key, value in written.items() if key not in ("name", "on")}
    seen = dataclasses.replace(bench.document, data={path[0]: {path[1]: {path[2]: settings}}})
    fault = validate_dataclass(known[name], seen, path, problems)
    return None if fault is None or on is None else (name, on, fault)


def _word(
    bench: Bench, path: Path_, key: str, written: dict[str, Any], known: list[str], what: str, problems: list[Problem]
) -> str | None:
    """The value of `name` or `on`, one of the known ones; None and a problem if it is not."""
    document, value = bench.document, written.get(key)
    if key not in written:
        problems.append(Problem(document.mark(path), f"the key '{key}' is missing here. Example: {EXAMPLE}"))
        return None
    if not isinstance(value, str) or value not in known:
        message = f"'{key}': {shown(value)} is no {what}.{did_you_mean(str(value), known)}"
        problems.append(Problem(document.mark((*path, key)), sentence(message)))
        return None
    return value


def _impossible(
    bench: Bench, path: Path_, name: str, on: str, item: Instrument, possible: Callable[[Any, bool], list[str]]
) -> list[Problem]:
    can = isinstance(item.port, CanPort)
    allowed = possible(item.role, can)
    if name in allowed:
        return []
    where = "a DUT on a CAN bus" if can else "a DUT" if item.role == "dut" else f"the {item.name}"
    message = f"'{name}' is no fault of {where} ({on}). Allowed: {', '.join(allowed)}."
    return [Problem(bench.document.mark((*path, "name")), message)]
