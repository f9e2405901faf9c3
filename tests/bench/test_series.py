"""Rows of a record from frames: the same whatever the blocks, an open place for what was lost."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rawstore import RawFile, write_parquet
from bench.series import Growing, SeriesIncomplete, finished_series, part_name, read_parts, rows_of
from drivers.codecs.batch import FrameBatch


def frames_at(index: np.ndarray, good: np.ndarray | None = None) -> FrameBatch:
    """Frames whose rate is their number, whose temperature is minus it, and with one channel."""
    value = index.astype(float)
    good = np.ones(len(index), bool) if good is None else good
    return FrameBatch({"rate": index.astype("f4")}, index, value, -value, good, {"case_degc": 2 * value})


def test_a_row_is_the_mean_of_its_good_frames_and_empty_without_one() -> None:
    index = np.array([0, 1, 2, 3, 4, 8, 9, 10, 11])
    good = np.array([1, 1, 1, 1, 0, 1, 1, 1, 1], bool)
    rows = rows_of(frames_at(index, good), index, 4.0, 0, 3)
    np.testing.assert_array_equal(rows["row"], [0, 1, 2])
    np.testing.assert_array_equal(rows["frames"], [4, 0, 4])
    np.testing.assert_allclose(rows["rate_dps"], [1.5, np.nan, 9.5])
    np.testing.assert_allclose(rows["temperature_degc"], [-1.5, np.nan, -9.5])
    np.testing.assert_allclose(rows["case_degc"], [3.0, np.nan, 19.0])


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=30),
    st.sets(st.integers(0, 300), max_size=40),
    st.sampled_from([1.0, 2.5, 7.0, 30.0]),
    st.integers(5, 60),
)
def test_blocks_and_parts_change_no_row(
    blocks: list[int], lost: set[int], frames_per_row: float, part_frames: int
) -> None:
    index = np.array([k for k in range(1000, 1000 + sum(blocks)) if k == 1000 or k - 1000 not in lost], dtype=np.int64)
    growing = Growing(frames_per_row, part_frames)
    parts, at = [], 0
    for size in [*blocks, 0]:
        parts.append(growing.take(frames_at(index[at : at + size])))
        at += size
    parts.append(growing.take(frames_at(index[at:])))
    parts.append(growing.finish(10**6))
    made = [part for part in parts if part is not None]
    if len(index) == 0:
        assert not made
        return
    count = int((index[-1] - 1000 + 1.5) / frames_per_row)
    whole = rows_of(frames_at(index), index - 1000, frames_per_row, 0, count)
    assert growing.rows == count and growing.parts == len(made)
    for name in whole:
        joined = np.concatenate([rows[name] for _, rows in made]) if made else np.empty(0)
        np.testing.assert_array_equal(joined, whole[name])
    kept = np.concatenate([frames.index for frames, _ in made]) if made else np.empty(0)
    np.testing.assert_array_equal(kept, index[(index - 1000 + 0.5) / frames_per_row < count])


def test_rows_after_the_end_of_the_record_are_left_out() -> None:
    growing = Growing(10.0)
    growing.take(frames_at(np.arange(100)))
    finished = growing.finish(7)
    assert finished is not None and growing.rows == 7
    assert finished[0].index[-1] == 69


ABOUT = {"record": 4, "label": "cycle", "dut": "D", "started_at_s": 10.0, "every_s": 2.0, "parts": 2, "rows": 5}


def parts_on_disk(folder: Path, started_at_s: float = 10.0) -> None:
    (folder / "raw").mkdir()
    for part, row in ((1, np.arange(3)), (2, np.arange(3, 5))):
        columns = {"row": row, "rate_dps": row * 1.0, "frames": row * 0 + 2}
        name = part_name(4, "D", part, "samples")
        write_parquet(folder / "raw" / name, columns, {"started_at_s": started_at_s if part == 2 else 10.0})


def test_parts_are_joined_with_the_time_of_the_middle_of_each_row(tmp_path: Path) -> None:
    parts_on_disk(tmp_path)
    series = read_parts(tmp_path, ABOUT)
    np.testing.assert_array_equal(series["t_s"], [11.0, 13.0, 15.0, 17.0, 19.0])
    np.testing.assert_array_equal(series["rate_dps"], [0.0, 1.0, 2.0, 3.0, 4.0])


def test_a_part_of_another_attempt_and_a_missing_row_are_refused(tmp_path: Path) -> None:
    parts_on_disk(tmp_path, started_at_s=11.0)
    with pytest.raises(SeriesIncomplete, match="of another attempt"):
        read_parts(tmp_path, ABOUT)
    with pytest.raises(SeriesIncomplete, match="rows missing"):
        read_parts(tmp_path, ABOUT | {"parts": 1})


def test_only_a_finished_record_counts() -> None:
    series = {"kind": "series", "about": {"label": "a"}}
    step, done = {"kind": "step"}, {"kind": "done"}
    assert finished_series([step, series, done]) == [{"label": "a"}]
    assert finished_series([step, series, {"kind": "resumed"}, step, done]) == []


def test_a_raw_file_keeps_what_a_part_is_of() -> None:
    assert RawFile(part_name(4, "D", 1, "frames"), {}, {}).name == "r00004-D-00001.frames.parquet"
