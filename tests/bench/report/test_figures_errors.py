import dataclasses
import re

import numpy as np
import pytest

from bench.report import figures, figures_errors
from bench.report.data import DutData, ReportData


def faces(dut: DutData, column: str = "error_dps") -> int:
    with figures.style():
        figure = figures_errors.error_surface(dut, column, "s")
    return figure.svg.count("stroke-width: 0.35") if figure else 0


def without(dut: DutData, rows: list[int]) -> DutData:
    return dataclasses.replace(dut, points=dut.points.drop(index=rows).reset_index(drop=True))


def test_surface_has_a_face_between_all_neighbours(small: ReportData) -> None:
    assert faces(small.duts[0]) == 4 * 6


def test_a_missing_point_is_a_hole_of_four_faces(small: ReportData) -> None:
    inner = 2 * 7 + 3
    assert faces(without(small.duts[0], [inner])) == 4 * 6 - 4


def test_one_dwell_has_no_surface(small: ReportData) -> None:
    assert faces(without(small.duts[0], list(range(7, 35)))) == 0


def test_no_residual_has_no_surface(small: ReportData) -> None:
    points = small.duts[0].points.assign(residual_dps=np.nan)
    assert faces(dataclasses.replace(small.duts[0], points=points), "residual_dps") == 0


def test_large_grids_are_thinned_with_both_ends_kept() -> None:
    layer = np.arange(200.0 * 10).reshape(200, 10)
    thin = figures_errors._thinned(layer)
    assert thin.shape == (figures_errors.LARGEST_SIDE, 10)
    assert (thin[0, 0], thin[-1, -1]) == (layer[0, 0], layer[-1, -1])


def test_z_scale_is_stated(small: ReportData) -> None:
    dut = small.duts[0]
    bound = float(dut.points["error_dps"].abs().max())
    assert figures_errors.surface_bound_dps(dut, "error_dps") == pytest.approx(bound)
    with figures.style():
        figure = figures_errors.error_surface(dut, "error_dps", "s")
    assert figure is not None
    stated = re.search(r">z axis: ±([\d.]+) °/s</text>", figure.svg)
    assert stated
    assert float(stated[1]) == pytest.approx(bound, rel=0.06)


def test_scores_name_every_model_and_split(small: ReportData) -> None:
    with figures.style():
        figure = figures_errors.model_scores(small.duts[0], "s")
    assert figure is not None
    words = ("not compensated", "linear", "T-S published", "T-S joint", "leave temperatures out", "noise floor")
    assert all(f">{word}</text>" in figure.svg for word in words)


@pytest.mark.parametrize("splits", [("leave_temperatures_out", "random"), ("random",)])
def test_key_of_the_scores_is_complete_and_inside_the_figure(small: ReportData, splits: tuple[str, ...]) -> None:
    judged = {model: {split: by[split] for split in splits} for model, by in small.duts[0].metrics.items()}
    with figures.style():
        figure = figures_errors.model_scores(dataclasses.replace(small.duts[0], metrics=judged), "s")
    assert figure is not None
    found = re.findall(r'x="([-\d.]+)" y="([-\d.]+)"[^>]*>([^<]+)</text>', figure.svg)
    places = {text: (float(x), float(y)) for x, y, text in found}
    words = [spec[1] for spec in figures_errors.SERIES if spec[0] in splits] + ["noise floor"]
    key = [places[word] for word in words]
    assert len(set(places) & {spec[1] for spec in figures_errors.SERIES}) == len(splits)
    assert 12 < places[f"DUT {small.duts[0].name}"][1] < min(y for _, y in key) - 16
    assert max(y for _, y in key) < places["not compensated"][1]
    assert all(0 < x < figures.HALF[0] - 80 for x, _ in key)


def test_a_held_out_surface_says_so(small: ReportData) -> None:
    with figures.style():
        drawn = [
            figures_errors.error_surface(dataclasses.replace(small.duts[0], held_out=held_out), "residual_dps", "s")
            for held_out in (True, False)
        ]
    assert [figure is not None and ", held out</text>" in figure.svg for figure in drawn] == [True, False]


def test_without_metrics_there_are_no_scores(small: ReportData) -> None:
    with figures.style():
        assert figures_errors.model_scores(dataclasses.replace(small.duts[0], metrics={}), "s") is None
