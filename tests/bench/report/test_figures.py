import re
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from bench.report import figures


def drawn(text: str = "DUT a", name: str = "one") -> figures.Figure:
    with figures.style():
        canvas = figures.canvas()
        axes = figures.axes_at(canvas, 60, 40, 20, 30)
        axes.plot([0, 1.23456789], [0, 1], label=text)
        figures.cells(axes, np.array([[0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 2.0, 1.0]]), ["#ff0000", "#ff0000"])
        figures.legend_above(axes)
        return figures.finish(canvas, name, f"alt of {text}")


def texts(svg: str) -> list[str]:
    tree = ElementTree.fromstring(svg.replace("<svg ", '<svg xmlns:xlink="http://www.w3.org/1999/xlink" ', 1))
    return [element.text or "" for element in tree.iter() if element.tag.endswith("text")]


@pytest.mark.parametrize("name", ["<script>", "$\\frac{", '" x="1.23456"', "a & b", "_hidden", "陀螺"])
def test_any_name_is_drawn_as_it_is(name: str) -> None:
    figure = drawn(f"DUT {name}")
    assert f"DUT {name}" in texts(figure.svg)
    assert "<script" not in figure.svg


def test_svg_can_stand_in_a_page() -> None:
    svg = drawn().svg
    assert svg.startswith("<svg viewBox=")
    assert 'role="img"' in svg
    assert "alt of DUT a" in svg
    assert not re.search(r"<style|font-family|<metadata|http", svg)
    ids = re.findall(r' id="([^"]*)"', svg)
    assert len(ids) == len(set(ids))
    assert all(name.startswith("one-") for name in ids)
    assert set(re.findall(r'(?:href="#|url\(#)([^")]*)', svg)) == set(ids)


def test_ids_of_two_figures_differ() -> None:
    first, second = (set(re.findall(r' id="([^"]*)"', drawn(name=name).svg)) for name in ("one", "two"))
    assert first
    assert not first & second


def test_drawing_is_deterministic() -> None:
    assert drawn().svg == drawn().svg


def test_cells_of_one_colour_are_one_path() -> None:
    assert drawn().svg.count("#ff0000") == 1


def test_levels_are_symmetric_and_cover_the_scale() -> None:
    values = np.linspace(-1, 1, 2001)
    level = figures.level_of(values, 1.0)
    assert (level[0], level[1000], level[-1]) == (0, figures.LEVELS // 2, figures.LEVELS - 1)
    assert set(level) == set(range(figures.LEVELS))
    assert figures.level_of(np.zeros(3), 0.0).tolist() == [figures.LEVELS // 2] * 3
    assert len(figures.diverging()) == figures.LEVELS


@pytest.mark.parametrize(("last_s", "unit"), [(160 * 3600, "h"), (1800, "min"), (100, "s")])
def test_time_is_labelled_in_a_readable_unit(last_s: float, unit: str) -> None:
    with figures.style():
        axes = figures.canvas().add_subplot()
        unit_s = figures.time_axis(axes, last_s)
        assert axes.get_xlabel() == f"bench time ({unit})"
        assert 2 <= len([tick for tick in axes.get_xticks() if 0 <= tick <= last_s / unit_s]) <= 16


def test_pyplot_stays_out() -> None:
    code = "import sys; from bench.report import figures; figures.style().__enter__(); figures.canvas().add_subplot(); "
    code += "sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_style_does_not_leak() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    drawn()
    assert dict(matplotlib.rcParams) == before
