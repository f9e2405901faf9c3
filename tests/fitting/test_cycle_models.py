"""The cycle models by name: what they look at, and that each can be made."""

from importlib.metadata import entry_points

import numpy as np
import pytest

from fitting.cycle_models import history, temperature_and_slope, temperatures
from fitting.lag_bank_history import TIME_CONSTANTS_S

RAMP = np.stack([20.0 + np.arange(50) * 0.5, 21.0 + np.arange(50) * 0.5], axis=1)


def test_temperature_and_slope_of_a_ramp() -> None:
    features = temperature_and_slope(RAMP, 100.0)
    np.testing.assert_allclose(features[:, 0], RAMP.mean(axis=1))
    np.testing.assert_allclose(features[:, 1], 0.3)  # 0.5 degC in 100 s


def test_what_the_models_look_at_has_a_row_for_each_row() -> None:
    assert temperatures(RAMP, 100.0) is RAMP
    assert history(RAMP, 100.0).shape == (50, 1 + 1 + 1 + len(TIME_CONSTANTS_S))


@pytest.mark.parametrize("name", [item.name for item in entry_points(group="fogbench.cycle_models")])
@pytest.mark.filterwarnings("ignore")
def test_every_model_that_can_be_named_can_be_fitted(name: str) -> None:
    model = next(iter(entry_points(group="fogbench.cycle_models", name=name))).load()()
    rng = np.random.default_rng(1)
    temperature = 20.0 + np.cumsum(rng.standard_normal((40, 1)), axis=0)
    inputs = model.features(temperature, 100.0)
    fitted = model.make().fit(inputs, 0.1 * temperature[:, 0] + 1e-3 * rng.standard_normal(40))
    assert np.isfinite(fitted.predict(inputs)).all()
