"""SCPI lines against the wording of SCPI-99 and IEEE 488.2."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs import scpi
from drivers.codecs.scpi import Message, ScpiError, decode_messages, encode_answer, encode_message, is_header


def test_a_line_is_messages_in_branches():
    """SCPI-99 volume 1, 6.2.4: a header after ';' continues in the branch before, unless it begins with ':' or '*'."""
    assert decode_messages(":MEAS:VOLT?;CURR?;:OUTP ON;*IDN?; ") == [
        Message("MEAS:VOLT", query=True),
        Message("MEAS:CURR", query=True),
        Message("OUTP", ("ON",)),
        Message("*IDN", query=True),
    ]
    assert decode_messages("VOLT 28.0, 5;CURR MAX") == [Message("VOLT", ("28.0", "5")), Message("CURR", ("MAX",))]
    assert decode_messages("*CLS;OUTP 0") == [Message("*CLS"), Message("OUTP", ("0",))]
    assert decode_messages("") == []


@pytest.mark.parametrize(
    ("header", "form", "same"),
    [
        ("OUTP", "OUTPut[:STATe]", True),
        ("outPUT:stat", "OUTPut[:STATe]", True),
        ("OUTPUT:STATE", "OUTPut[:STATe]", True),
        ("OUTPU", "OUTPut[:STATe]", False),
        ("OUTP:", "OUTPut[:STATe]", False),
        ("MEAS:SCAL:VOLT:DC", "MEASure[:SCALar]:VOLTage[:DC]", True),
        ("MEAS:CURR", "MEASure[:SCALar]:VOLTage[:DC]", False),
        ("SOUR:VOLT", "[SOURce:]VOLTage[:LEVel]", True),
        ("VOLT:LEV", "[SOURce:]VOLTage[:LEVel]", True),
        ("*idn", "*IDN", True),
    ],
)
def test_long_short_and_left_out(header, form, same):
    assert is_header(header, form) is same


@pytest.mark.parametrize(("text", "value"), [("28", 28.0), (" +2.80E+01", 28.0), ("-.5", -0.5), ("1e-3", 1e-3)])
def test_numbers(text, value):
    assert scpi.number(text) == value


@pytest.mark.parametrize("text", ["", "on", "9.91E37", "9.9E37", "-9.9E+37", "nan", "inf", "1,2"])
def test_no_numbers(text):
    with pytest.raises(ScpiError, match="is no number"):
        scpi.number(text)


def test_booleans():
    assert [scpi.boolean(text) for text in ("1", "ON", "on", "0", "Off")] == [True, True, True, False, False]
    with pytest.raises(ScpiError, match="'2' is neither 0, 1, OFF nor ON"):
        scpi.boolean("2")


@pytest.mark.parametrize(
    ("text", "entry"),
    [
        ('0,"No error"', (0, "No error")),
        ('+0,"No error"', (0, "No error")),
        ('-222, "Data out of range;VOLT 99"', (-222, "Data out of range;VOLT 99")),
        ('101,"say ""no"""', (101, 'say "no"')),
    ],
)
def test_error_queue(text, entry):
    assert scpi.error_of(text) == entry


@pytest.mark.parametrize("text", ["", "0", "No error", '0,"No error', "28.00"])
def test_no_error_queue(text):
    with pytest.raises(ScpiError, match="no entry of an error queue"):
        scpi.error_of(text)


def test_lines_are_ascii():
    assert encode_message("SYST:ERR", query=True) == b"SYST:ERR?\n"
    assert encode_message("VOLT", "28", "5") == b"VOLT 28,5\n"
    assert encode_answer(["1", "28.0"]) == b"1;28.0\n"
    with pytest.raises(ScpiError, match="printable ASCII"):
        encode_message("VOLT", "28\n")


@given(st.text(st.characters(max_codepoint=127), max_size=80))
def test_any_line_is_read_somehow(line):
    for message in decode_messages(line):
        is_header(message.header, "MEASure[:SCALar]:VOLTage[:DC]")
