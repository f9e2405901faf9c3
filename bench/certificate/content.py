"""What stands on the certificate of one DUT: text and tables, before it is HTML or PDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.analyses.calibration_lab import budget_record
from bench.analyses.calibration_words import digits, expanded_of, value_of
from bench.certificate.compensated import Compensated, by_temperature
from bench.report.formats import significant
from bench.report.manifest import Manifest
from bench.units import counted, format_duration
from fitting.metrics.figure import Figure

# As many rows as fit on a page of A4 beside the budgets: beyond it, figures of the same kind are drawn together.
MOST_FIGURES = 26
# Of these the range is the statement; of all others the largest magnitude.
SIGNED = ("K", "F0", "B0", "B_dT")
MOST_TEMPERATURES = 8
SIMULATED = (
    "Simulated. Bench, gyro and reference are models in software: this page shows what a certificate of this procedure "
    "says, and is no calibration of hardware. Nothing on it is traceable to a standard."
)
MEASURED = (
    "Measured on hardware. The table's rate, the latitude and the temperatures are as good as the certificates of the "
    "instruments named above, whose half-widths are in the budget; fogbench itself adds no traceability. The figures "
    "hold for the conditions stated and for the time of the measurement."
)
METHOD = (
    "Uncertainties follow the GUM (JCGM 100): u is the standard uncertainty; U = k u, or the limits, hold 95 %, k from "
    "Student's t with the effective degrees of freedom of Welch and Satterthwaite. Limits of standard deviations are "
    "those of chi-square. Output is divided by K first, then the earth's rotation is taken off. Bias stability (Bs), "
    "bias instability (B) and Allan minimum are three figures."
)


@dataclass(frozen=True)
class TableOnPage:
    """A table: heading, names of the columns, rows, and which columns are numbers (right-aligned)."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]
    note: str = ""


@dataclass(frozen=True)
class Page:
    """Everything on the page, in its order."""

    title: str
    dut: str
    outcome: str
    outcome_words: str
    virtual: bool
    facts: tuple[tuple[str, str], ...]
    figures: TableOnPage | None
    compensated: TableOnPage | None
    budgets: tuple[TableOnPage, ...]
    statements: tuple[str, ...]


def page_of(
    dut: str,
    manifest: Manifest,
    document: Mapping[str, Any] | None,
    limits: Mapping[str, float],
    found: Compensated | None,
    raw_sha256: str | None,
) -> Page:
    """The page of one DUT: of a calibration's document, of a model's compensation, or of both."""
    figures = None if document is None else figures_table(document["figures"], limits)
    budgets = [budget_table(one) for one in (document or {}).get("budgets", {}).values()]
    if found is not None:
        budgets.append(budget_table(worst_record(found)))
    return Page(
        "Calibration certificate",
        dut,
        manifest.outcome,
        _outcome_words(dut, manifest),
        manifest.virtual is not False,
        tuple(facts(dut, manifest, document, raw_sha256)),
        figures,
        None if found is None else compensated_table(found),
        tuple(budgets[-3:]),
        (METHOD, SIMULATED if manifest.virtual is not False else MEASURED),
    )


def _outcome_words(dut: str, manifest: Manifest) -> str:
    """Which limits this DUT kept; those of others are not its own."""
    mine = [check for check in manifest.limits if dut in check.measured]
    if not mine:
        return "no limit was set for this unit"
    over = [
        check
        for check in mine
        if (value := check.measured[dut]) is None or check.limit is None or abs(value) > check.limit
    ]
    if not over:
        return f"all {len(mine)} limits kept by this unit" if len(mine) > 1 else "the limit is kept by this unit"
    return "not kept by this unit: " + ", ".join(check.quantity.partition(" in ")[0] for check in over)


