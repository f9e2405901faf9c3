"""The truth about faults: one record for every thing that was made to go wrong, and the sums of them.

faults.jsonl holds one JSON object a line:
    t_s: bench time; of frames the time at which the first of them was sent.
    instrument: chamber, rate_table, or the serial number of a DUT. fault: its name. number: its place in the bench
    file, from 0, for there may be two of a name.
    state: 'begins' or 'ends', of faults that last, and 'begins' of those that come once by place; absent for what
    happens.
    frame, frames: number of the first frame concerned, counted from power-on and never wrapping, and how many follow
    each other. bytes, bits: replies and frames damaged: how many bytes, which bits.
    lost, duplicates, bad_checksum, skipped_bytes, resyncs: by how much a receiver that counts rightly counts higher.
`fault: discard` is none: from `frame` on so many frames were thrown away unread by the host, and never made; the last
one, of no frames, is where the host stopped.
Frames that follow each other are one record, however many reads they came in.
"""

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO

Record = dict[str, Any]

FILE = "faults.jsonl"
DISCARD = "discard"
# What of two records is summed when they become one.
COUNTS = ("frames", "lost", "duplicates", "bad_checksum", "skipped_bytes", "resyncs")


def begun(folders: Iterable[Path]) -> dict[tuple[int, str, str], float]:
    """When each fault first began by the logs of these folders, by number, instrument and name.

    A folder may have no log, and a log of a killed process a torn last line.
    """
    first_s: dict[tuple[int, str, str], float] = {}
    for path in (folder / FILE for folder in folders):
        for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
            try:
                record = json.loads(line)
            except ValueError:
                continue
            if record.get("state") == "begins":
                key = record["number"], record["instrument"], record["fault"]
                first_s[key] = min(record["t_s"], first_s.get(key, record["t_s"]))
    return first_s


class FaultLog:
    """Keeps the sums, and writes the records to a folder if there is one."""

    def __init__(self, folder: Path | None = None) -> None:
        """Raises OSError if the folder cannot be written."""
        self.totals: dict[tuple[str, str], Counter[str]] = {}
        self._open: dict[tuple[str, int], Record] = {}
        self._file: TextIO | None = None
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            # Line by line, so that what a killed process did is known.
            self._file = (folder / FILE).open("w", encoding="utf-8", newline="\n", buffering=1)

    def add(self, t_s: float, instrument: str, fault: str, number: int, **about: Any) -> None:
        """Log what happened at an instant."""
        record = {"t_s": round(t_s, 9), "instrument": instrument, "fault": fault, "number": number, **about}
        totals = self.totals.setdefault((instrument, fault), Counter())
        totals["events"] += 1
        totals.update({name: about[name] for name in COUNTS if name in about})
        self._write(record)

    def add_frames(self, t_s: float, instrument: str, fault: str, number: int, frame: int, **counts: int) -> None:
        """Log frames from `frame` on; those that continue the record before become part of it."""
        key = (instrument, number)
        before = self._open.get(key)
        if before and before["frame"] + before["frames"] == frame:
            for name in COUNTS:
                if counts.get(name):
                    before[name] = before.get(name, 0) + counts[name]
            return
        self._close(key)
        self._open[key] = {"t_s": t_s, "fault": fault, "frame": frame} | {k: v for k, v in counts.items() if v}

    def end_run(self, instrument: str) -> None:
        """What comes next does not continue what came before."""
        for key in [key for key in self._open if key[0] == instrument]:
            self._close(key)

    def _close(self, key: tuple[str, int]) -> None:
        record = self._open.pop(key, None)
        if record is not None:
            t_s, fault = record.pop("t_s"), record.pop("fault")
            self.add(t_s, key[0], fault, key[1], **record)

    def _write(self, record: Record) -> None:
        if self._file is not None and not self._file.closed:
            self._file.write(json.dumps(record) + "\n")

    def close(self) -> None:
        """Write what is left; closing twice is harmless."""
        for key in list(self._open):
            self._close(key)
        if self._file is not None:
            self._file.close()
