"""Plain tables of the command line."""

from hypothesis import given
from hypothesis import strategies as st

from bench.cli.options import table


def test_numbers_stand_right_and_words_left() -> None:
    rows = [["a", 1, "–", "2 h"], ["long name", -22.5, "5", "10 min"]]
    assert table(rows, ["name", "value", "n", "time"]).split("\n") == [
        "name       value  n    time",
        "a              1  –     2 h",
        "long name  -22.5  5  10 min",
    ]


def test_one_word_in_a_column_makes_it_a_column_of_words() -> None:
    assert table([["PASS", "1"], ["FAIL", "none"]], ["outcome", "n"]).split("\n") == [
        "outcome  n",
        "PASS     1",
        "FAIL     none",
    ]


def test_a_table_without_rows_is_its_header() -> None:
    assert table([], ["run", "outcome"]) == "run  outcome"


CELLS = st.one_of(st.integers(), st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=12))


@given(st.lists(st.lists(CELLS, min_size=3, max_size=3), max_size=6))
def test_every_cell_is_in_its_line_and_no_line_ends_in_blanks(rows: list[list[object]]) -> None:
    header = ["a", "bb", "ccc"]
    lines = table(rows, header).split("\n")
    assert len(lines) == len(rows) + 1
    for line, row in zip(lines, [header, *rows], strict=True):
        assert line == line.rstrip()
        assert line.split() == [str(cell) for cell in row]