def facts(
    dut: str, manifest: Manifest, document: Mapping[str, Any] | None, raw_sha256: str | None
) -> list[tuple[str, str]]:
    """Unit, run, bench and conditions."""
    identities = "; ".join(f"{name}: {text}" for name, text in manifest.identities.items() if name not in manifest.duts)
    ended = manifest.ended_utc or manifest.started_utc
    listed = [
        (
            "Unit under test",
            f"{dut} ({manifest.identities.get(dut) or manifest.duts.get(dut, {}).get('describe', '')})",
        ),
        ("Run", manifest.run_id),
        ("Measured", f"{_minute(manifest.started_utc)} to {_minute(ended)} UTC, {_lasted(manifest)} of bench time"),
        (
            "Procedure",
            f"{manifest.procedure.title or manifest.procedure.name} (sha256 {manifest.procedure.sha256[:16]})",
        ),
        ("Bench", f"{manifest.bench.name}{', simulated' if manifest.virtual else ''}. {identities}"),
        *(_conditions(document) if document is not None else ()),
        (
            "Software",
            f"fogbench {manifest.versions.get('fogbench', '?')}, Python {manifest.versions.get('python', '?')}",
        ),
        ("Raw data", f"sha256 {raw_sha256 or 'not kept'}"),
    ]
    return [(name, text) for name, text in listed if text]


def _minute(stamp: str) -> str:
    return stamp[:16].replace("T", " ") or "?"


def _lasted(manifest: Manifest) -> str:
    return "?" if manifest.duration_s is None else format_duration(manifest.duration_s)


