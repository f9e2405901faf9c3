"""Models come back from their files to the last bit, and nothing else comes back at all."""

import hashlib
import json
import os
import stat
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fitting.linear import LinearCompensation
from fitting.modelfile import Compensation, ModelFileError, load_model, save_model
from fitting.modelfiles.columns import BIAS_ERROR_DPH, BIAS_ERROR_DPS, RATE, Column
from fitting.modelfiles.kinds import KINDS, kind_of
from fitting.takagi_sugeno import TakagiSugeno

OTHER_OUTPUT = {"mean": 0, "std": 1, "name": "rate", "unit": "rad/s"}
META = {"dut": "gyro-a", "created_utc": "2026-11-22T09:00:00Z"}
Model = LinearCompensation | TakagiSugeno
SLOW = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def fitted(seed: int = 0, kind: str = "joint", n: int = 40, constant: bool = False) -> tuple[Model, Any, Any]:
    rng = np.random.default_rng(seed)
    inputs = rng.uniform([-30.0, -180.0], [60.0, 180.0], (n, 2))
    if constant:
        inputs[:, 0] = 25.0
    target = 0.97 * inputs[:, 1] - 1e-4 * inputs[:, 0] * inputs[:, 1] + rng.normal(size=n)
    quick: dict[str, Any] = {"n_rules": 1 + seed % 4, "n_starts": 1, "max_iter": 5}
    model: Model = LinearCompensation() if kind == "linear" else TakagiSugeno(antecedents=kind, **quick)  # type: ignore[arg-type]
    return model.fit(inputs, target), inputs, target


def saved(path: Path, **changes: Any) -> tuple[Path, dict[str, Any]]:
    save_model(path / "m.json", fitted(3)[0], META)
    document = json.loads((path / "m.json").read_text()) | changes
    (path / "m.json").write_text(json.dumps(document))
    return path / "m.json", document


@SLOW
@given(
    st.integers(0, 10**6),
    st.sampled_from(["linear", "joint", "gustafson_kessel"]),
    st.integers(2, 60),
    st.booleans(),
    st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), max_size=20),
)
def test_predictions_come_back_to_the_last_bit(
    tmp_path: Path, seed: int, kind: str, n: int, constant: bool, elsewhere: list[tuple[float, float]]
) -> None:
    model, inputs, _ = fitted(seed, kind, n, constant)
    save_model(tmp_path / "m.json", model, META)
    loaded = load_model(tmp_path / "m.json")
    rows = np.vstack([inputs, np.array(elsewhere).reshape(-1, 2)])
    assert np.array_equal(loaded.predict(rows[:, 0], rows[:, 1]), model.predict(rows))
    again = tmp_path / "again.json"
    save_model(again, model, META)
    assert again.read_bytes() == (tmp_path / "m.json").read_bytes()


def test_the_file_says_what_it_holds(tmp_path: Path) -> None:
    model, inputs, target = fitted(3)
    save_model(tmp_path / "m.json", model, META, {"random_std_dps": 0.25})
    document = json.loads((tmp_path / "m.json").read_text())
    assert document["meta"] == META
    assert [entry["unit"] for entry in document["inputs"]] == ["degC", "deg/s"]
    assert [entry["min"] for entry in document["inputs"]] == inputs.min(axis=0).tolist()
    assert [entry["mean"] for entry in document["inputs"]] == inputs.mean(axis=0).tolist()
    raw = np.ascontiguousarray(inputs, dtype="<f8").tobytes() + np.ascontiguousarray(target, dtype="<f8").tobytes()
    assert document["training"] == {"sha256": hashlib.sha256(raw).hexdigest(), "rows": 40}
    residual = model.predict(inputs) - target
    assert document["figures_of_merit"]["training_std_dps"] == pytest.approx(residual.std())
    assert document["figures_of_merit"]["random_std_dps"] == 0.25
    assert document["versions"]["numpy"] == np.__version__
    assert document["settings"]["n_rules"] == 4


def test_uncertainties_that_are_not_known_are_null(tmp_path: Path) -> None:
    save_model(tmp_path / "m.json", fitted(0, "linear", n=2)[0], META)
    assert json.loads((tmp_path / "m.json").read_text())["parameters"]["coefficients_u"] is None
    assert isinstance(load_model(tmp_path / "m.json"), Compensation)


