"""Bounded reading of JSON."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.strict_json import MAX_BYTES, MAX_DEPTH, Refused, matrix, member, number, parse_object, read_object, vector

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "not JSON"),
        (b"{", "not JSON"),
        (b"\xff\xfe{}", "not JSON in UTF-8"),
        (b"[]", "a list instead of an object"),
        (b"null", "null instead of an object"),
        (b'{"a": NaN}', "contains NaN"),
        (b'{"a": -Infinity}', "contains -Infinity"),
        (b'{"a": 1, "a": 2}', "key 'a' twice"),
        (b"[" * 200_000, "nested|not JSON"),
        (b'{"a":' * 25 + b"1" + b"}" * 25, "nested more than 20"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not JSON"),
    ],
)
def test_what_is_not_acceptable_is_refused_with_the_reason(text: bytes, reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        parse_object(text)


def test_the_allowed_depth_is_allowed() -> None:
    depth = MAX_DEPTH - 1
    assert parse_object(b'{"a":' * depth + b"1" + b"}" * depth)


def test_a_large_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(Refused, match="larger than 16 MiB"):
        read_object(path)


def test_a_folder_and_a_missing_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="not a regular file"):
        read_object(tmp_path)
    with pytest.raises(Refused, match="no such file"):
        read_object(tmp_path / "missing.json")


@given(st.dictionaries(st.text(), JSON))
def test_objects_of_finite_numbers_come_back(value: dict[str, object]) -> None:
    text = json.dumps(value)
    if "NaN" in text or "Infinity" in text:
        return
    assert parse_object(text.encode()) == value


@given(JSON)
def test_numbers_vectors_and_matrices_of_anything_are_values_or_refused(value: object) -> None:
    for read in (lambda: number(value, "x"), lambda: vector(value, 2, "x"), lambda: matrix(value, 1, 2, "x")):
        try:
            read()
        except Refused as error:
            assert "x" in str(error)


@pytest.mark.parametrize("value", [True, None, "1", [1], 1e31, -(10**400), float("nan"), float("inf")])
def test_what_is_no_usable_number_is_refused(value: object) -> None:
    with pytest.raises(Refused, match="width"):
        number(value, "width")


def test_shapes_must_be_exact() -> None:
    assert matrix([[1, 2], [3, 4]], 2, 2, "m").tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert matrix([[]], 1, 0, "m").shape == (1, 0)
    with pytest.raises(Refused, match=r"m\[1\] has 1 entries; expected a list of 2 numbers"):
        matrix([[1, 2], [3]], 2, 2, "m")
    with pytest.raises(Refused, match="m has 1 rows; expected 2 rows of 2 numbers"):
        matrix([[1, 2]], 2, 2, "m")


def test_members_are_of_the_type_expected() -> None:
    assert member({"n": 3}, "n", int) == 3
    with pytest.raises(Refused, match=r"a\.n is missing"):
        member({}, "n", int, "a.")
    with pytest.raises(Refused, match="n is true or false instead of a whole number"):
        member({"n": True}, "n", int)
    with pytest.raises(Refused, match="n is a number instead of an object"):
        member({"n": 1.5}, "n", dict)
