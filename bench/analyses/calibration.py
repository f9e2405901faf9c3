"""The figures a laboratory reports: made after the run from records and points, with the conditions beside them."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from bench.analyses.calibration_lab import Found, Lab
from bench.analyses.calibration_parts import power_cycles, scale_factor, small, static
from bench.analyses.calibration_records import GAP_RULE, OUTLIER_RULE
from bench.analyses.calibration_temperature import temperature
from bench.analyses.context import Analysed, Context, Judged
from bench.procedure.calibration import CalibrationAnalysis, figure_unit
from bench.rawstore import RawFileDamaged
from bench.series import SeriesIncomplete

NAME = "calibration"
_RULES = ("settle", "soak", "ramp_temperature", "set_temperature")


def analyse(context: Context) -> Analysed:
    """State the figures of every DUT; nothing without a `calibration` block."""
    spec = context.head.calibration
    if spec is None:
        return Analysed()
    document: dict[str, Any] = {}
    notes: list[str] = []
    for dut in context.duts:
        found = figures_of(context, dut, spec)
        notes += [f"{dut}: {note}" for note in found.notes]
        document[dut] = document_of(context, dut, spec, found)
    judged = judge_limits(spec, document, context.duts)
    return Analysed(judged=judged, notes=notes, documents={NAME: document})


def figures_of(context: Context, dut: str, spec: CalibrationAnalysis) -> Found:
    """What the blocks ask for of one DUT; what cannot be had is noted."""
    found = Found()
    site = context.site.get("latitude_deg"), context.site.get("azimuth_deg")
    lab = Lab(context.recorded, dut, spec, context.points, context.series, *site)
    parts: tuple[tuple[str, Any, Callable[..., None]], ...] = (
        ("static", spec.static, static),
        ("temperature", spec.temperature, temperature),
        ("power_cycles", spec.power_cycles, power_cycles),
        ("threshold", spec.threshold, small),
    )
    if spec.scale_factor is not None:
        wanted, repeats = spec.scale_factor, spec.power_cycles
        _part("scale_factor", partial(scale_factor, lab, wanted, repeats, found), found)
    for name, block, make in parts:
        if block is not None:
            _part(name, partial(make, lab, block, found), found)
    return found


def _part(name: str, make: Callable[[], None], found: Found) -> None:
    try:
        make()
    except (ValueError, SeriesIncomplete, RawFileDamaged, OSError) as error:
        found.notes.append(f"{name.replace('_', ' ')}: {error}")


def document_of(context: Context, dut: str, spec: CalibrationAnalysis, found: Found) -> dict[str, Any]:
    """What is written for one DUT."""
    return {
        "conditions": conditions_of(context, dut, spec),
        "figures": [one.record() for one in found.stated],
        "tables": found.tables,
        "budgets": found.budgets,
    }


def conditions_of(context: Context, dut: str, spec: CalibrationAnalysis) -> dict[str, Any]:
    """What stands beside every figure and is the same for all (gyro test metrics, section 11)."""
    head = _head(context.folder)
    bench = spec.bench
    return {
        "dut": dut,
        "run_id": context.run_id,
        "output_unit": "deg/s",
        "input_axis": "along the table's axis, up; counter-clockwise positive",
        "latitude_deg": context.site.get("latitude_deg"),
        "latitude_from": "bench file",
        "half_widths": {
            "table_ppm": bench.table_ppm,
            "latitude_deg": bench.latitude_deg,
            "tilt_arcmin": 60.0 * bench.tilt_deg,
            "temperature_k": bench.temperature_k,
            "stated": sorted(bench.model_fields_set),
        },
        "outlier_rule": OUTLIER_RULE,
        "gap_rule": GAP_RULE,
        "rules": list(dict.fromkeys(_rules(context.head.steps))),
        "clock_reference": "the DUT's own frames at its nominal data rate; the table's rate on the table's own clock",
        "table_rate": "as commanded; measured rate within the settling band",
        "versions": head.get("versions", {}),
        "raw_data": raw_hash(context.recorded, dut),
    }


def _head(folder: Path) -> Mapping[str, Any]:
    """The head record of the journal: its first line, behind the checksum."""
    with (folder / "journal.jsonl").open("rb") as file:
        found: Mapping[str, Any] = json.loads(file.readline()[9:])
    return found


def _rules(steps: Sequence[Any]) -> Iterator[str]:
    """How temperature and rate were brought to rest, as the procedure has it."""
    for step in steps:
        for verb, args in step.items() if isinstance(step, Mapping) else ():
            if verb in _RULES:
                text = yaml.safe_dump(args, default_flow_style=True, width=200).strip()
                yield f"{verb}: {text.removesuffix('...').strip()}"
            if isinstance(args, Mapping) and isinstance(args.get("steps"), list):
                if "ramp" in args:
                    yield f"{verb}: ramp {args['ramp']}"
                yield from _rules(args["steps"])


def raw_hash(folder: Path, dut: str) -> dict[str, Any]:
    """Hash over the names and bytes of a DUT's raw files, in the order of their names."""
    digest = hashlib.sha256()
    mine = re.compile(rf"[pr]\d+-{re.escape(dut)}(-\d{{5}}\.(samples|frames))?\.parquet")
    files = sorted(path for path in (folder / "raw").glob("*.parquet") if mine.fullmatch(path.name))
    for path in files:
        with path.open("rb") as file:
            digest.update(f"{path.name} {hashlib.file_digest(file, 'sha256').hexdigest()}\n".encode())
    return {"files": len(files), "sha256": digest.hexdigest() if files else None}


def judge_limits(spec: CalibrationAnalysis, document: Mapping[str, Any], duts: Sequence[str]) -> list[Judged]:
    """Hold the limits against the largest magnitude of each figure of every DUT."""
    judged = []
    for limit in spec.limits:
        measured = {dut: largest(document.get(dut, {}), limit.figure) for dut in duts}
        what = f"{limit.figure} in {figure_unit(limit.figure)}"
        judged.append(Judged(NAME, "figures", what, limit.value, measured))
    return judged


def largest(document: Mapping[str, Any], symbol: str) -> float | None:
    """The largest magnitude of a figure; None if it was not measured."""
    values = [one["value"] for one in document.get("figures", ()) if one["symbol"] == symbol]
    found = [abs(value) for value in values if value is not None]
    return max(found) if found and len(found) == len(values) else None
