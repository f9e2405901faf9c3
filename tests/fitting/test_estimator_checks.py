"""scikit-learn's own examination of every mode."""

import pytest
from sklearn.utils.estimator_checks import check_estimator

from fitting.takagi_sugeno import TakagiSugeno, joint, published

MODES = {
    "joint": joint(),
    "published": published().set_params(n_starts=2),
    "published, batch": TakagiSugeno(antecedents="gustafson_kessel", consequents="batch", n_starts=1),
    "joint, square root": TakagiSugeno(antecedents="joint", consequents="square_root", n_starts=1),
}


@pytest.mark.parametrize("mode", MODES)
def test_is_a_scikit_learn_estimator(mode: str) -> None:
    check_estimator(MODES[mode], on_skip=None)
