"""Exported C, compiled without a warning, says what the model in Python says, inside its range and outside."""

import functools
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.base import clone

from fitting.export.c99 import Exported, export_c
from fitting.export.form import Form
from fitting.export.forms import NotExported, form_of
from fitting.export.precision import DOUBLE, FLOAT, Precision, in_precision, rounding_bound
from fitting.export.text import identifier
from fitting.gaussian_process import GaussianProcess
from fitting.lag_bank import LagBankCompensation
from fitting.linear import LinearCompensation
from fitting.ls_svm import LeastSquaresSVM
from fitting.modelfile import Compensation, load_model, save_model
from fitting.modelfiles.columns import BIAS_ERROR_DPH, BIAS_ERROR_DPS, CAMPAIGN_INPUTS, RATE_INPUT, Column
from fitting.modelfiles.kinds import KINDS, kind_of
from fitting.network import BackPropagationNetwork
from fitting.polynomial import PolynomialCompensation
from fitting.rbf import RadialBasisSpline
from fitting.svr import SupportVectorRegression
from fitting.takagi_sugeno import TakagiSugeno
from tests.fitting.conftest import make_campaign
from tests.fitting.export.compiling import Compiled, compensation, needs_compiler, run

ESTIMATORS: dict[str, Any] = {
    "linear": LinearCompensation(),
    "rules": TakagiSugeno(n_starts=1, max_iter=20),
    "rules_published": TakagiSugeno(antecedents="gustafson_kessel", n_starts=1, max_iter=20),
    "polynomial": PolynomialCompensation(degree=5),
    "network_sigmoid": BackPropagationNetwork(epochs=100),
    "network_tanh": BackPropagationNetwork(
        hidden=4, training="levenberg_marquardt", epochs=20, activation="tanh", linear_path=True
    ),
    "ls_svm": LeastSquaresSVM(),
    "svr": SupportVectorRegression(),
    "gaussian_process": GaussianProcess(),
    "spline": RadialBasisSpline(smoothing=1e-6),
    "lag_bank": LagBankCompensation(),
}
# Of the largest output. Where large weights of kernels cancel, Python itself is no better than a few ulps of the sum of
# their sizes, which is what `rounding_bound` is made of.
A_FEW_ULPS = 8.0
CANCELLING = ("ls_svm", "svr", "gaussian_process", "spline")


@functools.cache
def fitted(name: str, inputs: int = 2, constant: bool = False) -> Compensation:
    campaign = make_campaign(0)
    rows, target = campaign.inputs[::4].copy(), campaign.reference[::4]
    if constant:
        rows[:, 0] = 25.0
    columns = list(CAMPAIGN_INPUTS)
    if inputs == 3:
        lagging = rows[:, 0] + np.random.default_rng(1).uniform(-2.0, 2.0, len(rows))
        rows, columns = np.column_stack([rows, lagging]), [*columns, Column("temperature_2", "degC")]
    return compensation(clone(ESTIMATORS[name]).fit(rows, target), columns)


def form(model: Compensation) -> Form:
    return form_of(model.model, model.inputs, model.output)


def rows_around(model: Compensation, n: int = 3000, seed: int = 1) -> NDArray[np.float64]:
    """Rows of which some are inside the training range, and some outside to every side."""
    reach = model.reach
    spread = np.random.default_rng(seed).uniform(-1.6, 1.6, (n, len(reach.low)))
    spread[: n // 2] *= 0.5
    rows = 0.5 * (reach.low + reach.high) + spread * reach.half_range
    constant = reach.low == reach.high
    rows[: n // 4, constant] = reach.low[constant]
    return np.asarray(rows)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., tuple[Compensation, Compiled]]]:
    kept: dict[Any, tuple[Compensation, Compiled]] = {}

    def build(name: str, precision: Precision = DOUBLE, **how: Any) -> tuple[Compensation, Compiled]:
        key = (name, precision.name, *how.items())
        if key not in kept:
            model = fitted(name, **how)
            kept[key] = model, Compiled(tmp_path_factory.mktemp(name), export_c(model, identifier(name), precision))
        return kept[key]

    yield build


