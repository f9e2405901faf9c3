"""The training range: what is inside stays untouched, what is outside comes back to its edge."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fitting.reach import MARGIN, MOST_PAIRED, Reach


def along_a_line(n: int = 200, seed: int = 0) -> NDArray[np.float64]:
    """Three temperatures that follow each other closely, as in reference experiment `rlg`."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-30.0, 25.0, (n, 1)) + 0.2 * rng.standard_normal((n, 3)) + [0.0, 1.0, -2.0]


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 60), st.integers(1, 5), st.integers(0, 10**6))
def test_training_rows_are_inside_and_stay_to_the_last_bit(n: int, k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.choice([-3.0, 0.0, 1e-7, 20.0, 1e8], (n, k)) * rng.uniform(0.5, 2.0, (n, k))
    held, outside = Reach.of(rows).bring_inside(rows)
    assert not outside.any()
    assert np.array_equal(held, rows)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 60), st.integers(1, 5), st.integers(0, 10**6))
def test_what_is_brought_inside_is_inside_but_for_rounding(n: int, k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    reach = Reach.of(rng.normal(size=(n, k)))
    held, outside = reach.bring_inside(5.0 * rng.normal(size=(100, k)))
    again, _ = reach.bring_inside(held)
    assert np.allclose(again, held, atol=1e-9)
    assert (held >= reach.low).all() and (held <= reach.high).all()
    assert outside.dtype == bool


def test_beyond_the_box_only_the_input_that_left_it_is_held() -> None:
    grid = np.array([[t, r] for t in (-30.0, 15.0, 60.0) for r in (-180.0, 0.0, 180.0)])
    held, outside = Reach.of(grid).bring_inside(np.array([[70.0, 10.0], [20.0, -200.0], [60.0, 180.0]]))
    assert held.tolist() == [[60.0, 10.0], [20.0, -180.0], [60.0, 180.0]]
    assert outside.tolist() == [True, True, False]


def test_a_combination_that_never_occurred_is_outside_though_every_input_is_in_its_range() -> None:
    rows = along_a_line()
    reach = Reach.of(rows)
    strange = np.array([10.0, -6.0, -8.0])
    held, outside = reach.bring_inside(strange[np.newaxis])
    assert outside.tolist() == [True]
    assert (strange > reach.low).all() and (strange < reach.high).all()
    scaled = (held[0] - reach.centre) / reach.half_range
    assert scaled[0] - scaled[1] <= reach.differences[1, 0] + MARGIN + 1e-12  # type: ignore[index]
    direction = (held[0] - reach.centre) / (strange - reach.centre)
    assert direction[0] == pytest.approx(direction[1]) and 0.0 < direction[0] < 1.0


def test_another_cycle_of_the_same_kind_is_inside() -> None:
    fresh = along_a_line(seed=1)
    box = (fresh >= along_a_line().min(axis=0)).all(axis=1) & (fresh <= along_a_line().max(axis=0)).all(axis=1)
    assert not Reach.of(along_a_line()).bring_inside(fresh[box])[1].any()


def test_nan_is_outside_and_stays() -> None:
    held, outside = Reach.of(along_a_line()).bring_inside(np.array([[np.nan, -10.0, -10.0]]))
    assert outside.tolist() == [True] and np.isnan(held[0]).any()


def test_many_inputs_keep_their_box_only() -> None:
    reach = Reach.of(np.random.default_rng(0).normal(size=(10, MOST_PAIRED + 1)))
    assert reach.sums is None and reach.differences is None
