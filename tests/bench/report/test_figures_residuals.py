import dataclasses
import re

import numpy as np
import pytest

from bench.report import figures, figures_residuals
from bench.report.data import ReportData
from bench.report.formats import MINUS


def test_every_dwell_is_a_line(small: ReportData) -> None:
    with figures.style():
        figure = figures_residuals.against_rate(small.duts[0], "r")
    assert figure is not None
    assert all(figure.svg.count(f"stroke: {colour}") == 1 for colour in figures.warmth(5))


def test_every_point_is_a_dot(small: ReportData) -> None:
    with figures.style():
        figure = figures_residuals.against_temperature(small.duts[1], 1, "t")
    assert figure is not None
    dots = max((path for path in figure.svg.split("<path ")), key=lambda path: path.count("M "))
    assert dots.count("M ") == len(small.duts[1].usable)


def test_histogram_states_the_std(small: ReportData) -> None:
    dut = small.duts[0]
    with figures.style():
        figure = figures_residuals.histogram(dut, 0, "h")
    assert figure is not None
    stated = re.search(r">±1 std = ([\d.]+) °/s</text>", figure.svg)
    assert stated
    assert float(stated[1]) == pytest.approx(float(np.std(dut.usable["residual_dps"])), rel=6e-3)


def test_a_single_dwell_is_not_blown_up(small: ReportData) -> None:
    dut = dataclasses.replace(small.duts[0], points=small.duts[0].points.iloc[:7])
    with figures.style():
        figure = figures_residuals.against_temperature(dut, 0, "t")
    assert figure is not None
    degc = [float(text.replace(MINUS, "-")) for text in re.findall(rf">({MINUS}\d\d\.?\d*)</text>", figure.svg)]
    assert max(degc) - min(degc) > 1.0


def test_magnitudes_set_the_noise_beside(small: ReportData) -> None:
    with figures.style():
        figure = figures_residuals.magnitudes(small.duts[0], 0, "m")
    assert figure is not None
    assert all(f">{word}</text>" in figure.svg for word in ("noise", "compensated", "not compensated"))


def test_no_residuals_no_figures(small: ReportData) -> None:
    dut = dataclasses.replace(small.duts[0], points=small.duts[0].points.assign(residual_dps=np.nan))
    with figures.style():
        assert figures_residuals.against_rate(dut, "r") is None
        assert figures_residuals.against_temperature(dut, 0, "t") is None
        assert figures_residuals.histogram(dut, 0, "h") is None
        assert figures_residuals.magnitudes(dut, 0, "m") is None
