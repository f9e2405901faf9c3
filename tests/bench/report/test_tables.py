import dataclasses
from collections.abc import Mapping

import pytest

from bench.report import tables
from bench.report.data import ReportData
from bench.report.formats import MINUS
from bench.report.manifest import LimitCheck


def texts(table: tables.Table) -> list[list[str]]:
    return [[cell.text for cell in row] for row in table.rows]


def test_results_are_the_metrics(small: ReportData) -> None:
    dut = small.duts[0]
    rows = {row[0]: row[1:] for row in texts(tables.results(dut))}
    held_out, random = (dut.metrics["linear"][split] for split in ("leave_temperatures_out", "random"))
    printed = [float(text) for text in rows["linear"]]
    expected = [held_out["max_abs_dps"], held_out["std_dps"], random["max_abs_dps"], random["std_dps"]]
    assert printed[:4] == pytest.approx(expected, rel=6e-3)
    before = dut.metrics["none"]["leave_temperatures_out"]["std_dps"]
    assert before is not None
    assert held_out["std_dps"] is not None
    assert printed[4] == pytest.approx(before / held_out["std_dps"], rel=0.06)
    assert rows["noise floor"][0] == "–"
    assert float(rows["noise floor"][1]) == pytest.approx(dut.floor_dps, rel=0.06)


def test_headline_is_the_best_model_on_unseen_temperatures(small: ReportData) -> None:
    dut = small.duts[0]
    line = tables.headline(dut)
    assert line is not None
    assert line.split == "leave temperatures out"
    std = dut.figure(dut.model or "", "leave_temperatures_out", "std_dps")
    assert float(line.std_after) == pytest.approx(std, rel=6e-3)


def test_one_split_is_one_side(small: ReportData) -> None:
    metrics = {model: {"random": splits["random"]} for model, splits in small.duts[0].metrics.items()}
    shown = tables.results(dataclasses.replace(small.duts[0], metrics=metrics))
    assert [label for label, _ in shown.groups if label] == ["Random split, °/s"]
    assert "11 points held back at random." in shown.caption
    rows = {row[0]: row[1:] for row in texts(shown)}
    before, after = (metrics[model]["random"]["std_dps"] for model in ("none", "linear"))
    assert before is not None
    assert after is not None
    assert float(rows["linear"][2]) == pytest.approx(before / after, rel=0.06)


def test_points_as_measured_are_those_of_the_file(small: ReportData) -> None:
    shown = tables.as_measured(small)
    assert shown is not None
    first = [cell.text for cell in shown.rows[1]]
    row = small.duts[1].points.iloc[0]
    assert first[:2] == ["1", "gyro-b"]
    error = row["rate_mean_dps"] - row["rate_reference_dps"]
    assert float(first[5].replace(MINUS, "-")) == pytest.approx(error, abs=6e-6)
    assert len(shown.rows) == tables.POINTS_SHOWN
    assert "The first 40 of 70" in shown.caption
    assert tables.as_measured(dataclasses.replace(small, duts=())) is None


def test_headline_falls_back_to_the_random_split_and_says_so(small: ReportData) -> None:
    metrics = {
        model: {"random": splits["random"], "random_train": splits["random_train"]}
        for model, splits in small.duts[0].metrics.items()
    }
    line = tables.headline(dataclasses.replace(small.duts[0], metrics=metrics))
    assert line is not None
    assert line.split == "random split, held-back points"
    assert tables.headline(dataclasses.replace(small.duts[0], metrics={})) is None


@pytest.mark.parametrize(
    ("measured", "passed", "word", "kinds"),
    [
        ({"a": 0.01, "b": 0.02}, True, "passed", ["", ""]),
        ({"a": 0.01, "b": 0.2}, False, "failed", ["", "bad"]),
        ({"a": 0.01, "b": None}, False, "not measured", ["", ""]),
        ({}, None, "not measured", []),
    ],
)
def test_limits_are_judged(
    small: ReportData, measured: Mapping[str, float | None], passed: bool | None, word: str, kinds: list[str]
) -> None:
    check = LimitCheck("ts_joint", "leave_temperatures_out", "std_dps", 0.05, measured, passed)
    shown = tables.limits(dataclasses.replace(small.manifest, limits=(check,)))
    assert shown is not None
    assert shown.rows[0][-1].text == word
    assert [cell.kind for cell in shown.rows[0][3:-1]] == kinds
    assert [cell.text for cell in shown.rows[0][1:3]] == ["°/s", "≤ 0.05"]


def test_no_limits_no_table(small: ReportData) -> None:
    assert tables.limits(dataclasses.replace(small.manifest, limits=())) is None
