"""Settings dataclasses read from YAML mappings, for dataclasses that exist only here."""

from dataclasses import dataclass, field, fields
from importlib.metadata import entry_points
from typing import Annotated, Any, Literal

import pytest
from pydantic import TypeAdapter, ValidationError

from bench.benchfile import DRIVER_GROUPS
from bench.errors import Problem
from bench.fields import Quantity, YamlMapping, model_of, to_dataclass, validate, validate_dataclass, yaml_key
from bench.units import DIMENSIONS
from bench.yamlfile import parse_yaml


@dataclass(frozen=True)
class Inner:
    lag_s: float = 20.0
    name: str = "inner"


@dataclass(frozen=True)
class Sample:
    """A class with one field of every kind that is understood."""

    address: int
    data_rate_hz: float = 100.0
    ratio: float = 1.0
    release: bool = True
    order: Literal["up", "down"] = "up"
    ramp_degc_min: float | None = None
    knots_degc: tuple[float, ...] = (0.0, 1.0)
    weights: tuple[float, ...] = ()
    inner: Inner = field(default_factory=Inner)
    other: Inner | None = None
    frame: str | dict[str, Any] = "kvh"

    def __post_init__(self) -> None:
        if not 1 <= self.address <= 247:
            raise ValueError(f"address: {self.address}; allowed are 1..247")
        if self.ratio < 0:
            raise ValueError(f"Sample.data_rate_hz = {self.data_rate_hz}: must be something else")
        if self.ratio > 10:
            raise ValueError("frame.checksum.kind: 'x' is not allowed. Did you mean y?")


def read(text: str) -> tuple[Sample | None, list[str]]:
    problems: list[Problem] = []
    document = parse_yaml(f"settings:\n{text}", "b.yaml")
    value = validate_dataclass(Sample, document, ("settings",), problems)
    return value, [str(problem) for problem in problems]


def test_every_kind_of_field_is_converted() -> None:
    value, problems = read("""
  address: 5
  data_rate: 1 kHz
  ratio: 2
  release: false
  order: down
  ramp: 60 degC/h
  knots: [-30 degC, 60 degC]
  weights: [1, 2.5]
  inner: {lag: 1 min}
  other: {name: x}
  frame: {base: kvh, rate: {kind: increment}}
""")
    assert problems == []
    assert value == Sample(
        address=5,
        data_rate_hz=1000.0,
        ratio=2.0,
        release=False,
        order="down",
        ramp_degc_min=1.0,
        knots_degc=(-30.0, 60.0),
        weights=(1.0, 2.5),
        inner=Inner(lag_s=60.0),
        other=Inner(name="x"),
        frame={"base": "kvh", "rate": {"kind": "increment"}},
    )


def test_what_is_left_out_has_the_default_of_the_dataclass() -> None:
    assert read("  {address: 5, ramp: null, other: null}") == (Sample(address=5), [])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("  {}", "b.yaml:1:1: the key 'address' is missing here."),
        ("  {adress: 5, address: 5}", "b.yaml:2:4: unknown key 'adress'. Allowed: address, "),
        ("  {address: 5, data_rate_hz: 5}", "b.yaml:2:16: unknown key 'data_rate_hz'."),
        ("  {address: 5.0}", "b.yaml:2:13: 'address': expected a whole number, not 5.0."),
        ("  {address: true}", "b.yaml:2:13: 'address': expected a whole number, not true."),
        ("  {address: '5'}", "b.yaml:2:13: 'address': expected a whole number, not '5'."),
        ("  {address: 5, ratio: '1'}", "b.yaml:2:23: 'ratio': expected a number, not '1'."),
        ("  {address: 5, ratio: true}", "b.yaml:2:23: 'ratio': expected a number, not true."),
        ("  {address: 5, ratio: .nan}", "b.yaml:2:23: 'ratio': must be a finite number, not nan."),
        ("  {address: 5, release: 1}", "b.yaml:2:25: 'release': expected true or false, not 1."),
        ("  {address: 5, release: no}", "b.yaml:2:25: 'release': expected true or false, not 'no'."),
        (
            "  {address: 5, order: dwon}",
            "b.yaml:2:23: 'order': 'dwon' is not allowed. Allowed: down, up. Did you mean down?",
        ),
        (
            "  {address: 5, knots: 5 degC}",
            "b.yaml:2:23: 'knots': expected a list (its items start with '- '), not '5 degC'.",
        ),
        ("  {address: 5, knots: [1 degC, 5]}", "b.yaml:2:32: 'knots': 5 has no unit. Allowed for temperature:"),
        ("  {address: 5, inner: 5}", "b.yaml:2:23: 'inner': expected a mapping with the keys lag, name, not 5."),
        ("  {address: 5, other: {lagg: 5}}", "b.yaml:2:24: unknown key 'lagg'. Allowed: lag, name. Did you mean lag?"),
        ("  {address: 5, frame: 5}", "b.yaml:2:23: 'frame': expected text or a mapping, not 5."),
        (
            "  {address: 5, ramp: 5 K}",
            "b.yaml:2:22: 'ramp': '5 K' has the unit 'K', which is no unit of temperature slope.",
        ),
        ("  - 5", "b.yaml:2:3: a mapping is expected here. Allowed keys: address, data_rate, ratio,"),
    ],
)
def test_mistakes_have_a_place_and_are_in_the_words_of_the_file(text: str, problem: str) -> None:
    value, problems = read(text)
    assert value is None
    assert len(problems) == 1
    assert problems[0].startswith(problem)


