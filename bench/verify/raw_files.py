"""Raw files against the journal: each whole and in its place, and the point made again from what is in it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.points import digits_of
from bench.rawstore import RawFile, meaning_of, read_parquet
from bench.reduction import Samples, held_frames, point_statistics, spikes, to_samples
from bench.verify.findings import Check, Finding, Tell, attempt, collect
from bench.verify.record import Record
from drivers.codecs.batch import FrameBatch

# Parts of records are looked at by bench/verify/series.py.
PART = re.compile(r"r(\d{5,9})-(.+)-(\d{5,9})\.(frames|samples)\.parquet")
NAME = re.compile(r"p(\d{5,9})-(.+)\.parquet")
# Sums in another order (another processor or numpy) differ in their last bits, which may move the last digit kept.
LAST_DIGITS = 1.01
PROGRESS_EVERY = 50

Row = dict[str, Any]
Points = dict[tuple[int, str], Row]


def check_raw(record: Record, tell: Tell) -> list[Check]:
    """Every point has its raw file and every raw file its point; each is whole; the points are those of the frames."""
    mode = record.head.raw if record.head else None
    points: Points = {(int(row["point"]), str(row["dut"])): row for row in _rows(record)}
    folder = record.folder / "raw"
    files: list[Finding] = []
    again: list[Finding] = []
    read = 0
    present = sorted(path.name for path in folder.iterdir() if not PART.fullmatch(path.name)) if folder.is_dir() else []
    if mode in ("frames", "samples") or (mode is None and present):
        files += _missing(record, points, set(present))
    for number, name in enumerate(present, start=1):
        if number % PROGRESS_EVERY == 0:
            tell(f"raw files: {number} of {len(present)}")
        row, homeless = _row_of(record, name, points)
        files += homeless
        if row is not None:
            raw = attempt(files, f"raw/{name}", read_parquet, folder / name)
            if raw is not None and _of_a_later_try(record, raw, row):
                text = "of an acquisition that was to replace this failed point and was broken off"
                files.append(Finding(text, f"raw/{name}", int(row["point"]), str(row["dut"]), severity="note"))
            elif raw is not None:
                read += 1
                collect(files, f"raw/{name}", _sane, raw, row, mode)
                collect(again, f"raw/{name}", _made_again, raw, row)
    kept = {"frames": "all frames", "samples": "samples", "none": "nothing", None: "unknown"}[mode]
    return [
        Check("raw files", f"{len(present)} files, {len(points)} points; kept: {kept}", files),
        Check("points from raw", f"{read} files reduced to points again", again),
    ]


def _rows(record: Record) -> list[Row]:
    return [{str(key): value for key, value in row.items()} for row in record.points.to_dict("records")]


def _missing(record: Record, points: Points, present: set[str]) -> Iterator[Finding]:
    """Points with frames and without a raw file."""
    if record.damaged:
        return
    for (point, dut), row in points.items():
        name = f"p{point:05d}-{dut}.parquet"
        if row["frames"] > 0 and name not in present:
            yield Finding("is missing: its point is in the journal", f"raw/{name}", point, dut)


def _row_of(record: Record, name: str, points: Points) -> tuple[Row | None, list[Finding]]:
    """The point a file is of; or why there is none."""
    label = f"raw/{name}"
    if name.endswith(".tmp"):
        return None, [Finding("left by a write that was broken off; it may be deleted", label, severity="note")]
    match = NAME.fullmatch(name)
    key = (int(match[1]), match[2]) if match else None
    if key is not None and key in points:
        return points[key], []
    if key and record.damaged:
        return None, [Finding("no point to hold it against: the journal is damaged", label, *key, severity="note")]
    dropped = any(e["kind"] == "point" and (e["row"]["point"], e["row"]["dut"]) == key for e in record.entries)
    if key and (dropped or record.state != "ended"):
        return None, [Finding("of an acquisition that was broken off", label, *key, severity="note")]
    return None, [Finding("belongs to no point of the journal", label, *(key or ()))]


def _of_a_later_try(record: Record, raw: RawFile, row: Row) -> bool:
    """Whether a failed point was begun again and the run ended before that was done: the file is there, no row."""
    if row["verdict"] != "fail" or raw.metadata.get("started_at_s") == row["started_at_s"]:
        return False
    done: set[int] = set()
    for entry in reversed(record.entries):
        if entry["kind"] == "done":
            done.add(entry["step"])
        elif entry["kind"] == "step" and entry["verb"] == "acquire" and entry["step"] not in done:
            return bool(entry["t_s"] > row["ended_at_s"])
    return False


def _sane(raw: RawFile, row: Row, mode: str | None) -> Iterator[Finding]:
    """Whether metadata and columns are those of this point."""
    about, name = raw.metadata, f"raw/{raw.name}"
    point, dut = int(row["point"]), str(row["dut"])

    def differs(figure: str, expected: Any, found: Any) -> Finding:
        return Finding(f"its {figure} is another", name, point, dut, figure, expected, found)

    for figure, expected in (("point", point), ("dut", dut)):
        if about.get(figure) != expected:
            yield differs(figure, expected, about.get(figure))
    if not _same(about.get("started_at_s"), row["started_at_s"], "started_at_s"):
        yield differs("started_at_s", row["started_at_s"], about.get("started_at_s"))
    for figure in ("every_s", "data_rate_hz", "samples"):
        value = about.get(figure)
        if not isinstance(value, int | float) or not 0 < value < math.inf:
            yield differs(figure, "a number above 0", value)
    kept = "frames" if "index" in raw.columns else "samples"
    if mode is not None and kept != mode:
        yield differs("columns", mode, kept)
    if kept == "frames":
        index = raw.columns["index"]
        if len(index) != row["frames"]:
            yield differs("frames", int(row["frames"]), len(index))
        if index.dtype != np.int64 or (np.diff(index) < 1).any():
            yield Finding("its frame numbers do not rise", name, point, dut)


def _made_again(raw: RawFile, row: Row) -> Iterator[Finding]:
    """Figures of the journal that are not those of the frames."""
    about = raw.metadata
    samples, found = _samples(raw)
    statistics = point_statistics(samples, about["every_s"])
    for figure in (
        "rate_mean_dps",
        "rate_std_dps",
        "rate_mean_u_dps",
        "dut_temperature_degc",
        "dut_temperature_slope_degc_min",
        "dut_temperature_slope_u_degc_min",
    ):
        found[figure] = None if statistics is None else getattr(statistics, figure)
    found["samples"] = statistics.samples if statistics else 0
    found["outliers"] = statistics.outliers if statistics else 0
    for figure, value in found.items():
        if not _same(value, row[figure], figure):
            text = f"{figure} of point {row['point']}, {row['dut']}, is not what its {_kept(raw)} give"
            yield Finding(text, f"raw/{raw.name}", int(row["point"]), row["dut"], figure, _plain(value), row[figure])


def _kept(raw: RawFile) -> str:
    return "frames" if "index" in raw.columns else "samples"


def _samples(raw: RawFile) -> tuple[Samples, Row]:
    """The samples of a raw file, and what else of its point it tells."""
    about, columns = raw.metadata, dict(raw.columns)
    if _kept(raw) == "samples":
        return Samples(**columns), {}
    index = columns.pop("index")
    frames = meaning_of(about).batch(columns, index)
    per_sample = about["every_s"] * about["data_rate_hz"]
    planned = math.ceil(about["samples"] * per_sample - 1e-9)
    spiked = spikes(frames.rate_dps, frames.good)
    good = frames.good if spiked is None else frames.good & ~spiked
    return _reduced(frames, good, per_sample, about), {
        "frames": len(index),
        "frames_lost": planned - len(index),
        "frames_held": held_frames(frames.columns["rate"]),
        "spikes": int(np.count_nonzero(frames.good & ~good)),
    }


def _reduced(frames: FrameBatch, good: NDArray[np.bool_], per_sample: float, about: Any) -> Samples:
    return to_samples(
        frames.index - frames.index[0],
        frames.rate_dps,
        frames.temperature_degc,
        good,
        per_sample,
        about["samples"],
        newest=about["take"] == "newest",
    )


def _same(value: Any, journaled: Any, figure: str) -> bool:
    """Whether a figure is the journal's, to the digits the journal keeps; not measured is not a number there."""
    missing = journaled is None or journaled != journaled
    if value is None or not math.isfinite(value):
        return missing
    if missing:
        return False
    if isinstance(value, int):
        return bool(value == journaled)
    return bool(abs(value - journaled) <= LAST_DIGITS * 10.0 ** -digits_of(figure))


def _plain(value: Any) -> float | int | None:
    return value if value is None or isinstance(value, int) else float(value)
