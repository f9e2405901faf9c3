import dataclasses

import numpy as np
import pytest

from bench.report import figures, figures_grid
from bench.report.data import DutData, ReportData


def changed(dut: DutData, row: int, **values: str | bool) -> DutData:
    points = dut.points.copy()
    for name, value in values.items():
        points.loc[row, name] = value
    return dataclasses.replace(dut, points=points)


def test_verdicts_are_counted_and_holes_seen(small: ReportData) -> None:
    dut = changed(changed(small.duts[0], 3, verdict="fail"), 9, verdict="marginal")
    dut = dataclasses.replace(dut, points=dut.points.drop(index=[20, 21]).reset_index(drop=True))
    with figures.style():
        figure = figures_grid.verdict_map(dut, "v")
    assert figure is not None
    words = ("pass 31", "marginal 1", "fail 1", "not measured 2")
    assert all(f">{word}</text>" in figure.svg for word in words)
    assert "31 pass, 1 marginal, 1 fail, 2 cells not measured" in figure.alt


def test_a_whole_grid_has_no_key_for_holes(small: ReportData) -> None:
    with figures.style():
        figure = figures_grid.verdict_map(small.duts[0], "v")
    assert figure is not None
    assert "not measured</text>" not in figure.svg
    assert ">not measured 0<" not in figure.svg


def test_a_failed_point_has_no_residual_cell(small: ReportData) -> None:
    dut = changed(small.duts[0], 3, verdict="fail", usable=False)
    with figures.style():
        figure = figures_grid.residual_map(dut, "r")
    assert figure is not None
    assert "1 cells without a value" in figure.alt


def test_an_unknown_verdict_counts_as_the_worst(small: ReportData) -> None:
    with figures.style():
        figure = figures_grid.verdict_map(changed(small.duts[0], 3, verdict=""), "v")
    assert figure is not None
    assert figures.VERDICT_COLOURS["fail"] in figure.svg


@pytest.mark.parametrize(
    ("values", "edges"),
    [([5.0], [4.5, 5.5]), ([0.0, 10.0], [-5.0, 5.0, 15.0]), ([0.0, 1.0, 4.0], [-0.5, 0.5, 2.5, 5.5])],
)
def test_cells_meet_half_way(values: list[float], edges: list[float]) -> None:
    assert figures_grid._edges(np.array(values)).tolist() == edges


def test_no_points_no_map(small: ReportData) -> None:
    dut = dataclasses.replace(small.duts[0], points=small.duts[0].points.iloc[:0])
    with figures.style():
        assert figures_grid.verdict_map(dut, "v") is None
        assert figures_grid.residual_map(dut, "r") is None
