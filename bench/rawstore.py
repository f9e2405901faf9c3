"""Raw frames and samples on disk: one Parquet file per acquisition and DUT, written beside the measurement.

Sampling never waits for the disk: a writer thread with a bounded queue writes `.tmp`, syncs, renames. Columns are kept
as they came on the wire (counts or float32) with the scale in the file's metadata.
"""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchFailure
from bench.runfolder import sync_folder

QUEUE_LENGTH = 16

# Noise in float32 compresses byte plane by byte plane; counters and indices are differences of one.
_BYTE_PLANES = (np.dtype("f4"), np.dtype("f8"))


@dataclass(frozen=True)
class RawFile:
    """The columns of one acquisition of one DUT, and what is needed to read them later."""

    name: str
    columns: Mapping[str, NDArray[Any]]
    metadata: Mapping[str, Any]


class RawStore:
    """Writer thread for `RawFile`s under one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._queue: queue.Queue[RawFile | None] = queue.Queue(QUEUE_LENGTH)
        self._error: Exception | None = None
        self.deepest = 0
        self._thread = threading.Thread(target=self._write_all, name="raw-store", daemon=True)
        self._thread.start()

    def put(self, raw: RawFile) -> None:
        """Hand over one file. Raises BenchFailure if an earlier one could not be written."""
        self._raise_if_failed()
        self._queue.put(raw)
        self.deepest = max(self.deepest, self._queue.qsize())

    def close(self) -> None:
        """Wait for everything to be on disk. Raises BenchFailure if something is not."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self._raise_if_failed()

    def _raise_if_failed(self) -> None:
        if self._error is not None:
            raise BenchFailure(
                f"{self._folder}: raw samples could not be written: {self._error}. Free space on the disk or check its "
                "permissions; finished points are safe in the journal."
            ) from self._error

    def _write_all(self) -> None:
        while (raw := self._queue.get()) is not None:
            if self._error is None:
                try:
                    write_parquet(self._folder / raw.name, raw.columns, raw.metadata)
                except Exception as error:
                    # Surfaces at the next put or at close; the queue is drained so that nobody waits for it.
                    self._error = error


def write_parquet(path: Path, columns: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> None:
    """Write one Parquet file durably. Raises OSError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    encodings = {name: _encoding(values.dtype) for name, values in columns.items()}
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    table = table.replace_schema_metadata({b"fogbench": json.dumps(dict(metadata), sort_keys=True).encode()})
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("wb") as file:
        pq.write_table(
            table,
            file,
            compression="zstd",
            compression_level=1,
            use_dictionary=[name for name, encoding in encodings.items() if encoding is None],
            column_encoding={name: encoding for name, encoding in encodings.items() if encoding},
            write_statistics=False,
        )
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    sync_folder(path.parent)


def _encoding(dtype: np.dtype[Any]) -> str | None:
    if dtype in _BYTE_PLANES:
        return "BYTE_STREAM_SPLIT"
    return "DELTA_BINARY_PACKED" if dtype.kind in "iu" else None
