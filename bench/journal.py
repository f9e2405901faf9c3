"""The journal: append-only, checksummed line by line, the only truth about a run (law 6).

A line is `<crc32 in 8 hex digits> <JSON object>`; the object carries a consecutive number `n`, the bench time `t_s` and
a `kind`. The first record names the format. A commit reaches the disk before it returns. A line torn by a crash at the
end is dropped when the journal is read; damage anywhere else is refused, because what follows could be silently wrong.
"""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Any, Protocol

from bench.errors import FogbenchError

FORMAT = 1
Entry = dict[str, Any]


class JournalDamaged(FogbenchError):
    """The journal was changed after it was written; it is not read past the damage."""


class Log(Protocol):
    """Where the engine writes what it did."""

    def append(self, kind: str, t_s: float, **fields: Any) -> None:
        """Add a record; it may still be in memory."""
        ...

    def commit(self) -> None:
        """Make everything appended so far durable."""
        ...


class MemoryLog:
    """The log of a rehearsal: kept, never written."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def append(self, kind: str, t_s: float, **fields: Any) -> None:
        self.entries.append({"n": len(self.entries), "t_s": t_s, "kind": kind, **fields})

    def commit(self) -> None:
        """Nothing to make durable."""


class Journal:
    """Writer of a journal file, new or continued.

    A record reaches the system at once, so that a killed process loses none, and the disk with the next commit. What
    the system does not take is kept and tried again: appending never fails, a commit says so.
    """

    def __init__(self, file: FileIO, number: int) -> None:
        """file: open for writing, without a buffer."""
        self._file = file
        self._number = number
        self._pending = bytearray()

    @classmethod
    def create(cls, path: Path, head: Entry) -> Journal:
        """A new journal with its head record; `path` must not exist. Raises OSError."""
        journal = cls(path.open("xb", buffering=0), 0)
        journal.append("journal", 0.0, format=FORMAT, **head)
        journal.commit()
        return journal

    @classmethod
    def reopen(cls, path: Path) -> Journal:
        """Continue a journal behind its last whole record; a torn tail is cut off first, or it would swallow the next.

        Raises JournalDamaged or OSError.
        """
        entries = load_journal(path)
        whole = sum(len(line) + 1 for line in path.read_bytes().split(b"\n")[: len(entries)])
        file = path.open("r+b", buffering=0)
        file.truncate(whole)
        file.seek(whole)
        os.fsync(file.fileno())
        return cls(file, len(entries))

    def append(self, kind: str, t_s: float, **fields: Any) -> None:
        """Add a record. Raises ValueError for a value JSON cannot hold (NaN is one)."""
        entry = {"n": self._number, "t_s": t_s, "kind": kind, **fields}
        self._pending += encode(entry)
        self._number += 1
        with contextlib.suppress(OSError):
            self._hand_over()

    def _hand_over(self) -> None:
        while self._pending:
            del self._pending[: self._file.write(self._pending)]

    def commit(self) -> None:
        """Bring everything appended so far to the disk. Raises OSError (disk full)."""
        self._hand_over()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Commit and close. Raises OSError if something is not on the disk; closed it is all the same."""
        if not self._file.closed:
            try:
                self.commit()
            finally:
                self._file.close()


def encode(entry: Entry) -> bytes:
    """One journal line.

    >>> encode({"n": 0, "t_s": 0.0, "kind": "note"})
    b'52ec6eba {"n":0,"t_s":0.0,"kind":"note"}\\n'
    """
    body = json.dumps(entry, allow_nan=False, separators=(",", ":"), ensure_ascii=False).encode()
    return b"%08x %s\n" % (zlib.crc32(body), body)


def read_journal(path: Path) -> Iterator[Entry]:
    """The records of a journal in order. Raises JournalDamaged, or OSError if it cannot be read."""
    data = path.read_bytes()
    lines = data.split(b"\n")
    tail = lines.pop()
    for number, line in enumerate(lines):
        entry = _decode(line)
        if entry is None or entry.get("n") != number:
            last = number == len(lines) - 1 and not tail
            if last and entry is None:
                return
            raise JournalDamaged(
                f"{path}:{number + 1}: this record does not match its checksum or its number, and records follow it. "
                "The journal was edited or the disk is damaged. Restore the file from a copy; it is not used as it is."
            )
        if number == 0 and (entry.get("kind") != "journal" or entry.get("format") != FORMAT):
            raise JournalDamaged(f"{path}:1: not a journal of format {FORMAT}. Was it written by another version?")
        yield entry


def load_journal(path: Path) -> list[Entry]:
    """All records of a run's journal, the head first. Raises JournalDamaged if there is not even a head, or OSError."""
    entries = list(read_journal(path))
    if not entries:
        raise JournalDamaged(f"{path}: holds no whole record. The run died before it began, or this is no journal.")
    return entries


def _decode(line: bytes) -> Entry | None:
    checksum, _, body = line.partition(b" ")
    try:
        if checksum != b"%08x" % zlib.crc32(body):
            return None
        entry = json.loads(body)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None
