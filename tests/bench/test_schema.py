"""The JSON Schemas, tried with a small validator: they accept our files and refuse what the models refuse."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.benchfile import load_bench
from bench.procedure.language import SHORT_FORM, VERBS
from bench.procedure.parse import parse_procedure
from bench.schema import bench_schema, procedure_schema
from bench.units import parse_quantity
from bench.yamlfile import parse_yaml

ROOT = Path(__file__).parents[2]
PROCEDURE, BENCH = procedure_schema(), bench_schema()

KINDS: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "null": (type(None),),
}
# A keyword says nothing about values of another kind.
APPLIES_TO = (
    dict.fromkeys(("properties", "patternProperties", "additionalProperties", "propertyNames", "required"), "object")
    | dict.fromkeys(("items", "minItems", "maxItems"), "array")
    | dict.fromkeys(("pattern", "minLength", "maxLength"), "string")
    | dict.fromkeys(("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"), "number")
)
ANNOTATIONS = {"$schema", "$defs", "title", "description", "default", "examples"}


def is_kind(value: Any, kind: str) -> bool:
    return isinstance(value, KINDS[kind]) and (not isinstance(value, bool) or kind == "boolean")


class Validator:
    """The part of JSON Schema 2020-12 that is used here; an unknown keyword is a mistake in the schema."""

    def __init__(self, root: dict[str, Any]) -> None:
        self.root = root

    def valid(self, value: Any) -> bool:
        return self._valid(self.root, value)

    def _valid(self, schema: dict[str, Any], value: Any) -> bool:
        return all(
            getattr(self, f"_{key.lstrip('$')}")(argument, value, schema)
            for key, argument in schema.items()
            if key not in ANNOTATIONS and (key not in APPLIES_TO or is_kind(value, APPLIES_TO[key]))
        )

    def _ref(self, name: str, value: Any, _: Any) -> bool:
        found: Any = self.root
        for part in name.removeprefix("#/").split("/"):
            found = found[part]
        return self._valid(found, value)

    def _type(self, kinds: Any, value: Any, _: Any) -> bool:
        return any(is_kind(value, kind) for kind in ([kinds] if isinstance(kinds, str) else kinds))

    def _properties(self, properties: dict[str, Any], value: Any, _: Any) -> bool:
        return all(self._valid(properties[key], item) for key, item in value.items() if key in properties)

    def _patternProperties(self, patterns: dict[str, Any], value: Any, _: Any) -> bool:  # noqa: N802
        return all(
            self._valid(schema, item)
            for pattern, schema in patterns.items()
            for key, item in value.items()
            if re.search(pattern, key)
        )

    def _additionalProperties(self, allowed: Any, value: Any, schema: Any) -> bool:  # noqa: N802
        patterns = schema.get("patternProperties", {})
        extra = {
            key: item
            for key, item in value.items()
            if key not in schema.get("properties", {}) and not any(re.search(pattern, key) for pattern in patterns)
        }
        if isinstance(allowed, bool):
            return allowed or not extra
        return all(self._valid(allowed, item) for item in extra.values())

    def _propertyNames(self, names: dict[str, Any], value: Any, _: Any) -> bool:  # noqa: N802
        return all(self._valid(names, key) for key in value)

    def _required(self, keys: list[str], value: Any, _: Any) -> bool:
        return all(key in value for key in keys)

    def _items(self, items: dict[str, Any], value: Any, _: Any) -> bool:
        return all(self._valid(items, item) for item in value)

    def _anyOf(self, choices: list[Any], value: Any, _: Any) -> bool:  # noqa: N802
        return any(self._valid(choice, value) for choice in choices)

    def _oneOf(self, choices: list[Any], value: Any, _: Any) -> bool:  # noqa: N802
        return sum(self._valid(choice, value) for choice in choices) == 1

    def _enum(self, values: list[Any], value: Any, _: Any) -> bool:
        return value in values

    def _const(self, only: Any, value: Any, _: Any) -> bool:
        return bool(value == only)

    def _pattern(self, pattern: str, value: Any, _: Any) -> bool:
        return re.search(pattern, value) is not None

    def _minItems(self, least: int, value: Any, _: Any) -> bool:  # noqa: N802
        return len(value) >= least

    def _minLength(self, least: int, value: Any, _: Any) -> bool:  # noqa: N802
        return len(value) >= least

    def _maxLength(self, most: int, value: Any, _: Any) -> bool:  # noqa: N802
        return len(value) <= most

    def _maxItems(self, most: int, value: Any, _: Any) -> bool:  # noqa: N802
        return len(value) <= most

    def _minimum(self, least: float, value: Any, _: Any) -> bool:
        return value >= least

    def _exclusiveMinimum(self, bound: float, value: Any, _: Any) -> bool:  # noqa: N802
        return value > bound

    def _maximum(self, most: float, value: Any, _: Any) -> bool:
        return value <= most

    def _exclusiveMaximum(self, bound: float, value: Any, _: Any) -> bool:  # noqa: N802
        return value < bound


def everything(schema: Any) -> Iterator[dict[str, Any]]:
    if isinstance(schema, dict):
        yield schema
    for inner in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from everything(inner)


@pytest.mark.parametrize(("schema", "title"), [(PROCEDURE, "fogbench procedure"), (BENCH, "fogbench bench")])
def test_a_schema_knows_what_it_is_and_holds_together(schema: dict[str, Any], title: str) -> None:
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["title"] == title
    for part in everything(schema):
        if isinstance(part.get("$ref"), str):
            assert part["$ref"].removeprefix("#/$defs/") in schema["$defs"]
        if isinstance(part.get("required"), list):
            assert set(part["required"]) <= set(part["properties"])


@pytest.mark.parametrize("schema", [PROCEDURE, BENCH], ids=["procedure", "bench"])
def test_defaults_are_what_a_user_could_write(schema: dict[str, Any]) -> None:
    validator = Validator(schema)
    defaults = 0
    for part in everything(schema):
        for name, inner in (part.get("properties") or {}).items():
            if isinstance(inner, dict) and "default" in inner:
                constraints = {key: value for key, value in inner.items() if key != "default"}
                assert validator._valid(constraints, inner["default"]), name
                defaults += 1
    assert defaults > 15


def test_a_quantity_with_a_default_shows_it_with_its_unit() -> None:
    timeout = PROCEDURE["$defs"]["SetTemperature"]["properties"]["timeout"]
    assert parse_quantity(timeout["default"], "s") == 21600.0
    assert PROCEDURE["$defs"]["SetTemperature"]["properties"]["band"]["default"] == "0.5 K"
    assert "exclusiveMinimum" not in timeout


@pytest.mark.parametrize("path", sorted((ROOT / "procedures").glob("*.yaml")), ids=lambda path: path.stem)
def test_our_procedures_are_valid(path: Path) -> None:
    assert Validator(PROCEDURE).valid(parse_yaml(path.read_text(), path.name).data)


@pytest.mark.parametrize("path", sorted((ROOT / "benches").glob("*.yaml")), ids=lambda path: path.stem)
def test_our_benches_are_valid(path: Path) -> None:
    assert Validator(BENCH).valid(parse_yaml(path.read_text(), path.name).data)


@pytest.mark.parametrize(
    ("steps", "valid"),
    [
        ("[{dwell: 1 s}]", True),
        ("[{dwell: {for: 1 s}}]", True),
        ("[{set_rate: 5 deg/s}, {note: hello}]", True),
        ("[{sweep: {rate: [1 deg/s], steps: [{repeat: {times: 2, steps: [{dwell: 1 s}]}}]}}]", True),
        ("[{soak: {for: 1 h, until: {slope: 1 K/h}, timeout: 2 h}}]", True),
        ("[{acquire: {count: 10, every: 1 s, take: newest}}]", True),
        ("[]", False),
        ("5", False),
        ("[{dwel: 1 s}]", False),
        ("[{dwell: 1 s, note: x}]", False),
        ("[{dwell: {}}]", False),
        ("[{dwell: {for: 1 s, bnd: 1}}]", False),
        ("[{dwell: [1 s]}]", False),
        ("[{acquire: 1 s}]", False),
        ("[{acquire: {count: 0, every: 1 s}}]", False),
        ("[{acquire: {count: 1.5, every: 1 s}}]", False),
        ("[{acquire: {count: 5, every: 1}}]", False),
        ("[{acquire: {count: 5, every: 1 s, take: last}}]", False),
        ("[{sweep: {rate: [1], steps: [{dwell: 1 s}]}}]", False),
        ("[{sweep: {rate: {from: 1 deg/s, step: 1 deg/s}, steps: [{dwell: 1 s}]}}]", False),
        ("[{sweep: {rate: [1 deg/s], steps: []}}]", False),
        ("[{sweep: {rate: [1 deg/s], steps: [{repeat: {times: 2, steps: [{dwel: 1 s}]}}]}}]", False),
        ("[{note: ''}]", True),  # text too short: the short form says no more than 'text'
        ("[{note: {text: ''}}]", False),
    ],
)
def test_steps(steps: str, valid: bool, tmp_path: Path) -> None:
    text = f"procedure: x\nsteps: {steps}"
    assert Validator(PROCEDURE).valid(parse_yaml(text, "p").data) is valid
    path = tmp_path / "p.yaml"
    path.write_text(text)
    _, problems = parse_procedure(path)
    assert (not problems) is valid or steps == "[{note: ''}]"


def test_every_verb_is_in_the_schema_once_and_documented() -> None:
    branches = PROCEDURE["$defs"]["Step"]["oneOf"]
    assert [branch["required"][0] for branch in branches] == list(VERBS)
    for branch, (verb, model) in zip(branches, VERBS.items(), strict=True):
        arguments = branch["properties"][verb]
        assert ("anyOf" in arguments) is (verb in SHORT_FORM)
        assert PROCEDURE["$defs"][model.__name__]["description"]


@pytest.mark.parametrize(
    ("old", "new", "valid"),
    [
        ("", "", True),
        ("sim://chamber", "5", False),
        ("driver: watlow_f4", "drivr: watlow_f4", False),
        ("rate: 400 deg/s", "rate: 400", False),
        ("{interface: fogsim, channel: fog-b01, bitrate: 1000000}", "{interface: fogsim}", False),
        ("bench: virtual", "bench: a b", False),
        ("action: go_to", "action: leave", False),
        ("FOG-A01:\n    driver", "'FOG A01':\n    driver", False),
        ("# A real bench", "colour: red\n# A real bench", False),
    ],
)
def test_benches(old: str, new: str, valid: bool, tmp_path: Path) -> None:
    original = (ROOT / "benches" / "virtual.yaml").read_text()
    assert old in original
    text = original.replace(old, new, 1)
    assert Validator(BENCH).valid(parse_yaml(text, "b").data) is valid
    path = tmp_path / "b.yaml"
    path.write_text(text)
    assert (not load_bench(path)[1]) is valid


def test_the_settings_of_every_installed_driver_are_there() -> None:
    names = {name.removeprefix("settings of ") for name in BENCH["$defs"] if name.startswith("settings of ")}
    assert names == {"watlow_f4", "acutronic_acl", "scpi_supply", "serial_frames", "can_dbc"}
    assert BENCH["$defs"]["settings of watlow_f4"]["properties"]["reply_timeout"]["default"] == "1 s"
