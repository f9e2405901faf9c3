"""Rare events: the right number of them, the same whoever asks for which part."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulated_hw.faults.draws import Bursts, Events
from simulated_hw.physics.streams import Stream


def events(probability: float) -> Events:
    return Events(Stream(1, "x"), probability)


def bursts(enter: float, mean: float) -> Bursts:
    return Bursts(Stream(1, "x"), enter, mean)


@pytest.mark.parametrize("probability", [1.0, 0.3, 1e-3])
def test_events_come_as_often_as_their_probability_says(probability: float) -> None:
    count, n = len(events(probability).between(0, 3_000_000)), 3_000_000
    assert count == pytest.approx(n * probability, abs=4.0 * (n * probability * (1.0 - probability)) ** 0.5)


def test_gaps_between_events_have_no_memory() -> None:
    """The variance of a geometric gap is (1 - p) / p², across the seams of the chunks too."""
    gaps = np.diff(events(1e-3).between(0, 50_000_000))
    assert gaps.mean() == pytest.approx(1000.0, rel=0.02)
    assert gaps.std() == pytest.approx(1000.0, rel=0.02)


def test_what_never_happens_never_happens() -> None:
    assert not len(events(0.0).between(0, 10**9)) and not len(bursts(0.0, 5.0).between(0, 10**9))
    assert not len(events(1e-18).between(0, 10**7)) and not len(bursts(1e-18, 5.0).between(0, 10**9))


def test_bursts_are_as_frequent_and_as_long_as_said() -> None:
    places = bursts(1e-3, 8.0).between(0, 2_000_000)
    lengths = np.diff(np.flatnonzero(np.diff(places, prepend=-2) != 1), append=len(places))
    # 2 million places are that many chances to enter, less those inside bursts and the good one behind each
    assert len(lengths) == pytest.approx(2_000_000 / (1000.0 + 8.0), rel=0.1)
    assert lengths.mean() == pytest.approx(8.0, rel=0.1) and lengths.std() == pytest.approx((8.0 * 7.0) ** 0.5, rel=0.1)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 2_200_000), min_size=1, max_size=6), st.booleans())
def test_the_parts_make_up_the_whole_in_any_order(cuts: list[int], burst: bool) -> None:
    make = (lambda: bursts(1e-4, 30.0)) if burst else (lambda: events(1e-4))
    whole, asked = make().between(0, 2_200_000), make()
    edges = sorted({0, 2_200_000, *cuts})
    spans = list(pairwise(edges))
    parts = {span: asked.between(*span) for span in reversed(spans)}
    assert np.array_equal(np.concatenate([parts[span] for span in spans]), whole)
