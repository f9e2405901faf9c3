"""The figures of any run: those its calibration block made, or what the data of a run without one allow."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.analyses.calibration import NAME, document_of, figures_of
from bench.analyses.calibration_points import rate_sets
from bench.analyses.context import Context
from bench.errors import FogbenchError, UserMistake, did_you_mean
from bench.journal import Entry, load_journal
from bench.points import points_of
from bench.procedure.calibration import CalibrationAnalysis
from bench.refit import head_of_run
from bench.series import finished_series, read_parts

# A record is taken as one at rest if the DUT's temperature stays within this, and has rows for this long.
AT_REST_K = 2.0
LONG_ENOUGH_S = 600.0
_FIGURE = ("symbol", "name", "value", "unit", "u", "low", "high", "n", "at", "definition", "source", "conditions")
_CONDITIONS = ("outlier_rule", "gap_rule", "latitude_deg", "half_widths", "raw_data", "input_axis")
_BLOCKS_S = (1.0, 10.0, 100.0)


@dataclass(frozen=True)
class Calibrated:
    """A run and its figures: documents by DUT, as in analyses/calibration.json.

    asked: whether the procedure has a calibration block; without one nothing was judged. notes: what could not be made.
    """

    folder: Path
    run_id: str
    head: Entry
    spec: CalibrationAnalysis
    documents: Mapping[str, Mapping[str, Any]]
    asked: bool
    notes: Sequence[str]

    @property
    def limits(self) -> dict[str, float]:
        """Figure -> the limit of the procedure."""
        return {limit.figure: limit.value for limit in self.spec.limits}


def calibrated(folder: Path, dut: str | None = None) -> Calibrated:
    """The figures of a run, of one DUT or all. Raises UserMistake if none can be had, or what reading raises."""
    entries = load_journal(folder / "journal.jsonl")
    context = context_of(folder, entries)
    duts = chosen(context.duts, dut)
    asked = context.head.calibration
    if asked is not None:
        return _stated(context, entries, duts, asked)
    documents, notes = {}, []
    spec: CalibrationAnalysis | None = None
    for name in duts:
        guessed = guess(context, name)
        if guessed is None:
            notes.append(
                f"{name}: no record at rest of {LONG_ENOUGH_S:g} s or more, and no rate set of 3 rates each way"
            )
            continue
        spec = guessed
        found = figures_of(context, name, guessed)
        documents[name] = document_of(context, name, guessed, found)
        notes += [f"{name}: {note}" for note in found.notes]
    if spec is None:
        raise UserMistake(
            f"{folder}: no figures can be made: {'; '.join(notes)}. Run one of procedures/static.yaml, "
            "scale_factor.yaml, temperature_ramps.yaml, power_cycles.yaml, threshold.yaml."
        )
    return Calibrated(folder, context.run_id, entries[0], spec, documents, False, notes)


def _stated(context: Context, entries: Sequence[Entry], duts: Sequence[str], spec: CalibrationAnalysis) -> Calibrated:
    """The figures the procedure asked for: from the run folder, or made now if the run never came to its end."""
    path = context.folder / "analyses" / f"{NAME}.json"
    notes: list[str] = []
    if path.is_file():
        try:
            written = json.loads(path.read_text(encoding="utf-8"))
            documents = {name: _whole(written[name]) for name in duts}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise FogbenchError(
                f"{path}: this is not what fogbench wrote ({error!r}). Make it again: fogbench fit {context.folder}"
            ) from error
    else:
        documents = {}
        for name in duts:
            found = figures_of(context, name, spec)
            documents[name] = document_of(context, name, spec, found)
            notes += [f"{name}: {note}" for note in found.notes]
    return Calibrated(context.folder, context.run_id, entries[0], spec, documents, True, notes)


def _whole(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """A document with all its parts; KeyError or TypeError without."""
    parts = [(one, _FIGURE) for one in document["figures"]]
    for part, keys in (*parts, (document["conditions"], _CONDITIONS), (document, ("tables", "budgets"))):
        missing = [key for key in keys if key not in part]
        if missing:
            raise KeyError(missing[0])
    return document


def context_of(folder: Path, entries: Sequence[Entry]) -> Context:
    """A run on disk as an analysis takes it; nothing is written."""
    head = head_of_run(folder, entries)
    duts, site = list(entries[0]["duts"]), entries[0].get("site", {})
    points, series = points_of(entries), finished_series(entries)
    return Context(folder, folder, head, str(entries[0]["run_id"]), duts, points, series, (), site)


def chosen(duts: Sequence[str], dut: str | None) -> list[str]:
    """The DUT that was named, or all. Raises UserMistake for one that was not measured."""
    if dut is not None and dut not in duts:
        raise UserMistake(f"there is no DUT '{dut}' in this run.{did_you_mean(dut, duts)}")
    return list(duts) if dut is None else [dut]


def guess(context: Context, dut: str) -> CalibrationAnalysis | None:
    """What can be stated of a run that was not made for it; None if nothing can."""
    blocks: dict[str, Any] = {}
    best = max(_at_rest(context, dut), key=lambda found: found[1], default=None)
    if best is not None:
        about, _ = best
        every = float(about["every_s"])
        # The averaging times of the standards, as far as the rows are whole parts of them.
        usual = [block for block in _BLOCKS_S if abs(block / every - round(block / every)) < 1e-6 and block >= every]
        blocks["static"] = {"record": about["label"], "blocks": [f"{block!r} s" for block in usual or [100.0 * every]]}
    if rate_sets(context.points, dut, 0.0):
        blocks["scale_factor"] = {}
    return CalibrationAnalysis.model_validate(blocks) if blocks else None


def _at_rest(context: Context, dut: str) -> Iterator[tuple[Mapping[str, Any], float]]:
    """Records with the table at rest and the temperature nearly so, each with its length."""
    for about in context.series:
        length_s = about["rows"] * about["every_s"]
        if about["dut"] != dut or about["verdict"] == "fail" or about["rate_setpoint_dps"] or length_s < LONG_ENOUGH_S:
            continue
        temperature = read_parts(context.recorded, about).get("temperature_degc")
        if temperature is not None and float(np.nanmax(temperature) - np.nanmin(temperature)) <= AT_REST_K:
            yield about, length_s
