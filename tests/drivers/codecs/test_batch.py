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


def channelled(count: int, begin: int = 0) -> FrameBatch:
    index = np.arange(begin, begin + count)
    columns = {"rate": index.astype("f4"), "case_degc": (10 * index).astype("i2"), "rate_y_dps": -index.astype("f4")}
    laws = {"rate": Quantity(2.0), "case_degc": Quantity(0.1, 20.0, "degC"), "rate_y_dps": Quantity(0.5)}
    return Meaning.of(laws, 0, 0).batch(columns, index)


def test_channels_are_values_by_their_own_laws() -> None:
    batch = channelled(3)
    assert batch.channels.keys() == {"case_degc", "rate_y_dps"}
    assert batch.channels["case_degc"].dtype == np.float64
    assert batch.channels["case_degc"].tolist() == [20.0, 21.0, 22.0]
    assert batch.channels["rate_y_dps"].tolist() == [0.0, -0.5, -1.0]
    assert batch.columns["case_degc"].dtype == np.int16
    assert batch_of(2).channels == {} and FrameBatch.empty().channels == {}


def test_a_meaning_is_what_its_quantities_say() -> None:
    laws = {"rate": Quantity(2.0), "temperature": Quantity(0.1), "case_degc": Quantity(0.01)}
    meaning = Meaning.of(laws, 3, 1)
    assert meaning == Meaning(laws["rate"], laws["temperature"], 3, 1, {"case_degc": Quantity(0.01)})
    assert meaning.quantities == laws
    assert Meaning.of({"rate": Quantity()}, 0, 0) == Meaning(Quantity())


def test_concat_head_and_part_carry_channels_along() -> None:
    joined = FrameBatch.concat([channelled(2), FrameBatch.empty(), channelled(0), channelled(3, 2)])
    assert joined.channels["rate_y_dps"].tolist() == [0.0, -0.5, -1.0, -1.5, -2.0]
    head = joined.head(2)
    assert (len(head), head.index.tolist(), head.rate_dps.tolist()) == (2, [0, 1], [0.0, 2.0])
    assert head.channels["case_degc"].tolist() == [20.0, 21.0] and head.columns["case_degc"].tolist() == [0, 10]
    assert len(joined.head(99)) == 5
    middle = joined.part(1, 3)
    assert middle.channels["rate_y_dps"].tolist() == [-0.5, -1.0] and middle.good.tolist() == [True, True]
    assert np.isnan(middle.temperature_degc).all() and np.shares_memory(middle.rate_dps, joined.rate_dps)


def test_columns_of_channels_are_those_given_and_carried() -> None:
    meaning = Meaning(Quantity(0.5), channels={"case_degc": Quantity(0.01, 20.0), "accel_x_g": Quantity(1e-3)})
    kinds = {"rate": RawType(np.dtype("f4")), "case_degc": I16, "accel_x_g": I16}
    values = {"case_degc": np.array([25.0, -400.0]), "anode_degc": np.array([1.0, 2.0])}
    columns = meaning.raw_columns(np.zeros(2), np.zeros(2), np.ones(2, np.bool_), kinds, values)
    assert columns.keys() == {"rate", "case_degc"}
    assert np.asarray(columns["case_degc"]).tolist() == [500, -32768]
