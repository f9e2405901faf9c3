"""CAN messages to batches: values against cantools, losses against what was taken out."""

from importlib import resources
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.codecs.batch import FrameBatch
from drivers.codecs.can_frames import CanDecoder
from drivers.codecs.can_spec import CanSpec
from drivers.codecs.counters import Losses
from drivers.codecs.dbc import EXTENDED

DBC = resources.files("drivers").joinpath("gyros", "frames", "fog_gyro.dbc").read_text()
ORACLE = cantools.database.load_string(DBC, "dbc").get_message_by_name("GyroFrame")
SPEC = CanSpec.from_settings({})


def messages(rows: list[bytes], number: int = 0x1A0) -> tuple[Any, Any, Any]:
    payload = np.frombuffer(b"".join(row.ljust(8, b"\0") for row in rows), np.uint8).reshape(-1, 8)
    return np.full(len(rows), number, np.uint32), payload, np.array([len(row) for row in rows], np.uint8)


def frames(numbers: list[int]) -> list[bytes]:
    values = ({"rate": float(n), "temperature": n % 80, "counter": n % 256, "status": n % 7 == 0} for n in numbers)
    return [ORACLE.encode(one, strict=False) for one in values]


def test_values_are_those_of_cantools() -> None:
    rows = [np.random.default_rng(n).bytes(8) for n in range(200)]
    expected = [ORACLE.decode(row, decode_choices=False) for row in rows]
    batch = CanDecoder(SPEC, 100.0).feed(*messages(rows))
    assert np.array_equal(batch.rate_dps, [float(one["rate"]) for one in expected], equal_nan=True)
    assert batch.temperature_degc == pytest.approx([float(one["temperature"]) for one in expected], abs=1e-9)
    assert batch.columns["counter"].tolist() == [one["counter"] for one in expected]
    finite = np.isfinite(batch.rate_dps)
    assert batch.good.tolist() == [one["status"] == 0 and ok for one, ok in zip(expected, finite, strict=True)]
    kinds = {name: column.dtype.str for name, column in batch.columns.items()}
    assert kinds == {"rate": "<f4", "temperature": "<i2", "counter": "|u1", "status": "|u1"}


def test_encoding_is_that_of_cantools() -> None:
    numbers = np.arange(300)
    columns: dict[str, Any] = {
        "rate": numbers.astype(np.float32),
        "temperature": (numbers % 80 * 100).astype(np.int16),
        "counter": numbers % 256,
        "status": (numbers % 7 == 0).astype(np.uint8),
    }
    assert SPEC.encode(columns, 300).tobytes() == b"".join(frames(numbers.tolist()))
    columns["status"] = 0
    rows = SPEC.encode(columns, 300)
    assert all(ORACLE.decode(row.tobytes())["status"] == 0 for row in rows)


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.integers(0, 200) | st.just(1), max_size=40),
    cuts=st.lists(st.integers(0, 41), max_size=4),
)
def test_losses_and_repetitions_in_pieces_of_any_size(steps: list[int], cuts: list[int]) -> None:
    numbers = np.cumsum([7, *steps]).tolist()
    rows = frames(numbers)
    decoder = CanDecoder(SPEC, 100.0)
    places = sorted(cuts)
    pieces = zip([0, *places], [*places, len(rows)], strict=True)
    batch = FrameBatch.concat([decoder.feed(*messages(rows[a:b])) for a, b in pieces])
    distinct = sorted(set(numbers))
    assert batch.index.tolist() == distinct
    assert batch.rate_dps.tolist() == distinct
    assert decoder.losses == Losses(
        frames=len(distinct),
        lost=distinct[-1] + 1 - distinct[0] - len(distinct),
        duplicates=len(numbers) - len(distinct),
        bad_status=sum(n % 7 == 0 for n in distinct),
    )


def test_other_identifiers_are_passed_over_and_short_messages_counted() -> None:
    decoder = CanDecoder(SPEC, 100.0)
    mine, others = messages(frames([1, 2, 3, 5])), messages(frames([9, 10]), 0x1A1)
    extended = messages(frames([11]), 0x1A0 | EXTENDED)
    short = messages([frames([4])[0][:7]])
    ids, payload, lengths = (
        np.concatenate([mine[part][:3], others[part], extended[part], short[part], mine[part][3:]]) for part in range(3)
    )
    batch = decoder.feed(ids, payload, lengths)
    assert batch.index.tolist() == [1, 2, 3, 5]
    assert decoder.losses == Losses(frames=4, lost=1, skipped_bytes=7)


def test_nothing_received() -> None:
    decoder = CanDecoder(SPEC, 100.0)
    batch = decoder.feed(*messages([]), elapsed_s=1.0)
    assert len(batch) == 0 and batch.columns["rate"].dtype == np.float32
    assert decoder.losses == Losses()


def test_an_outage_longer_than_the_counter_and_a_reset() -> None:
    decoder = CanDecoder(SPEC, 100.0)
    decoder.feed(*messages(frames([0, 1])), elapsed_s=0.02)
    assert decoder.feed(*messages(frames([902, 903])), elapsed_s=9.02).index.tolist() == [902, 903]
    assert decoder.losses.lost == 900
    decoder.reset()
    assert decoder.feed(*messages(frames([1500])), elapsed_s=0.01).index[0] % 256 == 1500 % 256
    assert decoder.losses.lost == 900
