"""Random rows, and whole dwells left out."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.splits import SplitNotPossible, SplitPlan


@pytest.mark.parametrize(
    ("plan", "expected"), [(SplitPlan(train_count=448), 448), (SplitPlan(train_fraction=0.5), 324), (SplitPlan(), 454)]
)
def test_as_many_training_rows_as_asked_for(plan: SplitPlan, expected: int) -> None:
    assert plan.random_training_rows(648).sum() == expected


def test_the_seed_decides_which_rows() -> None:
    first, again, other = (SplitPlan(seed=seed).random_training_rows(100) for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


@pytest.mark.parametrize("plan", [SplitPlan(train_count=10), SplitPlan(train_count=11), SplitPlan(train_count=1)])
def test_a_split_with_an_empty_side_is_not_possible(plan: SplitPlan) -> None:
    with pytest.raises(SplitNotPossible, match="of 10"):
        plan.random_training_rows(10)


@given(st.lists(st.integers(0, 30), min_size=40, max_size=200), st.sampled_from(["interleaved", "seeded"]))
def test_a_dwell_is_never_divided_and_every_fold_has_one(labels: list[int], order: Any) -> None:
    groups = np.array(labels)
    folds = min(4, len(set(labels)))
    if folds < 2:
        return
    fold = SplitPlan(folds=folds, order=order).fold_of_rows(groups, groups * 5.0)
    assert set(fold) == set(range(folds))
    assert all(len(set(fold[groups == label])) == 1 for label in set(labels))


def test_interleaved_folds_follow_temperature_and_not_the_order_measured() -> None:
    groups = np.repeat([0, 1, 2, 3, 4, 5], 2)
    temperature = np.repeat([60.0, -30.0, 40.0, -10.0, 20.0, 0.0], 2)
    fold = SplitPlan(folds=2).fold_of_rows(groups, temperature)
    assert fold.reshape(6, 2)[:, 0].tolist() == [1, 0, 0, 1, 1, 0]


def test_too_few_dwells_are_named_with_the_way_out() -> None:
    with pytest.raises(SplitNotPossible, match=r"6 folds need as many temperatures, there are 3; measure at more"):
        SplitPlan().fold_of_rows(np.array([0, 1, 2]), np.zeros(3))


@pytest.mark.parametrize(
    "bad",
    [
        {"train_fraction": 0.5, "train_count": 5},
        {"train_fraction": 1.0},
        {"train_fraction": float("nan")},
        {"train_count": 0},
        {"folds": 1},
        {"order": "shuffled"},
    ],
)
def test_a_bad_plan_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        SplitPlan(**bad)
