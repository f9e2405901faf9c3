"""Numbers at fixed places against struct and int.from_bytes."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs.layout import FIELD_TYPES, Field

INTEGERS = [name for name in FIELD_TYPES if not name.startswith("f")]


@given(
    rows=st.lists(st.binary(min_size=11, max_size=11), min_size=1, max_size=5),
    name=st.sampled_from(INTEGERS),
    order=st.sampled_from(["big", "little"]),
    at=st.integers(0, 7),
)
def test_integers(rows: list[bytes], name: str, order: str, at: int) -> None:
    field = Field("x", at, name, order)
    frames = np.frombuffer(b"".join(rows), np.uint8).reshape(-1, 11)
    values = field.read(frames)
    expected = [int.from_bytes(row[at : at + field.size], order, signed=name[0] == "i") for row in rows]  # type: ignore[arg-type]
    assert values.tolist() == expected
    assert values.dtype == field.raw_type.dtype and values.dtype.isnative
    copy = np.zeros_like(frames)
    field.write(copy, values)
    assert (copy[:, field.columns] == frames[:, field.columns]).all()
    copy[:, field.columns] = 0
    assert not copy.any()


@pytest.mark.parametrize(("name", "code"), [("f32", "f"), ("f64", "d")])
@pytest.mark.parametrize(("order", "mark"), [("big", ">"), ("little", "<")])
def test_floats(name: str, code: str, order: str, mark: str) -> None:
    frames = np.frombuffer(struct.pack(f"{mark}x{code}2x", -1.25e-5) * 2, np.uint8).reshape(2, -1)
    field = Field("x", 1, name, order)
    assert field.read(frames).tolist() == [struct.unpack(code, struct.pack(code, -1.25e-5))[0]] * 2
    copy = np.zeros_like(frames)
    field.write(copy, field.read(frames))
    assert copy.tobytes() == frames.tobytes()