def _conditions(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    about = document["conditions"]
    ranges = [
        one["conditions"]["dut_temperature_degc"]
        for one in document["figures"]
        if "dut_temperature_degc" in one["conditions"]
    ]
    degc = f"DUT at {min(r['min'] for r in ranges):.1f} to {max(r['max'] for r in ranges):.1f} degC; " if ranges else ""
    latitude = "not stated" if about["latitude_deg"] is None else f"{about['latitude_deg']:g} deg"
    ks = list(
        dict.fromkeys(one["conditions"]["k_from"] for one in document["figures"] if "k_from" in one["conditions"])
    )
    records = {
        one["conditions"]["record"]: one["conditions"] for one in document["figures"] if "record" in one["conditions"]
    }
    lost = sum(one["frames_lost"] for one in records.values())
    left_out = sum(one["outliers"] for one in records.values())
    cleaned = (
        f"; {counted(left_out, 'outlier')} left out, {counted(lost, 'frame')} lost in {counted(len(records), 'record')}"
        if records
        else ""
    )
    return [
        ("Conditions", f"{degc}input axis {about['input_axis']}; latitude {latitude}{cleaned}"),
        ("Scale factor used", ", ".join(ks)),
        ("Half-widths", _half_widths(about["half_widths"])),
    ]


def _half_widths(widths: Mapping[str, Any]) -> str:
    """What the budgets take of the bench, and whether the procedure says so."""
    text = (
        f"table {widths['table_ppm']:g} ppm, latitude {widths['latitude_deg']:g} deg, tilt {widths['tilt_arcmin']:g} "
        f"arcmin, DUT temperature {widths['temperature_k']:g} K"
    )
    return text if widths["stated"] else f"{text}: usual values, for the procedure states none"


def figures_table(figures: Sequence[Mapping[str, Any]], limits: Mapping[str, float]) -> TableOnPage:
    """One row for each figure; those of one symbol in one row with their range if there are too many for the page."""
    grouped: dict[str, list[Mapping[str, Any]]] = {}
    for one in figures:
        grouped.setdefault(one["symbol"], []).append(one)
    together = len(figures) > MOST_FIGURES
    rows: list[tuple[str, ...]] = []
    for symbol, same in grouped.items():
        limit = f"≤ {limits[symbol]:g}" if symbol in limits else ""
        if together and len(same) > 1:
            rows.append((*_together(symbol, same), limit))
        else:
            rows += [
                (symbol, one["name"], value_of(one), expanded_of(one), one["unit"], str(one["n"]), one["at"], limit)
                for one in same
            ]
    return TableOnPage(
        "Figures",
        ("", "Figure", "Value", "U, or limits, 95 %", "Unit", "n", "At", "Limit"),
        tuple(rows),
        (False, False, True, True, False, True, False, True),
        "Definitions, and the conditions of each: fogbench metrics, and analyses/calibration.json in the run.",
    )


def _together(symbol: str, same: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Several figures of one symbol in one row: their range, or the largest of them."""
    order = sorted(same, key=lambda one: one["value"] if symbol in SIGNED else abs(one["value"]))
    low, high = order[0], order[-1]
    certain = expanded_of(max(same, key=lambda one: one["u"] or 0.0))
    if symbol in SIGNED:
        value, where = f"{value_of(low)} to {value_of(high)}", f"range of {len(same)}"
    else:
        value, where, certain = value_of(high), f"largest of {len(same)}", expanded_of(high)
    return symbol, high["name"], value, certain, high["unit"], str(high["n"]), where


def compensated_table(found: Compensated) -> TableOnPage:
    """The least certain point of every temperature, of some if there are many."""
    listed = by_temperature(found)
    if len(listed) > MOST_TEMPERATURES:
        step = (len(listed) - 1) / (MOST_TEMPERATURES - 1)
        listed = [listed[round(k * step)] for k in range(MOST_TEMPERATURES)]
    rows = [
        (
            f"{one.temperature_degc:.1f}",
            f"{one.rate_dps:g}",
            digits(one.error_dph, one.budget.u_dph),
            digits(one.budget.u_dph, one.budget.u_dph),
            f"{one.budget.k:.2f}",
            digits(one.budget.expanded_dph, one.budget.u_dph),
        )
        for one in listed
    ]
    spread = f"{found.residual_dps * 3600.0:.4g} deg/h"
    return TableOnPage(
        f"Compensated rate, model {found.model}",
        ("DUT, degC", "Rate, deg/s", "Error left, deg/h", "u, deg/h", "k", "U 95 %, deg/h"),
        tuple(rows),
        (True,) * 6,
        f"The least certain point of each temperature shown; all {len(found.points)} points in the JSON beside it. "
        f"Error of the model on held-back points ({found.split.replace('_', ' ')}): std {spread}, {found.rows} points.",
    )


def worst_record(found: Compensated) -> dict[str, Any]:
    """The budget of the least certain compensated point."""
    one = found.worst
    name = f"compensated rate at {one.temperature_degc:.1f} degC, {one.rate_dps:g} deg/s"
    value = one.error_dph
    figure = Figure(name, name, value, "deg/h", one.budget.u_dph, value, value, len(found.points), "", "")
    return budget_record(figure, one.budget.rows)


def budget_table(budget: Mapping[str, Any]) -> TableOnPage:
    """Sources, their contributions, and what they come to."""
    u = budget["u"]
    rows = [
        (
            row["source"],
            row["type"],
            row["distribution"],
            f"{row['value']:.3g} {row['unit']}",
            f"{row['sensitivity']:.3g}",
            significant(row["contribution"], 2),
            _dof(row["dof"]),
        )
        for row in budget["rows"]
    ]
    rows.append(("combined, u", "", "", "", "", significant(u, 2), _dof(budget["dof"])))
    rows.append((f"expanded, U = {budget['k']:.2f} u", "", "", "", "", significant(budget["expanded"], 2), ""))
    return TableOnPage(
        f"Uncertainty budget of {budget['figure']}, in {budget['unit']}",
        ("Source", "Type", "Distribution", "Value", "Sensitivity", "Contribution", "Dof"),
        tuple(rows),
        (False, False, False, True, True, True, True),
    )


def _dof(value: float | None) -> str:
    return "∞" if value is None or value > 1e4 else f"{value:.0f}"
