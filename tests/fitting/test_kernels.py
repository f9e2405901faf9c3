"""Kernels, distances, monomials and the pure kernel model."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from fitting.kernels import KernelModel, gaussian, monomial_powers, monomials, quintic, squared_distances


def test_distances_and_kernels_are_their_definitions() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(7, 3)), rng.normal(size=(5, 3))
    distances = cdist(a, b)
    assert squared_distances(a, b) == pytest.approx(distances**2)
    assert gaussian(distances**2) == pytest.approx(np.exp(-(distances**2) / 2.0))
    assert quintic(distances**2) == pytest.approx(-(distances**5))


def test_monomials_are_all_products_up_to_the_degree() -> None:
    assert monomial_powers(2, 2).tolist() == [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
    assert monomial_powers(0, 3).shape == (1, 0)
    rows = np.array([[2.0, 3.0], [0.0, -1.0]])
    assert monomials(rows, monomial_powers(2, 2)).tolist() == [[1, 2, 3, 4, 6, 9], [1, 0, -1, 0, 0, 1]]


def test_a_row_is_predicted_the_same_in_any_batch() -> None:
    rng = np.random.default_rng(1)
    model = KernelModel(
        np.array([0, 2]),
        np.array([1.0, -2.0]),
        np.array([3.0, 0.5]),
        "gaussian",
        rng.normal(size=(300, 2)),
        rng.normal(size=300),
        monomial_powers(2, 1),
        rng.normal(size=3),
        10.0,
        2.0,
    )
    rows = rng.normal(size=(9001, 3))
    together = model.predict(rows)
    assert np.array_equal(together[::1000], [model.predict(rows[[k]])[0] for k in range(0, 9001, 1000)])
    scaled = (rows[5, [0, 2]] - model.shift) / model.scale
    terms = model.weights @ np.exp(-0.5 * ((scaled - model.supports) ** 2).sum(axis=1))
    by_hand = 10.0 + 2.0 * (terms + model.coefficients @ [1.0, *scaled])
    assert together[5] == pytest.approx(by_hand)
    assert np.isnan(model.predict(np.array([[0.0, 1.0, np.nan]]))).all()
    assert model.predict(np.empty((0, 3))).shape == (0,)
