"""The YAML reader: values, places, what it refuses, and agreement with pyyaml on plain documents."""

import math
import os
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st

from bench.errors import InvalidFiles, Mark, Problem
from bench.yamlfile import MAX_BYTES, MAX_DEPTH, MAX_NODES, Document, load_yaml, parse_yaml

SAMPLE = """\
# a comment
procedure: x
steps:
  - soak: {for: 2 h, until: 5}
  - sweep:
      rate:
        - 1 deg/s
        - "2"
ü°: [ä, end]
"""


def refusal(text: str) -> Problem:
    with pytest.raises(InvalidFiles) as caught:
        parse_yaml(text, "f.yaml")
    (problem,) = caught.value.problems
    return problem


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("~", None),
        ("null", None),
        ("Null", None),
        ("NULL", None),
        ("true", True),
        ("True", True),
        ("FALSE", False),
        ("tRue", "tRue"),
        ("yes", "yes"),
        ("off", "off"),
        ("0", 0),
        ("-7", -7),
        ("+7", 7),
        ("010", "010"),
        ("0x1F", "0x1F"),
        ("0o17", "0o17"),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("2026-01-01", "2026-01-01"),
        ("1e3", 1000.0),
        ("1.5", 1.5),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("1.5E-3", 0.0015),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("'5'", "5"),
        ('"true"', "true"),
        ("'null'", "null"),
        ("١٢", "١٢"),
        ("10 deg/s", "10 deg/s"),
        ("[1, [2, {a: 3}], b]", [1, [2, {"a": 3}], "b"]),
        ("{5: a, true: b, null: c}", {"5": "a", "true": "b", "null": "c"}),
        ("|\n  two\n  lines\n", "two\nlines\n"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text: str, value: Any) -> None:
    data = parse_yaml(f"key: {text}", "f").data["key"]
    assert data == value
    assert type(data) is type(value)


def test_nan_is_a_number() -> None:
    assert all(math.isnan(x) for x in parse_yaml("[.nan, .NaN, .NAN]", "f").data)


def test_an_empty_file_is_nothing() -> None:
    for text in ("", "\n# only a comment\n", "---\n", "\ufeff"):
        assert parse_yaml(text, "f").data is None


def test_every_key_and_value_has_its_place() -> None:
    document = parse_yaml(SAMPLE, "f.yaml")
    assert document.data["ü°"] == ["ä", "end"]
    places: dict[tuple[str | int, ...], tuple[int, int]] = {
        (): (2, 1),
        ("procedure",): (2, 12),
        ("steps",): (4, 3),
        ("steps", 0): (4, 5),
        ("steps", 0, "soak"): (4, 11),
        ("steps", 0, "soak", "for"): (4, 17),
        ("steps", 0, "soak", "until"): (4, 29),
        ("steps", 1, "sweep", "rate", 1): (8, 11),
        ("ü°", 1): (9, 9),
    }
    for path, place in places.items():
        assert document.mark(path) == Mark("f.yaml", *place), path
    assert document.mark(("steps", 0, "soak", "until"), key=True) == Mark("f.yaml", 4, 22)
    assert document.mark(("steps", 1, "sweep", "rate"), key=True) == Mark("f.yaml", 6, 7)


def test_a_path_that_is_not_there_has_the_place_of_its_parent() -> None:
    document = parse_yaml(SAMPLE, "f.yaml")
    assert document.mark(("steps", 0, "soak", "timeout", "x")) == Mark("f.yaml", 4, 11)
    assert document.mark(("steps", 0, "soak", "timeout"), key=True) == Mark("f.yaml", 4, 11)
    assert parse_yaml("", "f.yaml").mark(("steps",)) == Mark("f.yaml")


def test_places_follow_the_text() -> None:
    """The mark of every scalar points at that scalar, whatever stands before it."""
    document = parse_yaml(SAMPLE, "f.yaml")
    lines = SAMPLE.splitlines()
    for path, mark in document.values.items():
        value: Any = document.data
        for part in path:
            value = value[part]
        if isinstance(value, str | int):
            assert lines[mark.line - 1][mark.column - 1 :].lstrip('"').startswith(str(value)), path
    for path, mark in document.keys.items():
        assert lines[mark.line - 1][mark.column - 1 :].startswith(f"{path[-1]}:")


ALIAS_BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        (ALIAS_BOMB, 1, 4, ["anchors (&)", "include"]),
        ("a: 1\nb: *a", 2, 4, ["aliases (*)"]),
        ("&k a: 1", 1, 1, ["anchors"]),
        ("a: !!python/object/apply:os.system ['true']", 1, 4, ["!!python/object/apply:os.system", "plain text"]),
        ("a: !secret x", 1, 4, ["!secret", "Allowed"]),
        ("a: !!str 5", 1, 4, ["!!str"]),
        ("!!str a: 5", 1, 1, ["tags"]),
        ("! a: 5", 1, 1, ["tags"]),
        ("base: {x: 1}\n<<: {y: 2}", 2, 1, ["merge keys (<<)"]),
        ("? [1, 2]\n: 3", 1, 3, ["a key must be plain text"]),
        ("a: 1\nb: 2\na: 3", 3, 1, ["'a' stands twice", "line 1"]),
        ("l:\n  - {x: 1, y: 2, x: 3}", 2, 18, ["'x' stands twice", "line 2"]),
        ("1: a\n'1': b", 2, 1, ["'1' stands twice"]),
        ("a: 1\n---\nb: 2", 2, 1, ["second document", "one document per file"]),
        ("a:\n\tb: 1", 2, 1, ["not YAML", "spaces, not tabs"]),
        ("a: b: c", 1, 5, ["not YAML", "mapping values are not allowed", "quotes"]),
        ("a: [1, 2\nb: 3", 2, 2, ["not YAML"]),
        ("a: 'open", 1, 9, ["not YAML"]),
        ("- a\nb: c", 2, 1, ["not YAML"]),
        ("ok: 1\nbad: \x07", 2, 6, ["U+0007"]),
        ("a: \ud800", 1, 4, ["U+D800"]),
    ],
)
def test_refusals_have_a_place_and_a_way_out(text: str, line: int, column: int, words: list[str]) -> None:
    problem = refusal(text)
    assert problem.mark == Mark("f.yaml", line, column)
    assert all(word in problem.message for word in words), problem.message
    assert "\n" not in str(problem)


