"""Networks, lag banks and models of whole records: saved and read back, to the last bit; damaged files are refused."""

import copy
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.linear_model import LinearRegression

from fitting.csapso import CsapsoNetwork
from fitting.cycle_model import ThermalCycleCompensation, lag_bank
from fitting.lag_bank import LagBankCompensation
from fitting.modelfile import ModelFileError, load_model, save_model
from fitting.modelfiles.columns import BIAS_ERROR_DPH, Column
from fitting.modelfiles.kinds import codec_of, kind_of
from fitting.network import BackPropagationNetwork, second_order
from fitting.strict_json import Refused
from tests.fitting import twins

INPUTS = [Column("anode", "degC"), Column("cathode", "degC"), Column("case", "degC")]
CYCLE = twins.rlg(0)


def _fitted() -> dict[str, Any]:
    x, y = CYCLE.temperatures_degc, CYCLE.bias_dph
    swarm = CsapsoNetwork(4, "stable", "none", particles=10, iterations=10)
    models = {
        "network": BackPropagationNetwork(4, epochs=50),
        "network with a linear path": second_order().set_params(epochs=10, n_starts=1),
        "swarm": swarm,
        "lag bank of temperatures": LagBankCompensation(),
        "records": lag_bank(),
        "records, steady, no lags": ThermalCycleCompensation(time_constants_s=(), start="steady"),
        "records, network inside": ThermalCycleCompensation(BackPropagationNetwork(3, epochs=20)),
        "records, numbered": ThermalCycleCompensation(record_column=2),
    }
    numbered = np.column_stack([x[:, :2], np.arange(len(x)) // 200])
    return {name: model.fit(numbered if "numbered" in name else x, y) for name, model in models.items()}


FITTED = _fitted()


def _document(name: str, path: Path) -> dict[str, Any]:
    save_model(path, FITTED[name], {"dut": "twin"}, inputs=INPUTS, output=BIAS_ERROR_DPH)
    found: dict[str, Any] = json.loads(path.read_text())
    return found


@pytest.mark.parametrize("name", FITTED)
def test_reads_back_the_same_predictions_to_the_last_bit(name: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    _document(name, path)
    test = twins.rlg(0, 1).temperatures_degc.copy()
    if "numbered" in name:
        test[:, 2] = np.arange(len(test)) // 100
    read = load_model(path)
    assert np.array_equal(read.predict(*test.T), FITTED[name].predict(test))
    assert read.document["kind"] == kind_of(FITTED[name])


def test_a_saved_model_is_applied_as_a_stream(tmp_path: Path) -> None:
    _document("records", tmp_path / "model.json")
    model: Any = load_model(tmp_path / "model.json").model
    stream = model.stream(100.0)
    test = twins.rlg(0, 1).temperatures_degc
    parts = [stream.feed(test[k : k + 7]) for k in range(0, len(test), 7)]
    assert np.concatenate([*parts, stream.finish()]) == pytest.approx(FITTED["records"].predict(test), abs=1e-12)


def test_a_regressor_without_a_file_format_is_refused(tmp_path: Path) -> None:
    model = ThermalCycleCompensation(LinearRegression()).fit(CYCLE.temperatures_degc, CYCLE.bias_dph)
    with pytest.raises(ModelFileError, match="LinearRegression"):
        save_model(tmp_path / "model.json", model, {}, inputs=INPUTS, output=BIAS_ERROR_DPH)


def _wrong() -> list[tuple[str, list[str | int], Any]]:
    """Model, path into its parameters, and a value that must not be there."""
    return [
        ("network", ["activation"], "relu"),
        ("network", ["std", 0], 0.0),
        ("network", ["thresholds"], []),
        ("network", ["hidden_weights", 0, 0], "1"),
        ("network", ["output_weights"], [1.0]),
        ("network with a linear path", ["linear_path"], [1.0]),
        ("lag bank of temperatures", ["degree"], -1),
        ("lag bank of temperatures", ["degree"], 10**6),
        ("lag bank of temperatures", ["columns"], [0, 1]),
        ("lag bank of temperatures", ["columns"], [2, 1]),
        ("lag bank of temperatures", ["std", 0], -1.0),
        ("lag bank of temperatures", ["cross"], 1),
        ("lag bank of temperatures", ["coefficients"], []),
        ("lag bank of temperatures", ["guard", "low", 0], 1e9),
        ("lag bank of temperatures", ["guard", "whitening"], [[1.0]]),
        ("lag bank of temperatures", ["fallback"], [1.0]),
        ("records", ["period_s"], 0.0),
        ("records", ["period_s"], 1e-6),
        ("records", ["time_constants_s"], [1.0] * 65),
        ("records", ["time_constants_s", 0], -5.0),
        ("records", ["start"], "cold"),
        ("records", ["record_column"], 3),
        ("records", ["record_column"], True),
        ("records", ["regressor", "kind"], "thermal_cycle"),
        ("records", ["regressor", "kind"], "pickle"),
        ("records", ["regressor", "parameters"], {}),
        ("records", ["time_constants_s"], [100.0]),
    ]


@pytest.mark.parametrize(("name", "where", "value"), _wrong())
def test_parameters_that_do_not_fit_are_refused(name: str, where: list[str | int], value: Any) -> None:
    kind = kind_of(FITTED[name])
    parameters = copy.deepcopy(codec_of(kind).describe(FITTED[name]))
    parent: Any = parameters
    for key in where[:-1]:
        parent = parent[key]
    parent[where[-1]] = value
    with pytest.raises(Refused):
        codec_of(kind).build(parameters, 3)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(FITTED)), st.integers(0, 10**6))
def test_whatever_is_accepted_predicts_without_failing(name: str, seed: int) -> None:
    """Every number replaced by some other: refused, or a model that predicts, NaN only for rows with NaN or after."""
    rng, kind = np.random.default_rng(seed), kind_of(FITTED[name])

    def other(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: other(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [other(inner) for inner in value]
        if isinstance(value, float) and rng.uniform() < 0.2:
            return float(rng.choice([0.0, -1.0, 1e-20, 1e30, -1e30]))
        return value

    parameters = other(codec_of(kind).describe(FITTED[name]))
    rows = np.array([[25.0, 24.0, 23.0], [1e30, -1e30, 1e30], [0.0, 0.0, 0.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            model = codec_of(kind).build(parameters, 3)
        except Refused:
            return
        assert np.isfinite(model.predict(rows)).all()
        assert np.isnan(model.predict(np.full((1, 3), np.nan))).all()
