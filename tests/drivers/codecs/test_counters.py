"""Modulo counters to indices, against a plain loop; outages longer than the counter; repeated frames."""

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.codecs.counters import Losses, Sequence, counter_values


def rows(indices: list[int]) -> NDArray[np.uint8]:
    """Frames that differ whenever their index does."""
    return np.array(indices, "<u8").view(np.uint8).reshape(-1, 8)


def admit(
    sequence: Sequence, indices: list[int], modulo: int, step: int = 1, elapsed_s: float | None = None
) -> list[int]:
    shown = np.array([index * step % modulo for index in indices], np.min_scalar_type(modulo - 1))
    _, index = sequence.admit(rows(indices), shown, elapsed_s)
    return index.tolist()


gaps = st.lists(st.integers(1, 128) | st.just(1), max_size=60)


@given(first=st.integers(0, 127), steps=gaps, cuts=st.lists(st.integers(0, 60), max_size=5))
def test_index_is_the_true_number_whatever_is_missing_up_to_a_period(
    first: int, steps: list[int], cuts: list[int]
) -> None:
    true = np.cumsum([first, *steps]).tolist()
    sequence = Sequence(128)
    index: list[int] = []
    for begin, end in zip([0, *sorted(cuts)], [*sorted(cuts), len(true)], strict=True):
        index += admit(sequence, true[begin:end], 128)
    assert index == true
    assert sequence.lost == true[-1] - true[0] + 1 - len(true)
    assert sequence.duplicates == 0


def test_repeated_frames_are_dropped_also_across_batches_and_more_than_once() -> None:
    sequence = Sequence(128)
    keep, index = sequence.admit(rows([5, 6, 6, 6, 7]), np.array([5, 6, 6, 6, 7], np.uint8), None)
    assert keep is not None and keep.tolist() == [True, True, False, False, True]
    assert index.tolist() == [5, 6, 7]
    keep, index = sequence.admit(rows([7]), np.array([7], np.uint8), None)
    assert keep is not None and not keep.any() and len(index) == 0
    assert admit(sequence, [8], 128) == [8]
    assert (sequence.duplicates, sequence.lost) == (3, 0)


def test_same_counter_with_other_bytes_is_a_whole_period_lost() -> None:
    sequence = Sequence(128)
    assert admit(sequence, [3, 3 + 128], 128) == [3, 131]
    assert (sequence.duplicates, sequence.lost) == (0, 127)


@pytest.mark.parametrize("missing", [128, 129, 300, 128 * 40])
@pytest.mark.parametrize("silent_polls", [0, 3])
def test_an_outage_longer_than_the_counter_is_resolved_by_time(missing: int, silent_polls: int) -> None:
    sequence = Sequence(128, data_rate_hz=100.0)
    assert admit(sequence, list(range(50)), 128, elapsed_s=0.5) == list(range(50))
    after = list(range(50 + missing, 150 + missing))
    # the reader is 20 ms late
    elapsed_s = (missing + 100) / 100.0 + 0.02
    for _ in range(silent_polls):
        admit(sequence, [], 128, elapsed_s=missing / 100.0 / silent_polls)
        elapsed_s -= missing / 100.0 / silent_polls
    # exactly whole periods missing inside one batch leave no trace but the time, and that alone is not believed
    traceless = missing % 128 == 0 and silent_polls == 0
    assert admit(sequence, after, 128, elapsed_s=elapsed_s) == (list(range(50, 150)) if traceless else after)
    assert sequence.lost == (0 if traceless else missing)


def test_a_wrong_data_rate_makes_no_losses_in_a_stream_without_gaps() -> None:
    sequence = Sequence(128, data_rate_hz=1000.0)
    for begin in range(0, 1000, 100):
        admit(sequence, list(range(begin, begin + 100)), 128, elapsed_s=1.0)
    assert sequence.lost == 0