@pytest.mark.parametrize("nested", ["[" * 5 * MAX_BYTES, "- " * MAX_BYTES, "{a: " * MAX_BYTES, "? " * MAX_BYTES])
def test_endless_nesting_is_refused_at_its_beginning(nested: str) -> None:
    problem = refusal(nested)
    assert problem.mark.line == 1
    assert problem.mark.column <= 4 * MAX_DEPTH + 5


def test_depth_is_bounded_exactly() -> None:
    assert parse_yaml("[" * MAX_DEPTH + "1" + "]" * MAX_DEPTH, "f").data
    problem = refusal("[" * (MAX_DEPTH + 1) + "1" + "]" * (MAX_DEPTH + 1))
    assert str(MAX_DEPTH) in problem.message


def test_size_is_bounded_exactly() -> None:
    # The list itself is a value too.
    assert len(parse_yaml(f"[{'1,' * (MAX_NODES - 1)}]", "f").data) == MAX_NODES - 1
    assert str(MAX_NODES) in refusal(f"[{'1,' * MAX_NODES}]").message


def test_long_numbers_do_not_stall() -> None:
    digits = "1" * 500_000
    assert parse_yaml(f"a: {digits}", "f").data == {"a": math.inf}
    assert parse_yaml(f"a: {digits}x", "f").data == {"a": f"{digits}x"}


def load_refusal(path: Path) -> str:
    with pytest.raises(InvalidFiles) as caught:
        load_yaml(path)
    return str(caught.value)


def test_files_are_read_as_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes("\ufeffgröße: 5 °C\r\n".encode())
    assert load_yaml(path).data == {"größe": "5 °C"}
    assert load_yaml(path).file == str(path)
    assert load_yaml(path, "shown").mark(("größe",)).file == "shown"
    path.write_bytes("größe: 5".encode("latin-1"))
    message = load_refusal(path)
    assert "not UTF-8" in message
    assert "byte 2" in message


def test_what_is_no_readable_file_is_refused(tmp_path: Path) -> None:
    assert "No such file" in load_refusal(tmp_path / "nowhere.yaml")
    assert "is not a file" in load_refusal(tmp_path)
    assert "name too long" in load_refusal(tmp_path / ("x" * 300)).lower()
    assert "null byte" in load_refusal(tmp_path / "a\0b")


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs a device file")  # noqa: PTH110
def test_a_device_without_an_end_is_not_read() -> None:
    assert "is not a file" in load_refusal(Path("/dev/zero"))


def test_a_file_may_be_so_large_and_no_larger(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("#" * MAX_BYTES)
    assert load_yaml(path).data is None
    path.write_text("#" * (MAX_BYTES + 1))
    message = load_refusal(path)
    assert str(MAX_BYTES) in message
    assert str(MAX_BYTES + 1) in message


YAMLISH = st.text(alphabet="-:[]{}&*!?|>#%@`'\",<~ \n\tab01.eé\\x", max_size=60)


@given(st.one_of(st.text(), YAMLISH, YAMLISH.map(lambda text: "a:\n  " + text.replace("\n", "\n  "))))
def test_any_text_is_data_or_a_refusal_with_a_place(text: str) -> None:
    try:
        document = parse_yaml(text, "f")
    except InvalidFiles as error:
        (problem,) = error.problems
        lines = text.count("\n") + text.count("\r") + sum(map(text.count, "\x85\u2028\u2029")) + 1
        assert 1 <= problem.mark.line <= lines + 1
        assert problem.mark.column >= 1
    else:
        assert isinstance(document, Document)
        assert () in document.values or document.data is None


# '1e3' is text to pyyaml (YAML 1.1 wants a dot), a number in YAML 1.2.
_NUMBERS_OF_1_2_ONLY = re.compile(r"[+-]?[0-9]+([eE][+-]?[0-9]+)?|[+-]?[0-9]*\.[0-9]*[eE][0-9]+")
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20).filter(
    lambda text: not _NUMBERS_OF_1_2_ONLY.fullmatch(text)
)
SCALARS = st.one_of(
    TEXTS,
    st.sampled_from(["yes", "No", "null", "~", "1:30", "010", "0x1F", "1_000", "2026-01-01", "=", "- a", "a: b", "#"]),
    st.integers(-(10**17), 10**17),
    st.floats(allow_nan=False),
    st.booleans(),
    st.none(),
)
PLAIN = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(TEXTS.filter(lambda key: key != "<<"), inner, max_size=4)
    ),
    max_leaves=15,
)


class _NoAliases(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


@given(PLAIN, st.sampled_from([True, False, None]))
def test_plain_documents_read_as_pyyaml_reads_them(data: Any, flow: bool | None) -> None:
    text = yaml.dump(data, Dumper=_NoAliases, default_flow_style=flow)
    assume(len(text) < 10_000)
    expected = yaml.safe_load(text)
    assert expected == data
    read = parse_yaml(text, "f").data
    assert read == expected
    assert repr(read) == repr(expected)
