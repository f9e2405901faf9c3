"""scikit-learn's own examination of every mode."""

from typing import Any

import pytest
from sklearn.utils.estimator_checks import check_estimator

from fitting.automatic import AutomaticCompensation
from fitting.gaussian_process import GaussianProcess
from fitting.linear import LinearCompensation
from fitting.ls_svm import LeastSquaresSVM
from fitting.polynomial import PolynomialCompensation
from fitting.rbf import RadialBasisSpline
from fitting.svr import SupportVectorRegression
from fitting.takagi_sugeno import TakagiSugeno, automatic, joint, published

MODES: dict[str, Any] = {
    "joint": joint(),
    "published": published().set_params(n_starts=2),
    "published, batch": TakagiSugeno(antecedents="gustafson_kessel", consequents="batch", n_starts=1),
    "joint, square root": TakagiSugeno(antecedents="joint", consequents="square_root", n_starts=1),
    "tied": TakagiSugeno(structure="tied"),
    "linear": LinearCompensation(),
    "polynomial": PolynomialCompensation(),
    "LS-SVM": LeastSquaresSVM(),
    "radial basis spline": RadialBasisSpline(),
    "Gaussian process": GaussianProcess(),
    "SVR": SupportVectorRegression(search="none"),
    "automatic": AutomaticCompensation(
        candidates=[("linear", LinearCompensation()), ("cubic", PolynomialCompensation())]
    ),
}


@pytest.mark.parametrize("mode", MODES)
def test_is_a_scikit_learn_estimator(mode: str) -> None:
    check_estimator(MODES[mode], on_skip=None)


SEARCHING: dict[str, Any] = {
    "automatic rules": automatic(),
    "automatic, default candidates": AutomaticCompensation(),
    "SVR, grid": SupportVectorRegression(),
}


@pytest.mark.long
@pytest.mark.parametrize("mode", SEARCHING)
def test_is_a_scikit_learn_estimator_when_it_searches(mode: str) -> None:
    """A minute each: hundreds of fits, each with a search of its own."""
    check_estimator(SEARCHING[mode], on_skip=None)