Build = Callable[..., tuple[Compensation, Compiled]]


@needs_compiler
@pytest.mark.parametrize("name", ESTIMATORS)
def test_double_equals_python_to_a_few_ulps(built: Build, name: str) -> None:
    model, compiled = built(name)
    rows = rows_around(model)
    expected, outside = model.guarded(*rows.T)
    values, flags = compiled(rows)
    assert np.array_equal(flags, outside) and 500 < outside.sum() < len(rows) - 500
    difference = np.abs(values - expected)
    if name not in CANCELLING:
        assert difference.max() <= A_FEW_ULPS * np.spacing(np.abs(expected).max())
    assert (difference <= rounding_bound(model, form(model), rows, DOUBLE)).all()


@needs_compiler
@pytest.mark.parametrize("name", ESTIMATORS)
def test_float_stays_within_its_stated_rounding(built: Build, name: str) -> None:
    model, compiled = built(name, FLOAT)
    rounded = in_precision(model, FLOAT)
    rows = rows_around(model).astype(np.float32).astype(np.float64)
    expected, outside = rounded.guarded(*rows.T)
    values, flags = compiled(rows)
    # rows within rounding of an edge of the range may be told apart either way; there are hardly any
    assert (flags != outside).sum() <= 2
    assert (np.abs(values - expected) <= rounding_bound(rounded, form(rounded), rows, FLOAT)).all()


@needs_compiler
@pytest.mark.parametrize("name", ["linear", "rules", "polynomial", "network_sigmoid", "network_tanh"])
def test_float_of_small_models_is_good_to_1e_5_of_the_range(built: Build, name: str) -> None:
    model, compiled = built(name, FLOAT)
    rows = rows_around(model)
    difference = compiled(rows)[0] - model.guarded(*rows.T)[0]
    assert np.abs(difference).max() <= 1e-5 * 180.0


@needs_compiler
@pytest.mark.parametrize("precision", [DOUBLE, FLOAT])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_selftest_passes(built: Build, name: str, precision: Precision) -> None:
    assert built(name, precision)[1].selftest() == 0


@needs_compiler
@pytest.mark.parametrize("name", ["linear", "rules", "polynomial", "network_tanh", "gaussian_process"])
@pytest.mark.parametrize("how", [{"constant": True}, {"inputs": 3}])
@pytest.mark.parametrize("precision", [DOUBLE, FLOAT])
def test_a_constant_input_and_three_inputs(built: Build, name: str, how: dict[str, Any], precision: Precision) -> None:
    model, compiled = built(name, precision, **how)
    rounded = in_precision(model, precision)
    rows = rows_around(model, 400).astype(precision.dtype).astype(np.float64)
    expected, outside = rounded.guarded(*rows.T)
    values, flags = compiled(rows)
    assert (flags != outside).sum() <= 1 and 20 < outside.sum() < 380
    assert (np.abs(values - expected) <= rounding_bound(rounded, form(rounded), rows, precision)).all()
    assert compiled.selftest() == 0


@needs_compiler
def test_nan_infinity_and_no_place_for_the_flag(built: Build) -> None:
    model, compiled = built("rules")
    rows = np.array([[np.nan, 1.0], [20.0, np.nan], [np.inf, 1.0], [-np.inf, 1.0], [20.0, np.inf], [20.0, -1e300]])
    values, flags = compiled(rows)
    expected, outside = model.guarded(*rows.T)
    assert flags.all() and outside.all()
    assert np.isnan(values).tolist() == [True, True, False, False, False, False]
    assert values[2:] == pytest.approx(expected[2:], rel=1e-14)
    assert compiled.without_flag(np.array([20.0, 3.0])) == pytest.approx(model.predict(20.0, 3.0), rel=1e-14)