def test_predict_broadcasts_and_passes_nan_on(tmp_path: Path) -> None:
    model, _, _ = fitted(1)
    save_model(tmp_path / "m.json", model, META)
    loaded = load_model(tmp_path / "m.json")
    grid = loaded.predict(np.array([[0.0], [20.0]]), np.array([1.0, 2.0, 3.0]))
    assert grid.shape == (2, 3)
    assert grid[1, 2] == model.predict([[20.0, 3.0]])[0]
    assert loaded.predict(20.0, 3.0) == grid[1, 2]
    assert np.isnan(loaded.predict([20.0, np.nan], 3.0)).tolist() == [False, True]
    assert loaded.predict([], []).shape == (0,)


def test_inside_is_the_training_box(tmp_path: Path) -> None:
    model, inputs, _ = fitted(2)
    save_model(tmp_path / "m.json", model, META)
    loaded = load_model(tmp_path / "m.json")
    assert loaded.inside(inputs[:, 0], inputs[:, 1]).all()
    low, high = inputs.min(axis=0), inputs.max(axis=0)
    assert loaded.inside([low[0], low[0] - 1e-9, high[0] + 1e-9, 0.0, 0.0, np.nan], 0.0).tolist() == [
        True, False, False, True, True, False,
    ]  # fmt: skip
    assert loaded.inside(0.0, [high[1], high[1] + 1e-9, -181.0]).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"format": "pickle"}, "format is 'pickle' instead of 'fogbench-model'"),
        ({"version": 3}, "version is 3; this fogbench reads versions 1 and 2"),
        ({"version": 1.0}, "version is a number instead of a whole number"),
        ({"kind": "svm"}, "kind is 'svm'; known kinds"),
        ({"parameters": None}, "parameters is null instead of an object"),
        ({"inputs": []}, "inputs is not a list of 1 to 64 objects"),
        ({"guard": {}}, r"guard.centre\[0\] has null"),
        ({"guard": {"centre": [1e9, 0.0]}}, "guard.centre is outside the ranges"),
        ({"guard": {"centre": [0.0, 0.0], "sums": [[1.0], [2.0]]}}, "guard.differences has null"),
        ({"output": {}}, "output.mean is null instead of a number"),
        (
            {"output": {"mean": 0, "std": 1, "name": "rate", "unit": "rad/s"}},
            "output is 'rate' in 'rad/s'; allowed: rate",
        ),
        ({"training": {"sha256": "abc", "rows": 1}}, "sha256 is not 64 hexadecimal digits"),
        ({"meta": "x"}, "meta is a text instead of an object"),
    ],
)
def test_a_foreign_file_is_refused_with_file_reason_and_way_out(
    tmp_path: Path, changes: dict[str, Any], reason: str
) -> None:
    path, _ = saved(tmp_path, **changes)
    with pytest.raises(ModelFileError, match=reason) as error:
        load_model(path)
    assert str(path) in str(error.value) and "fogbench fit" in str(error.value)


@pytest.mark.parametrize(
    "key", ["format", "version", "kind", "inputs", "output", "guard", "parameters", "training", "versions"]
)
def test_a_missing_key_is_named(tmp_path: Path, key: str) -> None:
    path, document = saved(tmp_path)
    del document[key]
    path.write_text(json.dumps(document))
    with pytest.raises(ModelFileError, match=f"{key} is missing"):
        load_model(path)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("widths", [[1.0, 0.0]] * 4, "width that is not above zero"),
        ("widths", [[1.0]] * 4, "widths.0. has 1 entries"),
        ("centres", [[1.0, 2.0]] * 3, "centres has 3 rows; expected 4"),
        ("centres", [[1.0, True]] * 4, r"centres\[0\]\[1\] is true or false"),
        ("consequents", [], "0 rules; allowed: 1 to 1000"),
        ("consequents", [[1.0, 2.0, 1e999]] * 4, "contains Infinity|not a finite number"),
        ("columns", [1, 0], "columns is not an ascending choice of the inputs 0 to 1"),
        ("columns", [False, True], "columns is not an ascending choice of the inputs 0 to 1"),
        ("consequents_u", [[1.0]], "consequents_u has 1 rows"),
    ],
)
def test_parameters_of_the_wrong_shape_or_value_are_refused(
    tmp_path: Path, name: str, value: object, reason: str
) -> None:
    path, document = saved(tmp_path)
    document["parameters"][name] = value
    path.write_text(json.dumps(document))
    with pytest.raises(ModelFileError, match=reason):
        load_model(path)


def test_a_range_the_wrong_way_round_is_refused(tmp_path: Path) -> None:
    path, document = saved(tmp_path)
    document["inputs"][1]["min"], document["inputs"][1]["max"] = 180.0, -180.0
    path.write_text(json.dumps(document))
    with pytest.raises(ModelFileError, match=r"inputs\[1\] has its min above its max"):
        load_model(path)


