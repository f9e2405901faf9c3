"""Raw frames and samples on disk: one Parquet file per acquisition and DUT, written beside the measurement.

Frames never wait for the disk: writer threads write `.tmp`, sync, rename; a point is done when they are. Columns are
kept as they came on the wire (counts or float32) with the scale in the file's metadata.

Two things make damage visible later: a checksum on every page, which any Parquet reader can check, and, because a
footer has none, a digest of the whole file in its metadata: that of the file with 64 zeros in the digest's place.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchFailure, FogbenchError
from bench.runfolder import sync_folder
from drivers.codecs.batch import Meaning, Quantity

QUEUE_LENGTH = 16
WRITERS = 2
# How often somebody who waits for the disk looks whether to go on waiting.
LOOK_S = 0.1

# Keys of a file's metadata: what the columns are (JSON), and the digest of the file, SHA-256 in hexadecimal digits.
ABOUT, DIGEST = b"fogbench", b"fogbench.sha256"
# Between key and value in the footer: field 2 of KeyValue, a string (0x18) of 64 bytes (Thrift compact protocol).
_BEFORE_VALUE = b"\x18\x40"
_NO_DIGEST = b"0" * 64

# Noise in float32 compresses byte plane by byte plane; counters and indices are differences of one.
_BYTE_PLANES = (np.dtype("f4"), np.dtype("f8"))


@dataclass(frozen=True)
class RawFile:
    """The columns of one acquisition of one DUT, and what is needed to read them later."""

    name: str
    columns: Mapping[str, NDArray[Any]]
    metadata: Mapping[str, Any]


class RawFileDamaged(FogbenchError):
    """A raw file that is not what was written; the message is the reason."""


class RawStore:
    """Writer threads for `RawFile`s under one folder, one for each core a small bench PC has.

    `look` is called while somebody waits for the disk, and may raise to end that. `deepest` is how many files ever
    waited at once, of QUEUE_LENGTH.
    """

    def __init__(self, folder: Path, look: Callable[[], None] = lambda: None) -> None:
        self._folder, self._look = folder, look
        folder.mkdir(parents=True, exist_ok=True)
        self._queue: queue.Queue[RawFile | None] = queue.Queue(QUEUE_LENGTH)
        self._error: Exception | None = None
        self.deepest = 0
        self._threads = [
            threading.Thread(target=self._write_all, name=f"raw-store-{number}", daemon=True)
            for number in range(WRITERS)
        ]
        for thread in self._threads:
            thread.start()

    def put(self, raw: RawFile) -> None:
        """Hand over one file. Raises BenchFailure if an earlier one could not be written."""
        self._raise_if_failed()
        self._enter(raw)
        self.deepest = max(self.deepest, self._queue.qsize())

    def _enter(self, raw: RawFile | None) -> None:
        while True:
            with contextlib.suppress(queue.Full):
                self._queue.put(raw, timeout=LOOK_S)
                return
            self._look()

    def flush(self) -> None:
        """Wait for everything to be on disk: a point is finished when its raw files are. Raises BenchFailure."""
        with self._queue.all_tasks_done:
            while self._queue.unfinished_tasks:
                self._queue.all_tasks_done.wait(LOOK_S)
                self._look()
        self._raise_if_failed()

    def close(self) -> None:
        """Write what is left and end the threads. Raises BenchFailure if something is not on disk."""
        for thread in self._threads:
            if thread.is_alive():
                self._enter(None)
        for thread in self._threads:
            while thread.is_alive():
                thread.join(LOOK_S)
                self._look()
        self._raise_if_failed()

    def _raise_if_failed(self) -> None:
        if self._error is not None:
            raise BenchFailure(
                f"{self._folder}: raw samples could not be written: {self._error}. Free space on the disk or check its "
                "permissions; finished points are safe in the journal."
            ) from self._error

    def _write_all(self) -> None:
        while True:
            raw = self._queue.get()
            try:
                if raw is not None and self._error is None:
                    write_parquet(self._folder / raw.name, raw.columns, raw.metadata)
            except Exception as error:
                # Surfaces at the next put, flush or close; the queue is drained so that nobody waits for it.
                self._error = error
            finally:
                self._queue.task_done()
            if raw is None:
                return


def write_parquet(path: Path, columns: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> None:
    """Write one Parquet file durably. Raises OSError."""
    data = _parquet(columns, json.dumps(dict(metadata), sort_keys=True).encode())
    place = _digest_place(data)
    data[place : place + len(_NO_DIGEST)] = hashlib.sha256(data).hexdigest().encode()
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    sync_folder(path.parent)


def meaning_as_metadata(meaning: Meaning) -> dict[str, Any]:
    """What frames mean, as metadata of a raw file; `meaning_of` reads it back."""
    return {
        "quantities": {name: asdict(law) for name, law in meaning.quantities.items()},
        "status": {"good_mask": meaning.good_mask, "good_value": meaning.good_value},
    }


def meaning_of(metadata: Mapping[str, Any]) -> Meaning:
    """What the frames of a raw file mean, of its metadata. Raises KeyError or TypeError."""
    laws = {name: Quantity(**law) for name, law in metadata["quantities"].items()}
    return Meaning.of(laws, metadata["status"]["good_mask"], metadata["status"]["good_value"])


def _parquet(columns: Mapping[str, NDArray[Any]], about: bytes) -> bytearray:
    """The bytes of a file, with zeros for its digest."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    encodings = {name: _encoding(values.dtype) for name, values in columns.items()}
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    buffer = io.BytesIO()
    pq.write_table(
        table.replace_schema_metadata({ABOUT: about, DIGEST: _NO_DIGEST}),
        buffer,
        compression="zstd",
        compression_level=1,
        use_dictionary=[name for name, encoding in encodings.items() if encoding is None],
        column_encoding={name: encoding for name, encoding in encodings.items() if encoding},
        write_statistics=False,
        write_page_checksum=True,
    )
    return bytearray(buffer.getbuffer())


def _digest_place(data: bytes | bytearray) -> int:
    """Where the digest is in a file; RawFileDamaged if it is nowhere."""
    key = data.rfind(DIGEST + _BEFORE_VALUE)
    if key < 0:
        raise RawFileDamaged("it has no digest of itself: it was changed, or not written by this fogbench")
    return key + len(DIGEST + _BEFORE_VALUE)


def read_parquet(path: Path) -> RawFile:
    """Read a file of `write_parquet` if it is to the last bit what was written. Raises RawFileDamaged, OSError."""
    import pyarrow.parquet as pq

    if not path.is_file():
        raise RawFileDamaged("it is not there, or not a regular file")
    data = bytearray(path.read_bytes())
    place = slice(_digest_place(data), _digest_place(data) + len(_NO_DIGEST))
    stored, data[place] = bytes(data[place]), _NO_DIGEST
    if stored != hashlib.sha256(data).hexdigest().encode():
        raise RawFileDamaged("it does not match the digest in it: it was changed after it was written")
    with pq.ParquetFile(io.BytesIO(data), page_checksum_verification=True) as file:
        table = file.read(use_threads=False)
    columns = {name: table[name].to_numpy() for name in table.column_names}
    return RawFile(path.name, columns, json.loads(table.schema.metadata[ABOUT]))


def _encoding(dtype: np.dtype[Any]) -> str | None:
    if dtype in _BYTE_PLANES:
        return "BYTE_STREAM_SPLIT"
    return "DELTA_BINARY_PACKED" if dtype.kind in "iu" else None
