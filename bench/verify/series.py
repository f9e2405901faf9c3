"""Records against the journal: every part whole and in its place, its rows made again from its frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bench.rawstore import RawFile, meaning_of, read_parquet
from bench.series import finished_series, part_name, quantities_of, rows_of, series_file, series_table
from bench.verify.findings import Check, Finding, Tell, attempt, collect
from bench.verify.raw_files import PART
from bench.verify.record import Record
from bench.verify.tables import cells, read_table

# Sums in another order differ in their last bits.
RELATIVE = 1e-12

About = dict[str, Any]


def check_series(record: Record, tell: Tell) -> list[Check]:
    """Parts and joined files of every finished record; nothing if the run has none."""
    folder, finished = record.folder / "raw", finished_series(record.entries)
    present = {path.name for path in folder.iterdir() if PART.fullmatch(path.name)} if folder.is_dir() else set()
    if not finished and not present:
        return []
    parts: list[Finding] = []
    joined: list[Finding] = []
    frames_too = record.head is not None and record.head.raw == "frames"
    for about in finished:
        tell(f"record {about['label']} of {about['dut']}")
        for part in range(1, about["parts"] + 1):
            present -= {part_name(about["record"], about["dut"], part, kept) for kept in ("frames", "samples")}
            collect(parts, "raw", _part, record, about, part, frames_too)
        if record.state == "ended":
            collect(joined, series_file(about), _joined, record, about)
    parts += [Finding("of a record that was broken off", f"raw/{name}", severity="note") for name in sorted(present)]
    summary = f"{len(finished)} series, {sum(about['parts'] for about in finished)} parts"
    return [Check("record parts", summary, parts), Check("series", "joined again from their parts", joined)]


def _part(record: Record, about: About, part: int, frames_too: bool) -> Iterator[Finding]:
    """What is wrong with one part: its rows, and with frames kept, whether they give these rows."""
    read: dict[str, RawFile] = {}
    for kept in ("samples", "frames") if frames_too else ("samples",):
        name = part_name(about["record"], about["dut"], part, kept)
        findings: list[Finding] = []
        raw = attempt(findings, f"raw/{name}", read_parquet, record.folder / "raw" / name)
        yield from findings
        if raw is not None:
            read[kept] = raw
            for figure in ("record", "dut", "label", "started_at_s", "every_s"):
                if raw.metadata.get(figure) != about[figure]:
                    found = raw.metadata.get(figure)
                    yield Finding(
                        f"its {figure} is another", f"raw/{name}", None, about["dut"], figure, about[figure], found
                    )
    if len(read) == 2:
        yield from _made_again(read["samples"], read["frames"], about)


def _made_again(samples: RawFile, frames: RawFile, about: About) -> Iterator[Finding]:
    columns = dict(frames.columns)
    index = columns.pop("index")
    batch = meaning_of(frames.metadata).batch(columns, index)
    first, count = int(samples.columns["row"][0]), len(samples.columns["row"])
    per_row = about["every_s"] * frames.metadata["data_rate_hz"]
    again = rows_of(batch, index - frames.metadata["first_index"], per_row, first, count)
    for name in (*quantities_of(batch), "frames"):
        if not np.allclose(again[name], samples.columns[name], rtol=RELATIVE, atol=0.0, equal_nan=True):
            yield Finding(f"its {name} is not what its frames give", f"raw/{samples.name}", None, about["dut"])


def _joined(record: Record, about: About) -> Iterator[Finding]:
    expected = series_table(record.folder, about)
    yield from cells(series_file(about), expected, read_table(record.folder / series_file(about), len(expected)))
