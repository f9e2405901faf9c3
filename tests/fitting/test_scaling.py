"""Columns are z-scored, and constant ones left out."""

import numpy as np
import pytest

from fitting.scaling import Scaling, scale_target


def test_columns_that_vary_get_mean_zero_and_std_one() -> None:
    values = np.random.default_rng(0).normal(50.0, 7.0, (200, 3))
    scaled = Scaling.of(values).apply(values)
    assert np.allclose(scaled.mean(axis=0), 0.0, atol=1e-12)
    assert np.allclose(scaled.std(axis=0), 1.0)


@pytest.mark.parametrize("constant", [0.0, 3.0, 1e9, 0.1])
def test_a_constant_column_is_left_out(constant: float) -> None:
    values = np.column_stack([np.full(30, constant), np.arange(30.0)])
    scaling = Scaling.of(values)
    assert scaling.columns.tolist() == [1]
    assert scaling.apply(values).shape == (30, 1)


def test_a_column_that_is_constant_but_for_rounding_is_left_out() -> None:
    values = np.column_stack([np.full(30, 0.1) + np.spacing(0.1) * (np.arange(30) % 2), np.arange(30.0)])
    assert Scaling.of(values).columns.tolist() == [1]


def test_a_small_column_is_not_constant() -> None:
    values = 1e-9 * np.arange(5.0)[:, np.newaxis]
    assert Scaling.of(values).columns.tolist() == [0]


def test_a_constant_target_keeps_its_mean() -> None:
    scaled, mean, std = scale_target(np.full(10, 4.25))
    assert (mean, std) == (4.25, 1.0)
    assert not scaled.any()
