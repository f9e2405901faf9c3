"""Gaps: where they are, and what filling does to them."""

import numpy as np
import pytest

from fitting.random_errors.gaps import fill_gaps, stretches

NAN = float("nan")


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        ([1.0, 2.0, 3.0], [(0, 3)]),
        ([NAN, 1.0, NAN, NAN, 2.0, 3.0], [(1, 2), (4, 6)]),
        ([1.0, NAN], [(0, 1)]),
        ([NAN, np.inf], []),
    ],
)
def test_stretches(rate: list[float], expected: list[tuple[int, int]]) -> None:
    assert stretches(np.array(rate)) == expected


def test_a_short_gap_becomes_a_straight_line_between_the_levels_beside_it() -> None:
    rate = np.concatenate([np.full(20, 1.0), [NAN] * 3, np.full(20, 5.0)])
    filled, count = fill_gaps(rate, longest=3)
    assert count == 3
    assert filled[19:24] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])
    assert np.isnan(rate[20:23]).all()


def test_the_levels_are_means_of_measured_samples_only() -> None:
    rate = np.array([1.0, NAN, 3.0, NAN, 7.0, 9.0])
    filled, count = fill_gaps(rate, longest=1)
    assert count == 2
    assert filled == pytest.approx([1.0, 2.0, 3.0, 5.5, 7.0, 9.0])


def test_long_gaps_and_gaps_at_the_ends_stay() -> None:
    rate = np.array([NAN, 1.0, NAN, NAN, 2.0, NAN])
    filled, count = fill_gaps(rate, longest=1)
    assert count == 0 and np.array_equal(filled, rate, equal_nan=True)
