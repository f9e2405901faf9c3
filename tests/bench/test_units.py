"""Quantities: every unit against a figure worked out by hand, what is refused, and arbitrary text."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.units import DIMENSIONS, format_duration, parse_quantity, shown, split_suffix

# One line per unit that is accepted, with the value in the unit of the suffix.
GOLDEN = [
    ("s", "1.5 s", 1.5),
    ("s", "250 ms", 0.25),
    ("s", "90 min", 5400.0),
    ("s", "2 h", 7200.0),
    ("s", "7 d", 604800.0),
    ("degc", "-30 degC", -30.0),
    ("k", "0.5 K", 0.5),
    ("k", "5 degC", 5.0),
    ("degc_min", "1 degC/min", 1.0),
    ("degc_min", "2 K/min", 2.0),
    ("degc_min", "30 degC/h", 0.5),
    ("degc_min", "6 K/h", 0.1),
    ("degc_min", "0.01 degC/s", 0.6),
    ("degc_min", "0.01 K/s", 0.6),
    ("deg", "-90 deg", -90.0),
    ("deg", "30 arcmin", 0.5),
    ("deg", "3600 arcsec", 1.0),
    ("deg", "1 rad", 57.29577951308232),
    ("arcsec", "1.5 arcsec", 1.5),
    ("arcsec", "2 arcmin", 120.0),
    ("arcsec", "0.001 deg", 3.6),
    ("dps", "-180 deg/s", -180.0),
    ("dps", "60 deg/min", 1.0),
    ("dps", "36 deg/h", 0.01),
    ("dps", "1 rad/s", 57.29577951308232),
    ("dps2", "50 deg/s^2", 50.0),
    ("dps2", "50 deg/s2", 50.0),
    ("dph", "0.3 deg/h", 0.3),
    ("dph", "0.001 deg/s", 3.6),
    ("deg_sqrt_h", "0.05 deg/sqrt(h)", 0.05),
    ("dph_sqrt_h", "0.1 deg/h/sqrt(h)", 0.1),
    ("dph_h", "0.01 deg/h/h", 0.01),
    ("hz", "100 Hz", 100.0),
    ("hz", "1 kHz", 1000.0),
    ("ppm", "100 ppm", 100.0),
    ("ppm", "0.5 %", 5000.0),
    ("ppm_k", "5 ppm/K", 5.0),
    ("ppm_k", "5 ppm/degC", 5.0),
    ("ppm_k2", "0.1 ppm/K^2", 0.1),
    ("ppm_k2", "0.1 ppm/degC^2", 0.1),
    ("dph_k", "0.02 deg/h/K", 0.02),
    ("dph_k", "0.02 deg/h/degC", 0.02),
    ("v", "28 V", 28.0),
    ("v", "1500 mV", 1.5),
    ("a", "2 A", 2.0),
    ("a", "350 mA", 0.35),
    ("w", "800 W", 800.0),
    ("w", "2 kW", 2000.0),
    ("w_k", "100 W/K", 100.0),
    ("j_k", "30000 J/K", 30000.0),
    ("j_k", "4 kJ/K", 4000.0),
    ("byte", "12 B", 12.0),
    ("byte", "12 kB", 12e3),
    ("byte", "500 MB", 5e8),
    ("byte", "2 GB", 2e9),
]


@pytest.mark.parametrize(("suffix", "text", "value"), GOLDEN)
def test_every_unit(suffix: str, text: str, value: float) -> None:
    assert parse_quantity(text, suffix) == pytest.approx(value, rel=1e-15)


def test_the_golden_values_cover_every_unit_there_is() -> None:
    accepted = {(suffix, unit) for suffix, dimension in DIMENSIONS.items() for unit in dimension.factors}
    assert {(suffix, text.split(" ", 1)[1]) for suffix, text, _ in GOLDEN} == accepted


@pytest.mark.parametrize("suffix", DIMENSIONS)
def test_the_first_unit_is_that_of_the_suffix_and_the_example_is_right(suffix: str) -> None:
    assert next(iter(DIMENSIONS[suffix].factors.values())) == 1
    assert parse_quantity(DIMENSIONS[suffix].example, suffix) > -31


@pytest.mark.parametrize(
    ("text", "suffix", "value"),
    [
        ("2h", "s", 7200.0),
        ("  2   h ", "s", 7200.0),
        ("+5 s", "s", 5.0),
        (".5 s", "s", 0.5),
        ("5. s", "s", 5.0),
        ("1e3 s", "s", 1000.0),
        ("1.5E-3 s", "s", 0.0015),
        ("-30°C", "degc", -30.0),
        ("20 °C/min", "degc_min", 20.0),
        ("90°", "deg", 90.0),
        ("10 °/s", "dps", 10.0),
        ("50 deg/s²", "dps2", 50.0),
        ("50 °/s²", "dps2", 50.0),
        ("0.05 °/√h", "deg_sqrt_h", 0.05),
        ("0.05 deg/√h", "deg_sqrt_h", 0.05),
        ("0.05 deg/√(h)", "deg_sqrt_h", 0.05),
        ("0.1 °/h/√h", "dph_sqrt_h", 0.1),
    ],
)
def test_other_spellings(text: str, suffix: str, value: float) -> None:
    assert parse_quantity(text, suffix) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "suffix", "words"),
    [
        ("10 degC/s", "dps", ["'10 degC/s' has the unit 'degC/s'", "angular rate", "deg/s, deg/min", "'10 deg/s'"]),
        ("10 deg/s", "dps2", ["'deg/s'", "angular acceleration", "deg/s^2"]),
        ("5 K", "degc", ["'K'", "temperature", "degC"]),
        ("5 S", "s", ["'S'", "time", "s, ms, min, h, d"]),
        ("5 m in", "s", ["'m in'", "time"]),
        ("2 h 30 min", "s", ["'h 30 min'"]),
        ("5", "s", ["'5' has no unit", "time", "'2 h'"]),
        (5, "s", ["5 has no unit", "time", "'2 h'"]),
        (0, "dps", ["0 has no unit"]),
        (True, "s", ["true is not a quantity", "time"]),
        (None, "s", ["nothing is not a quantity", "time"]),
        (["5 s"], "s", ["a list is not a quantity"]),
        ({"for": 5}, "s", ["a mapping is not a quantity"]),
        (math.nan, "s", ["not a finite number"]),
        (math.inf, "s", ["not a finite number"]),
        ("nan s", "s", ["'nan s' is not a finite number"]),
        ("inf s", "s", ["not a finite number"]),
        ("", "s", ["'' is not a finite number"]),
        ("fast", "dps", ["'fast' is not a finite number"]),
        ("1e999 s", "s", ["too large"]),
        ("1e305 d", "s", ["too large"]),
        ("١ s", "s", ["not a finite number"]),
        ("0x10 s", "s", ["'x10 s'"]),
        ("1,5 s", "s", ["',5 s'"]),
        ("--5 s", "s", ["not a finite number"]),
    ],
)
def test_refusals_say_what_is_allowed(value: object, suffix: str, words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        parse_quantity(value, suffix)
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert DIMENSIONS[suffix].example in message


def test_a_million_digits_are_refused_at_once_and_in_few_words() -> None:
    """A backtracking pattern takes hours over this one."""
    with pytest.raises(ValueError) as caught:
        parse_quantity("1" * 1_000_000 + "x\ny", "s")
    assert len(str(caught.value)) < 300


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(GOLDEN))
def test_round_trip_of_any_number_in_any_unit(number: float, golden: tuple[str, str, float]) -> None:
    suffix, unit = golden[0], golden[1].split(" ", 1)[1]
    expected = number * DIMENSIONS[suffix].factors[unit]
    if math.isfinite(expected):
        assert parse_quantity(f"{number!r} {unit}", suffix) == expected
    else:
        with pytest.raises(ValueError, match="too large"):
            parse_quantity(f"{number!r} {unit}", suffix)


@given(
    st.one_of(
        st.text(),
        st.text(alphabet="0123456789+-.eE degCs/minhrad°²√\n"),
        st.integers(),
        st.floats(),
        st.none(),
        st.booleans(),
        st.lists(st.integers()),
    ),
    st.sampled_from(sorted(DIMENSIONS)),
)
def test_anything_else_is_a_finite_number_or_a_short_refusal(value: object, suffix: str) -> None:
    try:
        assert math.isfinite(parse_quantity(value, suffix))
    except ValueError as error:
        assert len(str(error)) < 500


@given(st.from_regex(r"[a-z]{1,8}", fullmatch=True), st.sampled_from(sorted(DIMENSIONS)))
def test_the_longest_suffix_of_a_field_name_counts(stem: str, suffix: str) -> None:
    assert split_suffix(f"{stem}_{suffix}") == (stem, suffix)
    assert split_suffix(suffix) == (suffix, None) or "_" in suffix


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"),
        (0.4, "0.4 s"),
        (59.4, "59.4 s"),
        (60.0, "1 min"),
        (95.2, "1 min 35 s"),
        (3599.6, "1 h"),
        (3661.0, "1 h 1 min"),
        (86400.0, "1 d"),
        (563_000.0, "6 d 12 h 23 min"),
        (math.inf, "inf s"),
        (1e300, "1e+300 s"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert format_duration(seconds) == text


@given(st.floats(min_value=60, max_value=1e9))
def test_a_duration_read_back_is_within_its_last_figure(seconds: float) -> None:
    figures = format_duration(seconds).split()
    read = sum(parse_quantity(f"{n} {u}", "s") for n, u in zip(figures[::2], figures[1::2], strict=True))
    assert -0.5 <= seconds - read < (60.5 if seconds >= 3599.5 else 1.0)


@given(st.recursive(st.one_of(st.none(), st.text(), st.floats(), st.integers()), st.lists, max_leaves=50))
def test_values_are_shown_short(value: object) -> None:
    assert 0 < len(shown(value)) <= 102
