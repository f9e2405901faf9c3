"""Blocked cross-validation inside the training rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.rules import Antecedents
from fitting.selection import blocked_folds, can_hold_out, held_out_error, training_error


@given(st.lists(st.floats(-60.0, 60.0), min_size=8, max_size=80))
def test_folds_are_blocks_of_the_first_input(values: list[float]) -> None:
    temperature = np.array(values)
    in_order = blocked_folds(temperature)[np.argsort(temperature, kind="stable")]
    assert np.count_nonzero(np.diff(in_order)) == 7
    assert in_order[0] == 0 and in_order[-1] == 3
    assert np.ptp(np.bincount(in_order, minlength=4)) <= 2


def test_held_out_error_is_that_of_predictions_from_the_other_blocks() -> None:
    rng = np.random.default_rng(0)
    inputs, one_rule = rng.normal(size=(80, 2)), Antecedents(np.zeros((1, 2)), np.ones((1, 2)))
    targets = inputs @ [0.5, -2.0] + 0.3 + 0.1 * rng.standard_normal(80)
    design, folds = np.column_stack([np.ones(80), inputs]), blocked_folds(inputs[:, 0])
    expected = 0.0
    for fold in range(4):
        theta = np.linalg.lstsq(design[folds != fold], targets[folds != fold])[0]
        expected += np.sum((design[folds == fold] @ theta - targets[folds == fold]) ** 2)
    seen: list[int] = []

    def refine(x: np.ndarray, y: np.ndarray) -> Antecedents:
        seen.append(len(y))
        return one_rule

    assert held_out_error(inputs, targets, refine, 0.0) == pytest.approx(expected)
    assert seen == [60] * 4
    in_sample = np.sum((design @ np.linalg.lstsq(design, targets)[0] - targets) ** 2)
    assert training_error(inputs, targets, one_rule, 0.0) == pytest.approx(in_sample)
    assert in_sample < expected


def test_holding_out_takes_twice_as_many_rows_as_unknowns() -> None:
    four = Antecedents(np.zeros((4, 2)), np.ones((4, 2)))
    assert not can_hold_out(55, four) and can_hold_out(56, four)
