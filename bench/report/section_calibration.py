"""Calibration figures: what was measured, how well it is known, what it is; and the Allan curves."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bench.analyses.calibration_words import digits, expanded_of, polynomial_of, value_of
from bench.report.data import ReportData
from bench.report.figures_allan import draw
from bench.report.formats import fault, fixed, setpoint, significant
from bench.report.section import Section
from bench.report.tables import Cell, Column, Table, table

FILE = "calibration.json"
ANCHOR, TITLE, LABEL = "calibration", "Calibration figures", "Calibration"
ABOUT = (
    "Every figure with its expanded uncertainty, or its limits, for 95 %. Output is divided by K first, then the "
    "earth's rotation is taken off. Bias stability (spread of block means), bias instability (B of the Allan fit) and "
    "the Allan minimum are three figures, never one for another. analyses/calibration.json has the conditions of each; "
    "fogbench certificate puts them on one page with their uncertainty budgets."
)
CURVES = (
    "Overlapping Allan deviation with its limits for 95 % (band), the fit (dashed) and the minimum (circle), which is "
    "not the bias instability B."
)


def calibration(data: ReportData) -> Section | None:
    """The section; None if the run has no calibration."""
    path = data.run_dir / "analyses" / FILE
    if not path.is_file():
        return None
    remarks: list[str] = []
    try:
        found: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        tables = [_table(dut, one["figures"]) for dut, one in found.items() if one["figures"]]
        tables += [made for dut, one in found.items() for made in _more(dut, one["tables"])]
        curves = [curve for dut, one in found.items() for curve in _curves(dut, one["tables"])]
        drawn = [draw(curves, "allan", CURVES)] if curves else []
        remarks = _definitions(found)
    except (OSError, ValueError, AttributeError, TypeError, KeyError, RecursionError) as error:
        text = f"analyses/{FILE} cannot be read ({fault(error, path)}): nothing of it is shown."
        return Section(ANCHOR, TITLE, remarks=(text,), label=LABEL)
    return Section(ANCHOR, TITLE, (ABOUT,), tuple(tables), tuple(drawn), tuple(remarks), LABEL)


def _table(dut: str, figures: Sequence[Mapping[str, Any]]) -> Table:
    columns = [Column("Figure", False), Column("", False), Column("Value"), Column("U, or limits", False)]
    columns += [Column("Unit", False), Column("n"), Column("At", False)]
    rows: list[list[str | Cell]] = [
        [
            Cell(one["symbol"], kind="nowrap"),
            one["name"],
            Cell(value_of(one), kind="nowrap"),
            Cell(expanded_of(one), kind="nowrap"),
            one["unit"].replace("deg", "°"),
            str(one["n"]),
            one["at"].replace("deg", "°"),
        ]
        for one in figures
    ]
    return table(f"DUT {dut}: calibration figures.", columns, rows)


def _more(dut: str, tables: Mapping[str, Any]) -> Iterator[Table]:
    """Bias over temperature; what the line leaves at each rate of the first rate set."""
    biases = tables.get("bias_over_temperature")
    if biases:
        columns = [Column("DUT, °C"), Column("Bias, °/h"), Column("Standard uncertainty, °/h")]
        rows = [
            [fixed(row["temperature_degc"], 2), digits(row["bias_dph"], row["u_dph"]), significant(row["u_dph"], 2)]
            for row in biases["rows"]
        ]
        yield table(f"DUT {dut}: bias over temperature. {polynomial_of(biases)}.", columns, rows)
    rates = tables.get("rates")
    if rates:
        first = [row for row in rates if row["dwell"] == rates[0]["dwell"]][: len({row["rate_dps"] for row in rates})]
        columns = [Column("Rate, °/s"), Column("ppm of full scale"), Column("ppm of reading")]
        rows = [
            [setpoint(row["rate_dps"]), significant(row["full_scale_ppm"], 3), significant(row["reading_ppm"], 3)]
            for row in sorted(first, key=lambda row: float(row["rate_dps"]))
        ]
        where = rates[0]["at"].replace("deg", "°")
        yield table(f"DUT {dut}: what the line leaves at each rate, at {where}.", columns, rows)


def _curves(dut: str, tables: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    return [(f"{dut}, record {one['record']}", one) for one in tables.get("allan", ())]


def _definitions(found: Mapping[str, Any]) -> list[str]:
    """What each figure is, as its first appearance has it."""
    seen: dict[str, str] = {}
    for one in (figure for document in found.values() for figure in document["figures"]):
        seen.setdefault(one["symbol"], f"{one['symbol']}: {one['definition']} ({one['source']}).")
    return list(seen.values())
