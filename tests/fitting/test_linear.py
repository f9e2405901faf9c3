"""The linear baseline against numpy and the paper's published figures."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sklearn.utils.estimator_checks import check_estimator

from fitting.linear import LinearCompensation


def test_is_a_scikit_learn_estimator() -> None:
    check_estimator(LinearCompensation(), on_skip=None)


def test_surface_a_gives_the_papers_four_figures(campaign: Callable[..., Any]) -> None:
    """Fitting notes, section 1: max 11.6008, std 4.62689 uncompensated; 3.5006 and 1.7306 after the linear fit."""
    data = campaign(0, noise=0.0)
    error = data.inputs[:, 1] - data.reference
    assert np.abs(error).max() == pytest.approx(11.6008, abs=5e-5)
    assert error.std() == pytest.approx(4.62689, abs=5e-6)
    left = LinearCompensation().fit(data.inputs, data.reference).predict(data.inputs) - data.reference
    assert np.abs(left).max() == pytest.approx(3.5006, abs=5e-5)
    assert left.std() == pytest.approx(1.7306, abs=5e-5)


def test_coefficients_and_their_uncertainties_are_those_of_ordinary_least_squares() -> None:
    rng = np.random.default_rng(0)
    inputs = rng.normal([20.0, 5.0], [30.0, 100.0], (50, 2))
    target = inputs @ [0.01, 0.97] - 0.4 + 0.02 * rng.standard_normal(50)
    design = np.column_stack([np.ones(50), inputs])
    expected, (squares,), _, _ = np.linalg.lstsq(design, target)
    model = LinearCompensation().fit(inputs, target)
    assert model.coefficients_ == pytest.approx(expected, rel=1e-9)
    covariance = squares / 47.0 * np.linalg.inv(design.T @ design)
    assert model.coefficients_u_ == pytest.approx(np.sqrt(covariance.diagonal()), rel=1e-9)


def test_a_constant_column_gets_no_slope() -> None:
    inputs = np.column_stack([np.full(20, 25.0), np.arange(20.0)])
    model = LinearCompensation().fit(inputs, 2.0 * np.arange(20.0) + 1.0)
    assert model.coefficients_ == pytest.approx([1.0, 0.0, 2.0], abs=1e-9)


def test_two_rows_have_no_known_uncertainty() -> None:
    model = LinearCompensation().fit([[0.0, 1.0], [1.0, 2.0]], [0.5, 1.5])
    assert np.isnan(model.coefficients_u_).all()
    assert model.predict([[0.0, 1.0], [1.0, 2.0]]) == pytest.approx([0.5, 1.5])
