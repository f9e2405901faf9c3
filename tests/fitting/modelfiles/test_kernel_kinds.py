"""Polynomials and kernel models come back from their files to the last bit, and damaged ones do not."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.gaussian_process import GaussianProcess
from fitting.ls_svm import LeastSquaresSVM
from fitting.modelfile import ModelFileError, load_model, save_model
from fitting.polynomial import PolynomialCompensation
from fitting.rbf import RadialBasisSpline
from fitting.svr import SupportVectorRegression

KINDS: dict[str, Any] = {
    "polynomial": PolynomialCompensation(4),
    "ls_svm": LeastSquaresSVM(gamma=100.0, sigma=1.0),
    "rbf": RadialBasisSpline(),
    "gaussian_process": GaussianProcess(),
    "svr": SupportVectorRegression(search="none", C=10.0, trend="linear"),
}


def rows(constant: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(0)
    inputs = rng.uniform([-30.0, -180.0], [60.0, 180.0], (50, 2))
    if constant:
        inputs[:, 0] = 25.0
    return inputs, 0.97 * inputs[:, 1] + np.tanh(inputs[:, 0] / 20.0) + 0.01 * rng.standard_normal(50)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("constant", [False, True])
def test_predictions_come_back_to_the_last_bit(tmp_path: Path, kind: str, constant: bool) -> None:
    inputs, target = rows(constant)
    model = KINDS[kind].fit(inputs, target)
    save_model(tmp_path / "m.json", model, {})
    loaded = load_model(tmp_path / "m.json")
    assert loaded.document["kind"] == kind
    elsewhere = np.random.default_rng(1).uniform([-60.0, -300.0], [90.0, 300.0], (500, 2))
    assert np.array_equal(loaded.predict(*elsewhere.T), model.predict(elsewhere))
    assert np.array_equal(loaded.predict(*inputs.T), model.predict(inputs))
    assert np.isnan(loaded.predict(25.0, np.nan))


@pytest.mark.parametrize(
    ("kind", "name", "value", "reason"),
    [
        ("ls_svm", "kernel", "cubic", "kernel is 'cubic'; known kernels: 'gaussian', 'quintic'"),
        ("ls_svm", "scale", [0.0, 1.0], "scale has a value that is not above zero"),
        ("ls_svm", "weights", [1.0], r"weights has 1 entries; expected a list of 50"),
        ("ls_svm", "supports", [[1.0, 2.0, 3.0]], r"supports\[0\] has 3 entries"),
        ("ls_svm", "supports", [[1.0, 2.0]] * 5001, "supports has 5001 rows; allowed: up to 5000"),
        ("rbf", "powers", [[0.5, 0.0]] * 6, "not a whole number from 0 to 30"),
        ("rbf", "powers", [[31.0, 0.0]] * 6, "not a whole number from 0 to 30"),
        ("rbf", "powers", [], "powers has 0 terms"),
        ("polynomial", "half", [1.0, -1.0], "half has a value that is not above zero"),
        ("polynomial", "coefficients", [1.0], "coefficients has 1 entries"),
        ("polynomial", "coefficients_u", [1.0], "coefficients_u has 1 entries"),
        ("polynomial", "columns", [0, 2], "not an ascending choice of the inputs 0 to 1"),
        ("svr", "output_scale", None, "output_scale is null"),
    ],
)
def test_damaged_parameters_are_refused(tmp_path: Path, kind: str, name: str, value: Any, reason: str) -> None:
    save_model(tmp_path / "m.json", KINDS[kind].fit(*rows()), {})
    document = json.loads((tmp_path / "m.json").read_text())
    document["parameters"][name] = value
    (tmp_path / "m.json").write_text(json.dumps(document))
    with pytest.raises(ModelFileError, match=reason):
        load_model(tmp_path / "m.json")