def test_what_the_dataclass_itself_refuses_is_shown_where_it_is_written() -> None:
    assert read("  ratio: 1\n  address: 500")[1] == ["b.yaml:3:12: address: 500; allowed are 1..247."]
    assert read("  address: 1\n  ratio: -1\n  data_rate: 5 Hz")[1] == [
        "b.yaml:4:14: data_rate = 5.0: must be something else."
    ]
    nested = "  address: 1\n  ratio: 11\n  frame:\n    checksum: {kind: x}"
    assert read(nested)[1] == ["b.yaml:5:22: frame.checksum.kind: 'x' is not allowed. Did you mean y?"]


def test_all_mistakes_come_at_once() -> None:
    _, problems = read("  {address: x, data_rate: 5, order: left, inner: {lag: 5 K, nmae: y}}")
    assert [problem.split(":")[2] for problem in problems] == ["13", "27", "37", "56", "61"]


def test_models_are_made_once() -> None:
    assert model_of(Sample) is model_of(Sample)
    assert model_of(Sample).__doc__ == Sample.__doc__


def test_a_model_and_back() -> None:
    values = model_of(Inner).model_validate({"lag": "5 s"})
    assert to_dataclass(Inner, values) == Inner(lag_s=5.0)


@pytest.mark.parametrize(
    ("name", "key"),
    [("data_rate_hz", "data_rate"), ("from_", "from"), ("k0", "k0"), ("ramp_degc_min", "ramp"), ("w_k", "w")],
)
def test_a_key_is_the_field_without_its_unit(name: str, key: str) -> None:
    assert yaml_key(name) == key


@pytest.mark.parametrize("group", DRIVER_GROUPS.values())
def test_settings_of_every_installed_driver_have_keys_of_their_own_and_defaults_that_hold(group: str) -> None:
    for point in entry_points(group=group):
        settings = point.load().Settings
        keys = [yaml_key(item.name) for item in fields(settings)]
        assert len(set(keys)) == len(keys)
        problems: list[Problem] = []
        assert validate_dataclass(settings, parse_yaml("{}", "f"), (), problems) == settings()
        assert problems == []


class Limits(YamlMapping):
    rate_dps: Annotated[float, Quantity("dps")]


def test_values_are_never_coerced_and_never_changed() -> None:
    limits = Limits.model_validate({"rate": "36 deg/h"})
    assert limits.rate_dps == pytest.approx(0.01)
    with pytest.raises(ValidationError):
        limits.rate_dps = 5.0  # type: ignore[misc]


@pytest.mark.parametrize("suffix", DIMENSIONS)
def test_a_quantity_tells_an_editor_its_units(suffix: str) -> None:
    schema = TypeAdapter(Annotated[float, Quantity(suffix)]).json_schema()
    assert schema["type"] == "string"
    assert DIMENSIONS[suffix].name in schema["description"]
    assert all(unit in schema["description"] for unit in DIMENSIONS[suffix].factors)
    assert schema["examples"] == [DIMENSIONS[suffix].example]


def test_a_value_at_a_path_is_validated_alone() -> None:
    document = parse_yaml("a: {limits: {rate: 5 deg/s}}\nb: 5", "f")
    problems: list[Problem] = []
    found = validate(Limits, document, ("a", "limits"), problems)
    assert found is not None
    assert found.rate_dps == 5.0
    assert validate(Limits, document, ("b",), problems) is None
    assert [str(problem) for problem in problems] == ["f:2:4: a mapping is expected here. Allowed keys: rate."]