def test_a_late_reader_does_not_make_a_small_gap_a_large_one() -> None:
    sequence = Sequence(128, data_rate_hz=100.0)
    admit(sequence, list(range(100)), 128, elapsed_s=1.0)
    indices = [*range(100, 150), *range(152, 200)]
    assert admit(sequence, indices, 128, elapsed_s=1.5) == indices
    assert sequence.lost == 2


@given(first=st.integers(0, 500), missing=st.integers(0, 500))
def test_reanchoring_counts_no_loss_and_never_goes_back(first: int, missing: int) -> None:
    sequence = Sequence(128, data_rate_hz=100.0)
    before = admit(sequence, list(range(first, first + 10)), 128)
    sequence.reanchor()
    start = first + 10 + missing
    after = admit(sequence, [*range(start, start + 5), *range(start + 7, start + 9)], 128, elapsed_s=0.1)
    assert sequence.lost == 2
    assert after[0] > before[-1] and after[0] % 128 == start % 128
    assert [index - after[0] for index in after] == [0, 1, 2, 3, 4, 7, 8]


def test_after_joining_an_outage_inside_the_first_batch_is_resolved() -> None:
    sequence = Sequence(128, data_rate_hz=100.0)
    admit(sequence, [0, 1], 128)
    sequence.reanchor()
    indices = [*range(1000, 1100), *range(1400, 1500)]
    index = admit(sequence, indices, 128, elapsed_s=5.0)
    assert index[-1] - index[0] == 499
    assert sequence.lost == 300


@given(step=st.sampled_from([1, 2, 8, 16]), phase=st.integers(0, 15), steps=st.lists(st.integers(1, 8), max_size=30))
def test_a_counter_that_counts_in_larger_steps_at_any_phase(step: int, phase: int, steps: list[int]) -> None:
    true = np.cumsum([0, *steps])
    shown = ((true * step + phase % step) % 256).astype(np.uint8)
    sequence = Sequence(256, step)
    _, index = sequence.admit(rows(true.tolist()), shown, None)
    assert (index - index[0]).tolist() == true.tolist()
    assert sequence.lost == true[-1] + 1 - len(true)


def test_a_wide_counter() -> None:
    sequence = Sequence(1 << 32)
    true = [*range(2**32 - 5, 2**32 + 5), 2**32 + 1000]
    assert admit(sequence, true, 1 << 32) == true
    assert sequence.lost == 995


def test_a_counter_beyond_its_declared_modulo_is_taken_modulo() -> None:
    sequence = Sequence(128)
    _, index = sequence.admit(rows([0, 1, 2]), np.array([127, 200, 201], np.uint8), None)
    assert np.diff(index).tolist() == [(200 - 127) % 128, 1]


def test_without_a_counter_frames_are_counted() -> None:
    sequence = Sequence(None)
    for begin in (0, 0, 7):
        keep, index = sequence.admit(rows([1] * begin), None, 1.0)
        assert keep is None and index.tolist() == list(range(begin))
    assert sequence.admit(rows([1]), None, None)[1].tolist() == [7]
    assert (sequence.lost, sequence.duplicates) == (0, 0)


@given(
    first=st.integers(0, 2**40),
    count=st.integers(0, 300),
    counter=st.sampled_from([(128, 1), (256, 16), (2, 1), (1 << 20, 4)]),
)
def test_counter_values(first: int, count: int, counter: tuple[int, int]) -> None:
    modulo, step = counter
    expected = [k * step % modulo for k in range(first, first + count)]
    assert counter_values(first, count, modulo, step).tolist() == expected


def test_losses_add_and_subtract() -> None:
    one = Losses(frames=3, lost=2, bad_status=1)
    two = Losses(frames=4, duplicates=5, skipped_bytes=6, resyncs=7, bad_checksum=8)
    assert asdict(one + two) == {
        "frames": 7, "lost": 2, "duplicates": 5, "bad_checksum": 8, "skipped_bytes": 6, "resyncs": 7, "bad_status": 1,
    }  # fmt: skip
    assert one + two - two == one