@needs_compiler
@pytest.mark.parametrize("name", ["linear", "rules", "ls_svm"])
@pytest.mark.parametrize("precision", [DOUBLE, FLOAT])
def test_the_selftest_sees_any_coefficient_altered(tmp_path: Path, name: str, precision: Precision) -> None:
    exported = export_c(fitted(name), identifier(name), precision)
    places = list(coefficients(exported.files[exported.source]))
    rng = np.random.default_rng(0)
    for number in rng.choice(len(places), 3, replace=False):
        begin, end = places[number]
        assert Compiled(folder(tmp_path, number), altered(exported, begin, end, precision)).selftest() != 0


def coefficients(source: str) -> Iterator[tuple[int, int]]:
    """Where the literals of the model's tables are."""
    for found in re.finditer(r"static const real (?!test_)\w+\[\] = \{(.*?)\};", source, re.DOTALL):
        for literal in re.finditer(r"[^\s,]+", found[1]):
            yield found.start(1) + literal.start(), found.start(1) + literal.end()


def altered(exported: Exported, begin: int, end: int, precision: Precision) -> Exported:
    """One number changed in its fifteenth digit, or in the seventh in single precision."""
    text = exported.files[exported.source]
    value = float(text[begin:end].rstrip("f"))
    other = value * (1.0 + (1e-15 if precision is DOUBLE else 2e-7)) if value else 1e-30
    changed = text[:begin] + precision.literal(other) + text[end:]
    return replace(exported, files=exported.files | {exported.source: changed})


def folder(parent: Path, number: int) -> Path:
    path = parent / str(number)
    path.mkdir()
    return path


@needs_compiler
def test_the_vector_catches_changed_code_too(tmp_path: Path) -> None:
    exported = export_c(fitted("rules"), "m")
    source = exported.files["m.c"].replace("(real)-0.5 * square", "(real)-0.5000001 * square")
    assert Compiled(tmp_path, replace(exported, files=exported.files | {"m.c": source})).selftest() > 0


@needs_compiler
@pytest.mark.parametrize(("output", "factor"), [(BIAS_ERROR_DPS, 1.0), (BIAS_ERROR_DPH, 1.0 / 3600.0)])
@pytest.mark.parametrize("precision", [DOUBLE, FLOAT])
def test_a_model_of_an_error_takes_it_off_the_rate(
    tmp_path: Path, output: Column, factor: float, precision: Precision
) -> None:
    temperature = np.linspace(-30.0, 60.0, 50)[:, np.newaxis]
    estimator = LinearCompensation().fit(temperature, 5.0 - 0.1 * temperature[:, 0])
    model = compensation(estimator, [Column("temperature", "degC")], output)
    compiled = Compiled(tmp_path, export_c(model, "bias", precision))
    tolerance = 1e-14 if precision is DOUBLE else 1e-6
    assert compiled.compensate(np.array([20.0]), 1.25) == pytest.approx(1.25 - 3.0 * factor, rel=tolerance)
    # beyond the range the error stays what it was at the edge
    assert compiled.compensate(np.array([80.0]), 1.25) == pytest.approx(1.25 + 1.0 * factor, rel=tolerance)
    assert compiled.selftest() == 0


@needs_compiler
@pytest.mark.parametrize("name", ["model", "int", "low", "exp", "main", "gyro", "1"])
def test_any_file_name_gives_code_that_compiles(tmp_path: Path, name: str) -> None:
    assert Compiled(tmp_path, export_c(fitted("linear"), identifier("", name))).selftest() == 0


