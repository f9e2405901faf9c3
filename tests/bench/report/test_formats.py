import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.report.formats import (
    MINUS,
    MISSING,
    count,
    decimals_missing,
    duration,
    fault,
    fixed,
    ratio,
    setpoint,
    significant,
)

MAGNITUDES = st.floats(1e-7, 1e6, allow_nan=False)


@given(MAGNITUDES, st.integers(2, 5))
def test_significant_keeps_so_many_digits(value: float, digits: int) -> None:
    text = significant(value, digits)
    assert "e" not in text
    assert float(text) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) * 1.0001, abs=0.5)
    assert value >= 10 ** (digits - 1) or float(text) == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) * 1.0001)


@given(MAGNITUDES)
def test_negative_numbers_carry_a_true_minus(value: float) -> None:
    assert significant(-value) == MINUS + significant(value)


def test_a_fault_names_the_file_only() -> None:
    path = Path("/a/b/run/points.csv")
    error = PermissionError(13, "Permission denied", str(path))
    assert fault(error, path) == "[Errno 13] Permission denied: 'points.csv'"


def test_rounding_up_does_not_add_a_digit() -> None:
    assert significant(9.996) == "10.0"
    assert significant(0.09996) == "0.100"


@pytest.mark.parametrize("nothing", [None, math.nan, math.inf])
def test_what_is_not_a_number_is_a_dash(nothing: float | None) -> None:
    assert {
        significant(nothing),
        fixed(nothing, 2),
        count(nothing),
        duration(nothing),
        setpoint(nothing),
        ratio(nothing, 1.0),
        ratio(1.0, nothing),
    } == {MISSING}


def test_fixed_has_no_negative_zero() -> None:
    assert fixed(-0.001, 2) == "0.00"
    assert fixed(-0.126, 2) == MINUS + "0.13"


def test_ratio_to_zero_is_unknown() -> None:
    assert ratio(4.0, 0.0) == MISSING


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (59.94, "59.9 s"),
        (59.96, "1 min 00 s"),
        (3599.6, "1 h 00 min"),
        (7170.0, "2 h 00 min"),
        (86400 * 7, "168 h 00 min"),
    ],
)
def test_durations_roll_over(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@given(st.lists(MAGNITUDES, min_size=1, max_size=8))
def test_padding_aligns_the_decimal_points(values: list[float]) -> None:
    texts = [f"{value:.{index}f}" for index, value in enumerate(values)]
    pads = decimals_missing(texts)
    assert {len(text.partition(".")[2]) + pad for text, pad in zip(texts, pads, strict=True)} == {len(values) - 1}
