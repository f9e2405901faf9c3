"""Non-negative least squares against scipy's active-set search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from fitting.random_errors.nonnegative import nonnegative


@given(st.integers(0, 10_000), st.integers(1, 5))
@settings(deadline=None, max_examples=60)
def test_equal_to_scipy(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((12, size)) + rng.uniform(-1.0, 1.0)
    targets = rng.standard_normal((7, 12))
    found = nonnegative(matrix.T @ matrix, targets @ matrix)
    expected = [nnls(matrix, target)[0] for target in targets]
    assert found == pytest.approx(np.array(expected), abs=1e-9)


def test_columns_that_depend_on_each_other_are_no_harm() -> None:
    matrix = np.array([[1.0, 1.0], [2.0, 2.0]])
    found = nonnegative(matrix.T @ matrix, np.array([[5.0, 5.0], [-1.0, -1.0]]))
    assert matrix @ found[0] == pytest.approx([1.0, 2.0])
    assert found[1].tolist() == [0.0, 0.0]
