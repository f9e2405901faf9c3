"""Points that were measured again after the run: which row of a journal counts (a fold; nothing is ever rewritten)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from bench.journal import Entry

Row = dict[str, Any]


def begins_anew(entry: Entry) -> bool:
    """Whether from this journal record on only what was missing or failed is measured."""
    return entry["kind"] == "resumed" and bool(entry.get("missing"))


def joined(parts: Sequence[Sequence[Row]], number: str = "point") -> list[Row]:
    """The rows of a run and of each time that it was taken up for what was missing, in the order of the plan.

    A row replaces one of an earlier part that failed and has the same DUT and `number`. Nothing else is left out: a
    point that was measured twice without need is there twice.
    """
    rows = list(parts[0])
    for part in parts[1:]:
        anew = {(row[number], row["dut"]) for row in part}
        rows = [row for row in rows if row["verdict"] != "fail" or (row[number], row["dut"]) not in anew]
        rows += part
    if len(parts) == 1 and all(one[number] <= after[number] for one, after in pairwise(rows)):
        return rows
    order = {dut: place for place, dut in enumerate(dict.fromkeys(row["dut"] for part in parts for row in part))}
    return sorted(rows, key=lambda row: (row[number], order[row["dut"]]))


def left_to_measure(rows: Sequence[Row], duts: Sequence[str], planned: int) -> dict[str, dict[str, list[int]]]:
    """Per DUT the points that were not measured and those that failed; DUTs that have all of them are left out."""
    verdicts: Mapping[tuple[int, str], str] = {(row["point"], row["dut"]): row["verdict"] for row in rows}
    left: dict[str, dict[str, list[int]]] = {}
    for dut in duts:
        missing = [point for point in range(1, planned + 1) if (point, dut) not in verdicts]
        failed = [point for point in range(1, planned + 1) if verdicts.get((point, dut)) == "fail"]
        if missing or failed:
            left[dut] = {"not_measured": missing, "failed": failed}
    return left


def ranges(numbers: Sequence[int]) -> str:
    """Rising numbers in short.

    >>> ranges([1, 2, 3, 7, 9, 10])
    '1-3, 7, 9-10'
    """
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)
