"""Time series: what a record keeps of every DUT while its steps run, in parts on disk, and the fold that joins them.

A row is the mean of the frames of one interval; it is assigned by frame number, so that arrival jitter moves nothing
and a lost frame leaves its place open. Rows go to disk in parts while the record is under way; the journal names a
record only when its last part is there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import FogbenchError
from bench.journal import Entry
from bench.rawstore import read_parquet
from bench.reduction import intervals_of
from bench.replacement import begins_anew, joined
from bench.runfolder import write_atomic
from drivers.codecs.batch import FrameBatch

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

FOLDER = "series"
# Frames of a part: some minutes at usual data rates, a few MB in memory.
PART_FRAMES = 120_000


class SeriesIncomplete(FogbenchError):
    """Parts of a record are missing or are not those the journal names."""


def part_name(record: int, dut: str, part: int, kept: str) -> str:
    """File of one part in raw/; `kept` is 'frames' or 'samples'.

    >>> part_name(1, "FOG-A01", 3, "samples")
    'r00001-FOG-A01-00003.samples.parquet'
    """
    return f"r{record:05d}-{dut}-{part:05d}.{kept}.parquet"


def rows_of(frames: FrameBatch, offset: NDArray[np.int64], frames_per_row: float, first: int, count: int) -> Columns:
    """Rows first … first + count - 1 of a series: means of good frames by interval, NaN where there is none.

    offset: int64[n], frame number minus that of the record's first frame. Returns row int64, rate_dps,
    temperature_degc, the channels (float64), and frames int64, how many were used; each of shape (count,).
    """
    interval = intervals_of(offset, frames_per_row) - first
    use = frames.good & (interval >= 0) & (interval < count)
    interval = interval[use]
    used = np.bincount(interval, minlength=count).astype(np.int64)
    columns: Columns = {"row": np.arange(first, first + count, dtype=np.int64)}
    with np.errstate(invalid="ignore", divide="ignore"):
        for name, values in quantities_of(frames).items():
            columns[name] = np.bincount(interval, values[use], minlength=count) / used
    columns["frames"] = used
    return columns


def quantities_of(frames: FrameBatch) -> dict[str, Floats]:
    """The values a frame carries, by unit-suffixed name; the temperature is left out if there is none."""
    values = {"rate_dps": frames.rate_dps}
    if len(frames) == 0 or np.isfinite(frames.temperature_degc).any():
        values["temperature_degc"] = frames.temperature_degc
    return values | frames.channels


@dataclass
class Growing:
    """The series of one DUT while it is recorded: hands out a part whenever enough has come in."""

    frames_per_row: float
    part_frames: int = PART_FRAMES
    start: int | None = None
    rows: int = 0
    received: int = 0
    parts: int = 0
    _waiting: list[FrameBatch] = field(default_factory=list)
    _frames_waiting: int = 0

    def take(self, batch: FrameBatch) -> tuple[FrameBatch, Columns] | None:
        """Add frames; the frames and rows of the next part once it is full."""
        if len(batch):
            if self.start is None:
                self.start = int(batch.index[0])
            self._waiting.append(batch)
            self._frames_waiting += len(batch)
            self.received += len(batch)
        return self._part(finished=False) if self._frames_waiting >= self.part_frames else None

    def finish(self, rows: int) -> tuple[FrameBatch, Columns] | None:
        """The last part: everything up to `rows` rows; None if nothing is left."""
        return self._part(finished=True, rows=rows)

    def _part(self, finished: bool, rows: int | None = None) -> tuple[FrameBatch, Columns] | None:
        frames = FrameBatch.concat(self._waiting)
        if self.start is None or not len(frames):
            return None
        offset = frames.index - self.start
        # The row of the newest frame may still grow, unless nothing comes after it.
        end = int((int(offset[-1]) + (1 if finished else 0) + 0.5) / self.frames_per_row)
        end = max(self.rows, min(end, rows) if rows is not None else end)
        cut = int(np.searchsorted(offset + 0.5, end * self.frames_per_row))
        whole, rest = frames.part(0, cut), frames.part(cut, len(frames))
        self._waiting = [] if finished else [rest]
        self._frames_waiting = 0 if finished else len(rest)
        if end == self.rows:
            return None
        columns = rows_of(whole, offset[:cut], self.frames_per_row, self.rows, end - self.rows)
        self.rows, self.parts = end, self.parts + 1
        return whole, columns


def finished_series(entries: Iterable[Entry]) -> list[dict[str, Any]]:
    """What the journal says of the records that were finished, in order; broken-off ones are not among them."""
    parts: list[list[dict[str, Any]]] = [[]]
    pending: list[dict[str, Any]] = []
    for entry in entries:
        if entry["kind"] == "series":
            pending.append(entry["about"])
        elif entry["kind"] == "done":
            parts[-1] += pending
            pending = []
        elif entry["kind"] in ("step", "resumed"):
            pending = []
            parts += [[]] if begins_anew(entry) else []
    return joined(parts, "record")


def read_parts(folder: Path, about: Mapping[str, Any]) -> Columns:
    """The rows of one finished series from its parts, with their times `t_s`.

    Raises SeriesIncomplete, RawFileDamaged or OSError.
    """
    blocks: list[Columns] = []
    for part in range(1, about["parts"] + 1):
        name = part_name(about["record"], about["dut"], part, "samples")
        raw = read_parquet(folder / "raw" / name)
        if raw.metadata.get("started_at_s") != about["started_at_s"]:
            raise SeriesIncomplete(f"raw/{name} is of another attempt than the journal's. Restore it from a copy.")
        blocks.append(dict(raw.columns))
    names = list(blocks[0]) if blocks else ["row", "rate_dps", "frames"]
    joined = {name: np.concatenate([block[name] for block in blocks]) if blocks else np.empty(0) for name in names}
    row = np.asarray(joined.pop("row"), dtype=np.int64)
    if not np.array_equal(row, np.arange(about["rows"])):
        raise SeriesIncomplete(f"record '{about['label']}' of {about['dut']} has rows missing between its parts.")
    return {"t_s": about["started_at_s"] + (row + 0.5) * about["every_s"], **joined}


def series_file(about: Mapping[str, Any]) -> str:
    """Where a joined series is in the run folder.

    >>> series_file({"label": "cycle-1", "dut": "FOG-A01"})
    'series/cycle-1-FOG-A01.parquet'
    """
    return f"{FOLDER}/{about['label']}-{about['dut']}.parquet"


def series_table(folder: Path, about: Mapping[str, Any]) -> pd.DataFrame:
    """One finished series as a table: t_s (middle of each row), rate_dps, temperatures and channels, frames."""
    import pandas as pd

    return pd.DataFrame(read_parts(folder, about))


def write_series(folder: Path, entries: Iterable[Entry], recorded: Path) -> list[dict[str, Any]]:
    """Join the parts of every finished series in run folder `recorded` into one file each under `folder`.

    Returns what the journal says of them.
    """
    import io

    finished = finished_series(entries)
    if finished:
        (folder / FOLDER).mkdir(exist_ok=True)
    for about in finished:
        buffer = io.BytesIO()
        series_table(recorded, about).to_parquet(buffer, index=False, compression="zstd")
        write_atomic(folder / series_file(about), buffer.getvalue())
    return finished
