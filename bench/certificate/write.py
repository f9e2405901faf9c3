"""From a run folder to certificate-<dut>.html, .pdf and .json in it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.analyses.calibration import raw_hash
from bench.certificate.compensated import Compensated, compensated
from bench.certificate.content import Page, page_of
from bench.certificate.gather import Calibrated, calibrated, chosen, context_of
from bench.certificate.html import html
from bench.certificate.pdf import pdf
from bench.errors import UserMistake
from bench.journal import load_journal
from bench.procedure.calibration import BenchUncertainty, CalibrationAnalysis
from bench.report.manifest import Manifest
from bench.runfolder import write_atomic, write_json
from fitting.strict_json import read_object


@dataclass(frozen=True)
class Written:
    """The files of one certificate, and what stands on it."""

    page: Page
    files: Sequence[Path]
    document: Mapping[str, Any]


def write_certificate(folder: Path, dut: str, model: str | None) -> Written:
    """Make the certificate of a DUT. Raises UserMistake where there is nothing to certify."""
    if not (folder / "manifest.json").is_file():
        raise UserMistake(
            f"{folder}: this run has not ended; a certificate is of one that has. See: fogbench resume {folder}"
        )
    manifest = Manifest.from_mapping(read_object(folder / "manifest.json"), folder.name)
    entries = load_journal(folder / "journal.jsonl")
    context = context_of(folder, entries)
    chosen(context.duts, dut)
    found = None
    if model is not None:
        latitude = context.site.get("latitude_deg")
        found = compensated(folder, context.points, dut, model, _bench(context.head.calibration), latitude)
    figures = _figures(folder, dut, required=found is None)
    raw = raw_hash(folder, dut)
    document = None if figures is None else figures.documents.get(dut)
    limits = {} if figures is None else figures.limits
    page = page_of(dut, manifest, document, limits, found, raw["sha256"])
    stated = {
        "dut": dut,
        "run_id": manifest.run_id,
        "outcome": manifest.outcome,
        "virtual": manifest.virtual,
        "facts": dict(page.facts),
        "raw_data": raw,
        "calibration": document,
        "compensated": None if found is None else compensated_record(found),
    }
    files = [folder / f"certificate-{dut}.{kind}" for kind in ("html", "pdf", "json")]
    write_atomic(files[0], html(page).encode("utf-8"))
    write_atomic(files[1], pdf(page))
    write_json(files[2], stated)
    return Written(page, files, json.loads(files[2].read_text(encoding="utf-8")))


def _bench(spec: CalibrationAnalysis | None) -> BenchUncertainty:
    """What the procedure says of its bench; without it what is usual."""
    return BenchUncertainty.model_validate({}) if spec is None else spec.bench


def _figures(folder: Path, dut: str, required: bool) -> Calibrated | None:
    """The calibration figures; not needed where a model is certified."""
    try:
        return calibrated(folder, dut)
    except UserMistake:
        if required:
            raise
        return None


def compensated_record(found: Compensated) -> dict[str, Any]:
    """Every compensated point with its whole budget, as plain values."""
    return {
        "model": found.model,
        "split": found.split,
        "residual_std_dps": found.residual_dps,
        "points": [
            {
                "chamber_setpoint_degc": one.setpoint_degc,
                "temperature_degc": one.temperature_degc,
                "rate_dps": one.rate_dps,
                "error_dph": one.error_dph,
                "u_dph": one.budget.u_dph,
                "dof": one.budget.dof,
                "k": one.budget.k,
                "expanded_dph": one.budget.expanded_dph,
                "contributions_dph": {row.source: row.contribution_dph for row in one.budget.rows},
            }
            for one in found.points
        ],
    }
