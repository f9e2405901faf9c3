"""Raw columns to values and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs.batch import FrameBatch, Meaning, Quantity, RawType

I16 = RawType.integer(16, signed=True)


@pytest.mark.parametrize(
    ("bits", "signed", "dtype", "low", "high"),
    [
        (1, False, "u1", 0, 1),
        (8, True, "i1", -128, 127),
        (12, True, "i2", -2048, 2047),
        (24, False, "u4", 0, 0xFFFFFF),
        (64, True, "i8", -(2**63), 2**63 - 1),
    ],
)
def test_integers_get_the_smallest_type_that_holds_them(
    bits: int, signed: bool, dtype: str, low: int, high: int
) -> None:
    assert RawType.integer(bits, signed) == RawType(np.dtype(dtype), low, high)


def test_a_quantity_is_linear_in_float64() -> None:
    value = Quantity(0.01, -50.0).value(np.array([0, 100, -3], np.int16))
    assert value.dtype == np.float64
    assert value == pytest.approx([-50.0, -49.0, -50.03], abs=1e-12)


def test_counts_saturate_and_not_a_number_is_zero() -> None:
    raw = Quantity(0.01).raw(np.array([1e9, -1e9, np.nan, np.inf, 0.014, 0.016]), I16)
    assert raw.dtype == np.int16
    assert raw.tolist() == [32767, -32768, 0, 32767, 1, 2]


@given(st.lists(st.integers(-32768, 32767)), st.sampled_from([1.0, 0.01, -0.5, 3e-7]), st.sampled_from([0.0, -273.15]))
def test_raw_is_the_inverse_of_value(counts: list[int], scale: float, offset: float) -> None:
    law = Quantity(scale, offset)
    assert law.raw(law.value(np.array(counts, np.int16)), I16).tolist() == counts


def batch_of(count: int, begin: int = 0) -> FrameBatch:
    index = np.arange(begin, begin + count)
    columns = {"rate": index.astype("f4"), "status": np.where(index % 2, 0x76, 0x77).astype("u1")}
    return Meaning(Quantity(2.0), None, good_mask=0x01, good_value=0x77).batch(columns, index)


def test_status_is_compared_under_the_mask_and_missing_temperature_is_nan() -> None:
    batch = batch_of(4)
    assert batch.good.tolist() == [True, False, True, False]
    assert batch.rate_dps.tolist() == [0.0, 2.0, 4.0, 6.0]
    assert np.isnan(batch.temperature_degc).all() and len(batch.temperature_degc) == 4


def test_a_rate_that_is_no_number_is_not_good() -> None:
    columns = {"rate": np.array([1.0, np.nan, np.inf, -np.inf], np.float32)}
    assert Meaning(Quantity()).batch(columns, np.arange(4)).good.tolist() == [True, False, False, False]


def test_concat() -> None:
    joined = FrameBatch.concat([batch_of(2), batch_of(0), FrameBatch.empty(), batch_of(3, 2)])
    assert joined.index.tolist() == [0, 1, 2, 3, 4]
    assert joined.columns["rate"].dtype == np.float32
    assert joined.rate_dps.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert len(joined) == 5
    assert len(FrameBatch.concat([])) == 0
    assert FrameBatch.concat([batch_of(0), FrameBatch.empty()]).columns["rate"].dtype == np.float32


def test_columns_of_values() -> None:
    meaning = Meaning(Quantity(0.5), Quantity(0.01), good_mask=0x03, good_value=0x71)
    kinds = {"rate": RawType(np.dtype("f4")), "temperature": I16, "status": RawType.integer(8, False)}
    values = np.array([1.0, 2.0]), np.array([25.0, -30.0])
    columns = meaning.raw_columns(*values, np.array([True, True]), kinds)
    assert columns["status"] == 0x71
    columns = meaning.raw_columns(*values, np.array([True, False]), kinds)
    assert {name: np.asarray(column).tolist() for name, column in columns.items()} == {
        "rate": [2.0, 4.0],
        "temperature": [2500, -3000],
        "status": [0x71, 0x72],
    }
    assert columns["rate"].dtype == np.float32