@SLOW
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_and_nothing_else_happens(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "m.json").write_bytes(data)
    with pytest.raises(ModelFileError):
        load_model(tmp_path / "m.json")


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


def paths_in(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [path] * bool(path) + [found for key, child in children for found in paths_in(child, (*path, key))]


@settings(SLOW, max_examples=150)
@given(st.data())
def test_a_file_with_anything_anywhere_loads_or_is_refused(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "m.json"
    if not (tmp_path / "good.json").exists():
        save_model(tmp_path / "good.json", fitted(3)[0], META)
    document = json.loads((tmp_path / "good.json").read_text())
    *parents, last = data.draw(st.sampled_from(paths_in(document)))
    node = document
    for key in parents:
        node = node[key]
    node[last] = data.draw(ANYTHING)
    path.write_text(json.dumps(document))
    try:
        loaded = load_model(path)
    except ModelFileError as error:
        assert "m.json" in str(error)
    else:
        assert np.isfinite(loaded.predict(*[[-30.0, 60.0]] * len(loaded.inputs))).all()
        assert np.isfinite(loaded.guarded(*[[-30.0, 60.0]] * len(loaded.inputs))[0]).all()


def test_what_cannot_be_saved_is_refused_and_leaves_no_file(tmp_path: Path) -> None:
    good, inputs, target = fitted(0)
    three = TakagiSugeno(n_starts=1, max_iter=2).fit(np.column_stack([inputs, target]), target)
    huge = LinearCompensation().fit([[0.0, 1.0], [1.0, 2.0], [2.0, 5.0]], [1e40, 2e40, 9e40])
    for model, meta, reason in (
        (TakagiSugeno(), META, "not fitted"),
        (object(), META, "object is not a kind of model"),
        (three, META, "3 inputs instead of temperature and rate"),
        (huge, META, "not a finite number of at most 1e"),
        (good, {"when": object()}, "not JSON serializable"),
        (good, {"figure": float("nan")}, "not JSON compliant"),
    ):
        with pytest.raises(ModelFileError, match=reason):
            save_model(tmp_path / "m.json", model, meta)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_an_error_with_a_way_out(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"cannot be written .*Check that the folder exists"):
        save_model(tmp_path / "missing" / "m.json", fitted(0)[0], META)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    path, _ = saved(tmp_path)
    path.chmod(stat.S_IWUSR)
    with pytest.raises(ModelFileError, match="cannot be read"):
        load_model(path)


@pytest.mark.parametrize("name", ["a\0b", "missing.json", "."])
def test_a_path_that_leads_nowhere_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ModelFileError):
        load_model(tmp_path / name)


def three_temperatures() -> tuple[LinearCompensation, Any, Any]:
    rng = np.random.default_rng(4)
    inputs = rng.uniform(-30.0, 25.0, (80, 1)) + 0.3 * rng.standard_normal((80, 3))
    error = 0.03 * inputs[:, 0] - 0.01 * inputs[:, 2]
    return LinearCompensation().fit(inputs, error), inputs, error


ANODE = (Column("anode", "degC"), Column("cathode", "degC"), Column("case", "degC"))


def test_several_temperatures_and_a_bias_error(tmp_path: Path) -> None:
    model, inputs, error = three_temperatures()
    save_model(tmp_path / "m.json", model, META, inputs=ANODE, output=BIAS_ERROR_DPH)
    loaded = load_model(tmp_path / "m.json")
    assert (loaded.inputs, loaded.output) == (ANODE, BIAS_ERROR_DPH)
    assert np.array_equal(loaded.predict(*inputs.T), model.predict(inputs))
    by_name = loaded.predict(inputs[:, 0], case=inputs[:, 2], cathode=inputs[:, 1])
    assert np.array_equal(by_name, model.predict(inputs))
    rates, outside = loaded.compensate(*inputs.T, rate_dps=0.004 + error / 3600.0)
    assert rates == pytest.approx(np.full(80, 0.004), abs=1e-12) and not outside.any()
    assert json.loads((tmp_path / "m.json").read_text())["figures_of_merit"]["training_std_dph"] < 1e-9


def test_inputs_given_wrongly_and_a_rate_in_vain_are_refused(tmp_path: Path) -> None:
    model, inputs, _ = three_temperatures()
    save_model(tmp_path / "m.json", model, META, inputs=ANODE, output=BIAS_ERROR_DPS)
    loaded = load_model(tmp_path / "m.json")
    for columns, named in (
        (inputs.T[:2], {}),
        (inputs.T, {"case": 1.0}),
        (inputs.T[:2], {"shell": 1.0}),
        (inputs.T[:2], {"anode": 1.0}),
    ):
        with pytest.raises(ValueError, match=r"3 inputs: anode \(degC\), cathode \(degC\), case \(degC\)"):
            loaded.predict(*columns, **named)
    with pytest.raises(ValueError, match="pass the gyro's output as rate_dps"):
        loaded.compensate(*inputs.T)
    save_model(tmp_path / "r.json", fitted(0)[0], META)
    with pytest.raises(ValueError, match="leave rate_dps out"):
        load_model(tmp_path / "r.json").compensate(20.0, 10.0, rate_dps=10.0)


@pytest.mark.parametrize(
    ("inputs", "output", "reason"),
    [
        (ANODE[:2], BIAS_ERROR_DPH, "2 inputs are named and it was fitted on 3"),
        ((*ANODE[:2], ANODE[0]), BIAS_ERROR_DPH, "two inputs have the same name"),
        (ANODE, RATE, "no input is rate_output"),
        (ANODE, Column("bias_error", "rad/s"), "is not one of"),
    ],
)
def test_columns_that_do_not_fit_are_refused(tmp_path: Path, inputs: Any, output: Column, reason: str) -> None:
    with pytest.raises(ModelFileError, match=reason):
        save_model(tmp_path / "m.json", three_temperatures()[0], META, inputs=inputs, output=output)


@pytest.mark.parametrize("name", ["", "Anode", "a b", "9a", "a" * 65])
def test_a_name_of_a_column_is_lower_case_and_short(name: str) -> None:
    with pytest.raises(ValueError, match="lower case letters"):
        Column(name, "degC")


def test_outside_its_range_a_model_holds_the_temperature_and_goes_on_in_rate_with_the_linear_slope(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(7)
    inputs = rng.uniform([-30.0, -180.0], [60.0, 180.0], (300, 2))
    target = 0.95 * inputs[:, 1] + 1e-3 * inputs[:, 0] ** 2
    model = TakagiSugeno(4, n_starts=1).fit(inputs, target)
    save_model(tmp_path / "m.json", model, META)
    loaded = load_model(tmp_path / "m.json")
    (low, _), (high, most) = loaded.input_min, loaded.input_max
    slope = np.linalg.lstsq(np.column_stack([np.ones(300), inputs]), 0.95 * inputs[:, 1] + 1e-3 * inputs[:, 0] ** 2)[0][
        2
    ]
    values, outside = loaded.compensate(
        [low - 50.0, high + 50.0, 10.0, 10.0, np.nan], [3.0, 3.0, most + 40.0, 5.0, 1.0]
    )
    assert outside.tolist() == [True, True, True, False, True]
    assert values[0] == loaded.predict(low, 3.0) and values[1] == loaded.predict(high, 3.0)
    assert values[2] == pytest.approx(loaded.predict(10.0, most) + 40.0 * slope, rel=1e-12)
    assert values[3] == loaded.predict(10.0, 5.0)
    assert np.isnan(values[4])


def test_a_file_of_version_1_is_read_as_it_always_was() -> None:
    """Written by version 0.1.0 of the product, with the predictions it made then."""
    loaded = load_model(Path(__file__).with_name("files") / "model_version_1.json")
    expected = [9.730871248406034, -87.1202432214964, 173.5228577418746]
    assert loaded.predict([-30.0, 20.0, 60.0], [10.0, -90.0, 180.0]) == pytest.approx(expected, rel=1e-14)
    values, outside = loaded.compensate([20.0, 20.0], [173.1, 183.1])
    assert outside.tolist() == [False, True]
    assert values[1] == pytest.approx(values[0] + 10.0)  # it states no slope: the correction is held


def test_a_file_cannot_name_a_module(tmp_path: Path) -> None:
    for kind in ("kinds", "document", "fitting.modelfiles.linear", "../os"):
        path, _ = saved(tmp_path, kind=kind)
        with pytest.raises(ModelFileError, match="known kinds"):
            load_model(path)


def test_every_kind_has_its_estimator_and_its_codec() -> None:
    for name, kind in KINDS.items():
        module, cls = kind.estimator.split(":")
        estimator = getattr(import_module(module), cls)
        assert kind_of(estimator()) == name
        assert callable(kind.load().describe) and callable(kind.load().build)
