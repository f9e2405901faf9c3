import dataclasses
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bench.report import figures, figures_campaign
from bench.report.data import ReportData


@given(st.integers(2, 400), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_envelope_keeps_every_extreme(n: int, bins: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t, y = np.cumsum(rng.random(n) + 1e-3), rng.normal(size=n)
    kept_t, kept_y = figures_campaign.envelope(t, y, bins)
    assert set(zip(kept_t, kept_y, strict=True)) <= set(zip(t, y, strict=True))
    assert len(kept_t) <= 2 * bins + 2
    assert (np.diff(kept_t) > 0).all()
    assert (kept_t[0], kept_t[-1]) == (t[0], t[-1])
    edges = np.linspace(t[0], t[-1], bins + 1)
    for left, right in pairwise(edges):
        inside, kept = y[(t > left) & (t < right)], kept_y[(kept_t >= left) & (kept_t <= right)]
        assert not inside.size or (kept.max() >= inside.max() and kept.min() <= inside.min())


def test_a_single_spike_survives() -> None:
    t = np.arange(50_000.0)
    y = np.zeros_like(t)
    y[31_234] = 180.0
    assert figures_campaign.envelope(t, y, 100)[1].max() == 180.0


def test_timeline_shows_every_signal(small: ReportData) -> None:
    with figures.style():
        figure = figures_campaign.timeline(small)
    assert figure is not None
    for words in ("chamber setpoint", "chamber readback", "DUT gyro-a", "DUT gyro-b", "table readback", "rate (°/s)"):
        assert f">{words}</text>" in figure.svg


def test_setpoint_is_drawn_over_a_wider_readback(small: ReportData) -> None:
    with figures.style():
        figure = figures_campaign.timeline(small)
    assert figure is not None
    lines = figure.svg.split("<path ")
    readback = next(n for n, line in enumerate(lines) if f"stroke: {figures.SETPOINT}; stroke-width: 3" in line)
    dashed = next(n for n, line in enumerate(lines) if "dasharray" in line and f"stroke: {figures.INK}" in line)
    assert readback < dashed
    assert "chamber readback, its setpoint (dashed) over it, and the DUTs' own" in figure.caption


def test_each_of_a_few_readbacks_is_marked_and_no_staircase_is_told(small: ReportData) -> None:
    assert small.timeline is not None
    few = small.timeline.iloc[:9].drop(columns="chamber_setpoint_degc")
    one = tuple(dataclasses.replace(dut, points=dut.points.iloc[:7]) for dut in small.duts)
    with figures.style():
        sparse = figures_campaign.timeline(dataclasses.replace(small, timeline=few, duts=one))
        dense = figures_campaign.timeline(small)
    assert sparse is not None
    assert dense is not None
    marks = [figure.svg.count(f'style="fill: {figures.INK}; stroke: {figures.INK}"') for figure in (sparse, dense)]
    assert marks[0] >= 9
    assert marks[1] == 0
    assert "staircase" in dense.caption
    assert "staircase" not in sparse.caption
    assert "setpoint" not in sparse.caption


def test_without_rate_readback_the_setpoint_is_drawn(small: ReportData) -> None:
    assert small.timeline is not None
    blind = dataclasses.replace(small, timeline=small.timeline.drop(columns="rate_readback_dps"))
    with figures.style():
        figure = figures_campaign.timeline(blind)
    assert figure is not None
    assert ">table setpoint</text>" in figure.svg


def test_one_dwell_is_the_middle_one(small: ReportData) -> None:
    with figures.style():
        figure = figures_campaign.one_dwell(small)
    assert figure is not None
    assert "from −15 to 0 °C, soak, then 7 rates" in figure.caption
    assert "begin 2 h 15 min after" in figure.caption  # 15 degC at 1 degC/min, then 2 h soak and 6 s settling


def test_nothing_to_draw_gives_none(small: ReportData) -> None:
    bare = dataclasses.replace(small, timeline=None)
    assert figures_campaign.timeline(bare) is None
    assert figures_campaign.one_dwell(bare) is None
    assert figures_campaign.one_dwell(dataclasses.replace(small, duts=())) is None
