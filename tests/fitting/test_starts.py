"""Where the joint optimisation starts from."""

import numpy as np
import pytest

from fitting.gustafson_kessel import Clustering
from fitting.starts import grid, grid_sets, product_space, projected, starting_points


@pytest.mark.parametrize(
    ("n_rules", "n_inputs", "expected"),
    [(1, 2, (1, 1)), (4, 2, (2, 2)), (6, 2, (2, 3)), (5, 2, (1, 5)), (12, 2, (4, 3)), (7, 1, (7,)), (8, 3, (2, 2, 2))],
)
def test_rules_are_spread_evenly_over_inputs(n_rules: int, n_inputs: int, expected: tuple[int, ...]) -> None:
    assert grid_sets(n_rules, n_inputs) == expected


def test_a_plain_grid_sits_on_quantiles() -> None:
    inputs = np.column_stack([np.linspace(0.0, 8.0, 81), np.linspace(-4.0, 4.0, 81)])
    assert grid(inputs, (2, 2)).antecedents.centres.tolist() == [[2.0, -2.0], [2.0, 2.0], [6.0, -2.0], [6.0, 2.0]]


def test_a_shifted_grid_moves_one_input_only() -> None:
    inputs = np.random.default_rng(0).normal(size=(50, 2))
    plain, moved = grid(inputs, (2, 2)).antecedents, grid(inputs, (2, 2), 1, 2.0).antecedents
    assert np.array_equal(plain.centres[:, 0], moved.centres[:, 0])
    assert moved.centres[:, 1].mean() == pytest.approx(2.0)
    assert np.ptp(moved.centres[:, 1]) == pytest.approx(np.ptp(plain.centres[:, 1]))


@pytest.mark.parametrize("n_inputs", [1, 2, 5])
@pytest.mark.parametrize("n_starts", [1, 2, 3, 5, 9, 14])
def test_as_many_starts_as_asked_for_and_all_different(n_inputs: int, n_starts: int) -> None:
    inputs = np.random.default_rng(1).normal(size=(40, n_inputs))
    starts = starting_points(inputs, inputs.sum(axis=1), 4, n_starts, 2.0, np.random.default_rng(2))
    assert len(starts) == n_starts
    assert starts[0].sets is not None
    assert len({start.antecedents.centres.tobytes() for start in starts}) == n_starts
    assert all(start.antecedents.centres.shape == (4, n_inputs) for start in starts)


def test_starts_are_the_same_for_the_same_seed() -> None:
    inputs = np.random.default_rng(3).normal(size=(40, 2))
    first, second = (
        starting_points(inputs, inputs[:, 0], 4, 5, 2.0, np.random.default_rng(4))[4].antecedents for _ in range(2)
    )
    assert np.array_equal(first.centres, second.centres) and np.array_equal(first.widths, second.widths)


def test_projection_is_the_papers_width() -> None:
    """sigma_jk^2 = sum_i mu_ji (x_ki - v_jk)^2 / sum_i mu_ji, with mu itself and not its power."""
    rng = np.random.default_rng(5)
    inputs, memberships = rng.normal(size=(30, 2)), rng.random((3, 30))
    clustering = Clustering(memberships, rng.normal(size=(3, 3)), np.zeros((3, 3, 3)), 0.0, 1, True)
    found = projected(clustering, inputs)
    for j in range(3):
        for k in range(2):
            square = sum(memberships[j, i] * (inputs[i, k] - clustering.centres[j, k]) ** 2 for i in range(30))
            assert found.widths[j, k] ** 2 == pytest.approx(square / memberships[j].sum())
    assert np.array_equal(found.centres, clustering.centres[:, :2])


def test_a_constant_target_is_no_dimension_of_the_product_space() -> None:
    inputs = np.random.default_rng(6).normal(size=(10, 2))
    assert product_space(inputs, np.zeros(10)).shape == (10, 2)
    assert product_space(inputs, np.arange(10.0)).shape == (10, 3)
