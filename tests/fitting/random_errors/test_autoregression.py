"""AR(2) with a constant against statsmodels."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from statsmodels.tsa.ar_model import AutoReg

from fitting.random_errors.autoregression import fit_ar2


def series(seed: int, count: int, n: int, mean: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    noise = lfilter([1.0], [1.0, -0.6, -0.25], rng.standard_normal((count, n)), axis=-1)
    return np.asarray(mean + 0.1 * noise)


@pytest.mark.parametrize("mean", [0.0, -10.6, 1e4])
@pytest.mark.parametrize("n", [6, 30, 3000])
def test_equal_to_statsmodels(mean: float, n: int) -> None:
    records = series(1, 5, n, mean)
    ours = fit_ar2(records)
    for i, record in enumerate(records):
        theirs = AutoReg(record, 2, trend="c").fit()
        assert [ours.constant[i], ours.phi1[i], ours.phi2[i]] == pytest.approx(theirs.params, rel=1e-8, abs=1e-8)
        assert [ours.constant_u[i], ours.phi1_u[i], ours.phi2_u[i]] == pytest.approx(theirs.bse, rel=1e-8)
        assert ours.noise_variance[i] == pytest.approx(theirs.sigma2, rel=1e-8)
        assert ours.largest_root[i] == pytest.approx(1.0 / np.abs(theirs.roots).min(), rel=1e-8)


def test_one_series_and_many_are_the_same() -> None:
    records = series(2, 6, 200, 3.0).reshape(2, 3, 200)
    together, alone = fit_ar2(records), fit_ar2(records[1, 2])
    assert together.phi1.shape == (2, 3)
    assert together.phi1[1, 2] == pytest.approx(alone.phi1, rel=1e-12)


def test_the_truth_is_found_and_the_constant_belongs_to_the_mean() -> None:
    found = fit_ar2(series(3, 1, 200_000, 10.0)[0])
    assert [found.phi1, found.phi2] == pytest.approx([0.6, 0.25], abs=0.01)
    assert found.constant_of_mean == pytest.approx(found.constant, rel=1e-3)
    assert found.constant_of_mean == pytest.approx(10.0 * 0.15, rel=0.05)
    assert found.stable


def test_an_explosive_series_is_called_unstable() -> None:
    rng = np.random.default_rng(4)
    assert not fit_ar2(lfilter([1.0], [1.0, -0.9, -0.2], rng.standard_normal(60))).stable


@pytest.mark.parametrize(
    ("record", "message"),
    [(np.arange(5.0), "6 or more"), (np.full(50, 2.0), "frozen"), (np.full(50, np.nan), "not finite")],
)
def test_what_cannot_be_fitted_is_said(record: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_ar2(record)