@needs_compiler
def test_two_models_and_both_precisions_link_into_one_program_of_c(tmp_path: Path) -> None:
    model = fitted("linear")
    exports = [export_c(model, "one"), export_c(model, "two"), export_c(model, "one", FLOAT)]
    lines = [f'#include "{exported.name}.h"' for exported in exports]
    calls = " + ".join(f"{exported.name}_selftest()" for exported in exports)
    for exported in exports:
        for name, text in exported.files.items():
            (tmp_path / name).write_text(text)
    (tmp_path / "main.c").write_text("\n".join([*lines, f"int main(void) {{ return {calls}; }}"]) + "\n")
    run(tmp_path, "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "main.c", *(e.source for e in exports), "-lm")
    run(tmp_path, "-std=c99", "-Werror", "-DFOGBENCH_NO_SELFTEST", "-c", "one.c")
    run(tmp_path, "-std=c99", "-Werror", "-DFOGBENCH_SELFTEST_MAIN", "two.c", "-lm")


def test_every_kind_with_a_file_format_is_exported_and_from_its_file_as_it_is(tmp_path: Path) -> None:
    kinds = {kind_of(estimator) for estimator in ESTIMATORS.values()}
    # thermal cycles: test_stream.py; the swarm's network is a network in the file
    assert {*KINDS} - kinds == {"thermal_cycle", "csapso_network"}
    assert KINDS["csapso_network"].codec == KINDS["network"].codec
    for name in ESTIMATORS:
        model = fitted(name)
        campaign = make_campaign(0)
        estimator = clone(ESTIMATORS[name]).fit(campaign.inputs[::4], campaign.reference[::4])
        save_model(tmp_path / "m.json", estimator, {"dut": "FOG-A01", "model": "m"})
        loaded = load_model(tmp_path / "m.json")
        document = {**loaded.document, "kind": model.document["kind"], "versions": model.document["versions"]}
        assert export_c(replace(loaded, document=document), "gyro_m") == export_c(model, "gyro_m")


def test_the_header_says_what_it_is_and_is_the_same_every_time() -> None:
    model = fitted("rules")
    exported = export_c(model, "fog_a01_m")
    header = exported.files["fog_a01_m.h"]
    for said in ("gyro FOG-A01, model m", "temperature, degC, -30 to 60", "rate_output, deg/s", "rate in deg/s"):
        assert said in header
    assert model.document["training"]["sha256"] in header and "fogbench 1.2.3" in header
    assert export_c(model, "fog_a01_m") == exported


@settings(max_examples=30)
@given(st.text(max_size=40), st.text(max_size=40))
def test_no_name_breaks_out_of_its_comment_or_makes_a_bad_identifier(dut: str, name: str) -> None:
    model = compensation(LinearCompensation().fit([[1.0, 2.0], [3.0, 5.0]], [1.0, 2.0]), dut=dut, model=name)
    exported = export_c(model, identifier(dut, name))
    assert re.fullmatch(r"gyro_[a-z0-9_]{1,55}", exported.name)
    for text in exported.files.values():
        assert text.isascii() and "??" not in text
        about = text[: text.index("\n#") + 1]
        assert about.count("*/") == 1 and about.count("/*") == 1 and about.endswith("*/\n")


def test_a_foreign_model_is_refused_with_those_that_can() -> None:
    model = replace(fitted("linear"), model=object())  # type: ignore[arg-type]
    with pytest.raises(NotExported, match=r"not exported to C.*linear, polynomial, rules"):
        export_c(model, "m")


def test_cost_is_counted() -> None:
    # c0 + c1 x1 + c2 x2; the guard: 2 scaled inputs, sum and difference held to 2 limits each, 2 pulled inputs
    exported = export_c(compensation(LinearCompensation().fit(np.eye(4, 2), np.arange(4.0))), "m")
    assert exported.coefficients == 3 + 4 * 2 + 4
    assert exported.coefficient_bytes == 8 * 15
    operations = exported.operations
    assert (operations.adds, operations.multiplies, operations.divides) == (2 + 2 + 2 + 4 + 2, 2 + 1 + 2, 4)
    assert operations.functions == 0


def test_rate_goes_on_with_the_slope_of_the_linear_fit() -> None:
    model = fitted("rules")
    assert (
        f"y += (real){model.rate_slope!r} * (x[{model.inputs.index(RATE_INPUT)}]" in export_c(model, "m").files["m.c"]
    )
