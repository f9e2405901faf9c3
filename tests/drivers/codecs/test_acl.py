"""ACL codec against the command forms seen in open clients, and arbitrary bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codecs.acl import (
    COMMON,
    KEYWORDS,
    MAX_LINE,
    AclError,
    Answer,
    AnswerParser,
    Command,
    LineParser,
    decode_commands,
    encode_answer,
    encode_commands,
)

arguments = st.lists(st.from_regex(r"[-+]?[0-9]{1,4}(\.[0-9]{1,4})?", fullmatch=True), max_size=4).map(tuple)
branches = st.sampled_from(
    [(main, sub) for main, subs in KEYWORDS.items() for sub in subs] + [("Mode",), ("Interlock",)]
)
commands = st.one_of(
    st.builds(
        lambda path, args, query: Command(path, args, query or path[0] == "Read"), branches, arguments, st.booleans()
    ),
    st.builds(lambda name: Command((name,), (), True), st.sampled_from(COMMON)),
)
printable = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=40)

# Protocol notes, rate tables, section 1: forms that open clients send.
SEEN = {
    "*IDN?": [Command(("*IDN",), (), True)],
    "*STB?": [Command(("*STB",), (), True)],
    ":Interlock:Reset": [Command(("Interlock", "Reset"))],
    ":Interlock:Close 1": [Command(("Interlock", "Close"), ("1",))],
    ":Interlock? 1": [Command(("Interlock",), ("1",), True)],
    ":Mode:Rate 1": [Command(("Mode", "Rate"), ("1",))],
    ":Mode 1,Rate": [Command(("Mode",), ("1", "Rate"))],
    ":Mode? 1": [Command(("Mode",), ("1",), True)],
    ":Dem:Pos 1,10.5": [Command(("Demand", "Position"), ("1", "10.5"))],
    ":D:P 1,10.5": [Command(("Demand", "Position"), ("1", "10.5"))],
    ":Demand:Oscillator 1, 20, 0.5, 90": [Command(("Demand", "Oscillator"), ("1", "20", "0.5", "90"))],
    ":read:pos? 1;rate? 1;acc? 1": [
        Command(("Read", quantity), ("1",), True) for quantity in ("Position", "Rate", "Acceleration")
    ],
    ":Read:Rate 1": [Command(("Read", "Rate"), ("1",), True)],
    ":Limit:Rate 1,100": [Command(("Limit", "Rate"), ("1", "100"))],
    ":Utility:Lockout ON": [Command(("Utility", "Lockout"), ("ON",))],
}


@pytest.mark.parametrize(("line", "expected"), SEEN.items())
def test_forms_of_open_clients(line, expected):
    assert decode_commands(line) == expected
    assert decode_commands(line.upper().replace("RATE 1", "Rate 1"))[0].path == expected[0].path


def test_our_own_lines():
    demand = Command(("Demand", "Rate"), ("1", "20.0"))
    assert encode_commands([demand], "lf") == b":Demand:Rate 1,20.0\n"
    read = [Command(("Read", "Rate"), ("1",), True), Command(("*IDN",), (), True)]
    assert encode_commands(read) == b":Read:Rate? 1;*IDN?\r\n"


@given(st.lists(commands, min_size=1, max_size=4), st.sampled_from(["lf", "crlf"]))
def test_command_lines_come_back(messages, terminator):
    (line,) = LineParser().feed(encode_commands(messages, terminator))
    assert decode_commands(line) == messages


@given(branches, st.data())
def test_any_unambiguous_abbreviation_in_any_case_is_taken(path, data):
    letters = [keyword[: data.draw(st.integers(1, len(keyword)))] for keyword in path]
    line = ":" + ":".join(data.draw(st.sampled_from([str.upper, str.lower, str]))(short) for short in letters) + " 1"
    assert decode_commands(line)[0].path == path


def test_a_branch_is_kept_across_common_commands_and_left_by_a_colon():
    paths = [command.path for command in decode_commands(":Read:Rate? 1;*IDN?;Pos? 1;:Mode? 1;Demand:Rate? 1")]
    assert paths == [("Read", "Rate"), ("*IDN",), ("Read", "Position"), ("Mode",), ("Demand", "Rate")]


@pytest.mark.parametrize(
    ("line", "names"),
    [
        (":Foo:Bar 1", "'Foo'"),
        (":Demand:Torque 1,2", "'Torque'.*Acceleration, Oscillator, Position, Rate"),
        (":Read:Rate:Fast? 1", "'Fast'"),
        ("::Rate 1", "unknown keyword ''"),
        ("Rate? 1", "'Rate'"),
        ("*RST", r"'\*RST'"),
        ("*", "ambiguous"),
    ],
)
def test_unknown_keywords_are_named(line, names):
    with pytest.raises(AclError, match=names):
        decode_commands(line)


def test_a_command_line_holds_nothing_but_text():
    with pytest.raises(AclError):
        encode_commands([Command(("Demand", "Rate"), ("1", "2\n:Interlock:Open 1"))])


@given(st.lists(printable, min_size=1, max_size=5), st.booleans(), st.data())
def test_answers_come_out_of_any_slicing(texts, prefixed, data):
    stream = b"".join(encode_answer(Answer(text, 0), prefixed) for text in texts)
    parser, answers, at = AnswerParser(), [], 0
    while at < len(stream):
        step = data.draw(st.integers(1, len(stream)))
        answers += parser.feed(stream[at : at + step])
        at += step
    assert [answer.text for answer in answers] == texts
    assert {answer.error for answer in answers} == {0 if prefixed else None}


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize("error", [0, 7, 10, -3])
def test_prefixed_answers_in_either_byte_order(order, error):
    data = error.to_bytes(4, order, signed=True) + (7).to_bytes(4, order) + b"12.50\r\n"
    assert AnswerParser().feed(data) == [Answer("12.50", error)]


def test_empty_line_ok_and_joined_answers():
    assert AnswerParser().feed(b"\r\nOK\n1.0;2.0 ; 3.0\r\n") == [Answer(""), Answer("OK"), Answer("1.0;2.0 ; 3.0")]
    assert Answer("1.0;2.0 ; 3.0").fields == ["1.0", "2.0", "3.0"]


@given(st.binary(max_size=200))
def test_arbitrary_bytes_give_answers_or_a_clear_error(data):
    try:
        for answer in AnswerParser().feed(data):
            assert answer.text.isascii()
    except AclError as error:
        assert len(str(error)) > 15
    for line in LineParser().feed(data + b"\n"):
        assert line.isascii()
        try:
            decode_commands(line)
        except AclError as error:
            assert str(error).isascii()


def test_what_never_ends_is_dropped():
    with pytest.raises(AclError, match="end of line"):
        AnswerParser().feed(b"x" * (MAX_LINE + 1))
    lines = LineParser()
    assert lines.feed(b"x" * (MAX_LINE + 1)) == []
    assert lines.feed(b"*IDN?\n") == ["*IDN?"]
