"""The two searches for antecedents."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.antecedents import SearchSettings, search_joint, search_published
from fitting.gustafson_kessel import gustafson_kessel, random_partitions
from fitting.scaling import Scaling, scale_target
from fitting.selection import held_out_error, training_error
from fitting.starts import product_space, projected

SETTINGS = SearchSettings(n_rules=4, n_starts=3, fuzziness=2.0, tol=1e-4, max_iter=60, ridge=1e-8)


def scaled(data: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return Scaling.of(data.inputs).apply(data.inputs), scale_target(data.reference)[0]


def test_published_keeps_the_start_that_predicts_held_out_blocks_best(campaign: Callable[..., Any]) -> None:
    inputs, targets = scaled(campaign(0))
    found = search_published(inputs, targets, SETTINGS, np.random.default_rng(1))
    partitions = random_partitions(3, 4, len(targets), np.random.default_rng(1))
    runs = gustafson_kessel(product_space(inputs, targets), partitions, max_iter=60)
    candidates = [projected(run, inputs) for run in runs]
    errors = [held_out_error(inputs, targets, lambda x, y, one=one: one, 1e-8) for one in candidates]  # type: ignore[misc]
    assert np.ptp(errors) > 0.0
    assert np.array_equal(found.antecedents.centres, candidates[int(np.argmin(errors))].centres)
    assert found.n_iter <= 60


def test_sets_are_shared_where_that_is_good_enough(campaign: Callable[..., Any]) -> None:
    inputs, targets = scaled(campaign(0, dwell_errors=True))
    assert search_joint(inputs, targets, SETTINGS, np.random.default_rng(0)).sets == (2, 2)


def test_sets_of_their_own_where_shared_ones_cannot_follow() -> None:
    """A ridge across both inputs: no product of memberships lies along it."""
    inputs = np.random.default_rng(2).uniform(-1.7, 1.7, (400, 2))
    targets = np.tanh(4.0 * (inputs[:, 0] + inputs[:, 1]))
    found = search_joint(inputs, targets, SETTINGS, np.random.default_rng(3))
    assert found.sets is None
    assert training_error(inputs, targets, found.antecedents, 1e-8) / 400 < 1e-3


@pytest.mark.parametrize("search", [search_joint, search_published])
def test_same_generator_state_same_antecedents(search: Any) -> None:
    rng = np.random.default_rng(4)
    inputs = rng.normal(size=(70, 2))
    first, second = (search(inputs, inputs[:, 0] ** 2, SETTINGS, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.antecedents.centres, second.antecedents.centres)
    assert np.array_equal(first.antecedents.widths, second.antecedents.widths)
