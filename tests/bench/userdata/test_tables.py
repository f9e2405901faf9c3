"""CSV and Parquet as loggers write them: read in pieces, with the place of everything that is wrong."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.errors import InvalidFiles, UserMistake
from bench.userdata.columns import columns_named, parse_map
from bench.userdata.tables import open_table, sha256_of


def written(folder: Path, text: str, name: str = "d.csv") -> Path:
    (folder / name).write_bytes(text.encode())
    return folder / name


def read(path: Path, name: str, rows: int = 3) -> list[float]:
    return [value for chunk in open_table(path).chunks(rows) for value in chunk.numbers(name).tolist()]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_delimiters_line_ends_comments_blank_lines_and_the_mark_of_excel(
    tmp_path: Path, delimiter: str, end: str
) -> None:
    lines = ["# logger 3", "# made in May", "a,b".replace(",", delimiter), "1,2".replace(",", delimiter), ""]
    path = written(tmp_path, end.join([*lines, "3,-4.5e-1".replace(",", delimiter)]) + end)
    table = open_table(path)
    assert table.header == ("a", "b") and table.delimiter == delimiter and len(table.comments) == 2
    assert read(path, "b") == [2.0, -0.45]
    assert [line for chunk in table.chunks() for line in chunk.lines] == [4, 6]
    assert open_table(written(tmp_path, "\ufeffa,b\n1,2\n")).header == ("a", "b")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(
    st.lists(st.tuples(st.floats(allow_nan=False, allow_infinity=False), st.integers()), max_size=20), st.integers(1, 7)
)
def test_numbers_come_back_whatever_the_pieces(tmp_path: Path, rows: list[tuple[float, int]], size: int) -> None:
    path = written(tmp_path, "x,n\n" + "".join(f"{x!r},{n}\n" for x, n in rows))
    assert read(path, "x", size) == [x for x, _ in rows]


def test_what_is_missing_is_nan_and_so_is_infinity(tmp_path: Path) -> None:
    path = written(tmp_path, "x,y\n,1\nnan,1\nNA,1\n-,1\ninf,1\n 7 ,1\n")
    assert np.isnan(read(path, "x", 100)).tolist() == [True] * 5 + [False]


def test_text_in_a_column_of_numbers_is_reported_with_every_place(tmp_path: Path) -> None:
    path = written(tmp_path, '# c\nt,x\n1,2\n2,"12,5"\n3,broken\n')
    with pytest.raises(InvalidFiles) as error:
        read(path, "x", 100)
    told = str(error.value)
    assert f"{path}:4:2: column 'x' has '12,5'; write a decimal point" in told
    assert f"{path}:5:2: column 'x' has 'broken'; allowed: a number" in told


def test_a_row_of_another_length_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InvalidFiles, match=r"d.csv:3:3: this row has 3 cells and the header has 2 names"):
        read(written(tmp_path, "x,y\n1,2\n1,2,3\n"), "x")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "the file is empty"),
        ("1.5,2.5\n1,2\n", "d.csv:1: the first line holds numbers"),
        ("a,b,a\n1,2,3\n", "the column 'a' is there twice"),
    ],
)
def test_a_header_that_cannot_be_used_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(UserMistake, match=told):
        open_table(written(tmp_path, text))


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"a,b\n\xff\xfe,1\n")
    with pytest.raises(UserMistake, match=r"UTF-8|cannot be read"):
        read(tmp_path / "x.csv", "b")
    with pytest.raises(UserMistake, match="no such file"):
        open_table(tmp_path / "none.csv")
    with pytest.raises(UserMistake, match="not a Parquet file"):
        open_table(written(tmp_path, "a,b\n", "x.parquet"))


def test_parquet_reads_as_the_same_numbers(tmp_path: Path) -> None:
    values = np.random.default_rng(0).standard_normal(50)
    values[7] = np.nan
    pd.DataFrame({"when": pd.date_range("2026-01-01", periods=50), "x": values}).to_parquet(tmp_path / "d.parquet")
    assert np.array_equal(read(tmp_path / "d.parquet", "x", 13), values, equal_nan=True)


def test_a_map_may_be_one_option_or_several_and_name_columns_with_signs() -> None:
    allowed = ["temperature", "rate", "truth"]
    assert parse_map(["temperature=T1+T2, rate=w"], allowed) == {"temperature": "T1+T2", "rate": "w"}
    assert parse_map(["rate=omega, deg/s", "truth=0"], allowed) == {"rate": "omega, deg/s", "truth": "0"}
    with pytest.raises(UserMistake, match="not QUANTITY=COLUMN"):
        parse_map(["temperature"], allowed)
    with pytest.raises(UserMistake, match=r"unknown quantity 'temprature'.*Did you mean temperature"):
        parse_map(["temprature=T"], allowed)


def test_columns_are_found_or_the_nearest_is_named(tmp_path: Path) -> None:
    table = open_table(written(tmp_path, "T_coil,a+b,w\n1,2,3\n"))
    assert columns_named(table, "a+b", "temperature") == ["a+b"]
    assert columns_named(table, "T_coil+w", "temperature") == ["T_coil", "w"]
    with pytest.raises(UserMistake, match=r"d.csv:1: there is no column 'Tcoil'.*Did you mean T_coil"):
        columns_named(table, "Tcoil", "temperature")


def test_the_hash_is_of_the_bytes(tmp_path: Path) -> None:
    empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
    assert sha256_of(written(tmp_path, "")) == empty
