"""Raw files read back by pyarrow alone, and a disk that gives up."""

import hashlib
import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench import rawstore
from bench.errors import BenchFailure, ExitCode
from bench.rawstore import QUEUE_LENGTH, RawFile, RawFileDamaged, RawStore, read_parquet, write_parquet

RNG = np.random.default_rng(0)
COLUMNS: dict[str, np.ndarray[Any, Any]] = {
    "index": np.arange(10_000, dtype=np.int64) + 2**40,
    "rate": RNG.normal(size=10_000).astype(np.float32),
    "fine": RNG.normal(size=10_000),
    "counts": RNG.integers(-(2**31), 2**31, 10_000, dtype=np.int32),
    "i16": RNG.integers(-(2**15), 2**15, 10_000, dtype=np.int16),
    "i8": RNG.integers(-128, 128, 10_000, dtype=np.int8),
    "u64": RNG.integers(0, 2**64, 10_000, dtype=np.uint64),
    "u32": RNG.integers(0, 2**32, 10_000, dtype=np.uint32),
    "temperature": RNG.integers(0, 2**16, 10_000, dtype=np.uint16),
    "counter": (np.arange(10_000) % 128).astype(np.uint8),
    "good": RNG.random(10_000) < 0.5,
}
METADATA = {"point": 7, "dut": "FOG-Ä1", "every_s": 0.6, "quantities": {"rate": {"scale": 1e-3, "offset": 0.0}}}


def test_every_column_comes_back_as_it_was_to_the_last_bit(tmp_path: Path) -> None:
    path = tmp_path / "p.parquet"
    write_parquet(path, COLUMNS, METADATA)
    table = pq.read_table(path)
    assert table.column_names == list(COLUMNS)
    for name, values in COLUMNS.items():
        read = table[name].to_numpy()
        assert read.dtype == values.dtype, name
        np.testing.assert_array_equal(read, values)
    assert json.loads(table.schema.metadata[b"fogbench"]) == METADATA
    assert [entry.name for entry in tmp_path.iterdir()] == ["p.parquet"]


def test_not_a_number_and_no_rows_are_kept(tmp_path: Path) -> None:
    write_parquet(tmp_path / "nan", {"x": np.array([np.nan, -np.inf, -0.0])}, {})
    assert pq.read_table(tmp_path / "nan")["x"].to_numpy().tobytes() == np.array([np.nan, -np.inf, -0.0]).tobytes()
    write_parquet(tmp_path / "none", {"x": np.empty(0, np.uint16)}, {})
    assert pq.read_table(tmp_path / "none").num_rows == 0


def test_a_stream_of_frames_takes_little_room(tmp_path: Path) -> None:
    """Index and counter are differences of one: next to nothing."""
    write_parquet(tmp_path / "frames", {name: COLUMNS[name] for name in ("index", "counter")}, {})
    assert (tmp_path / "frames").stat().st_size < 0.5 * 10_000


def test_the_same_data_are_the_same_bytes(tmp_path: Path) -> None:
    write_parquet(tmp_path / "a", COLUMNS, METADATA)
    write_parquet(tmp_path / "b", COLUMNS, dict(reversed(METADATA.items())))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_it_reads_its_own_files_to_the_last_bit_and_no_others(tmp_path: Path) -> None:
    path = tmp_path / "p.parquet"
    write_parquet(path, COLUMNS, METADATA)
    read = read_parquet(path)
    assert (read.name, read.metadata) == ("p.parquet", METADATA)
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(read.columns[name], values)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(RawFileDamaged, match="does not match the digest"):
        read_parquet(path)
    pq.write_table(pq.read_table(tmp_path / "p.parquet", columns=["index"]), tmp_path / "foreign")
    for name in ("foreign", "missing", "."):
        with pytest.raises(RawFileDamaged):
            read_parquet(tmp_path / name)


def test_the_digest_is_that_of_the_file_with_zeros_in_its_place(tmp_path: Path) -> None:
    """Told again without the reader: the digest as Parquet's own metadata has it."""
    path = tmp_path / "p.parquet"
    write_parquet(path, COLUMNS, METADATA)
    digest = pq.ParquetFile(path).metadata.metadata[b"fogbench.sha256"]
    data = path.read_bytes()
    assert data.count(digest) == 1
    assert hashlib.sha256(data.replace(digest, b"0" * 64)).hexdigest().encode() == digest


def test_any_reader_finds_a_damaged_page(tmp_path: Path) -> None:
    path = tmp_path / "p.parquet"
    write_parquet(path, {"rate": COLUMNS["rate"]}, {})
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(OSError, match="CRC"):
        pq.read_table(path, page_checksum_verification=True)


def raw(number: int) -> RawFile:
    return RawFile(f"p{number:05d}.parquet", {"x": np.full(10, number, np.int32)}, {"point": number})


def test_everything_put_is_on_disk_after_close(tmp_path: Path) -> None:
    store = RawStore(tmp_path / "deep" / "raw")
    for number in range(3 * QUEUE_LENGTH):
        store.put(raw(number))
    store.close()
    store.close()
    names = sorted(path.name for path in (tmp_path / "deep" / "raw").iterdir())
    assert names == [f"p{number:05d}.parquet" for number in range(3 * QUEUE_LENGTH)]
    assert pq.read_table(tmp_path / "deep/raw/p00007.parquet")["x"].to_pylist() == [7] * 10
    assert 0 <= store.deepest <= QUEUE_LENGTH


def test_a_full_disk_is_told_at_the_next_put_and_at_close(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = threading.Event()

    def full(*_: Any) -> None:
        tried.set()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(rawstore, "write_parquet", full)
    store = RawStore(tmp_path / "raw")
    store.put(raw(0))
    assert tried.wait(10)
    failures: list[BenchFailure] = []

    def put_more_than_the_queue_holds() -> None:
        try:
            for number in range(1, 5 * QUEUE_LENGTH):
                store.put(raw(number))
        except BenchFailure as failure:
            failures.append(failure)

    # In a thread, so that a writer that died and left the queue full fails the test and does not hang it.
    putting = threading.Thread(target=put_more_than_the_queue_holds, daemon=True)
    putting.start()
    putting.join(20)
    assert not putting.is_alive()
    (failure,) = failures
    message = str(failure)
    assert "No space left" in message
    assert str(tmp_path / "raw") in message
    assert "Free space" in message
    assert failure.exit_code == ExitCode.BENCH_FAILED
    with pytest.raises(BenchFailure, match="No space left"):
        store.close()


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pq, "write_table", failing)
    with pytest.raises(OSError, match="No space left"):
        write_parquet(tmp_path / "p.parquet", COLUMNS, {})
    assert not (tmp_path / "p.parquet").exists()
