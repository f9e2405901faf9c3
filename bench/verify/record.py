"""The run as its journal and its copies of procedure and bench file have it: what everything else is held against."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bench.errors import InvalidFiles
from bench.journal import Entry, JournalDamaged, read_journal
from bench.manifest import sha256
from bench.overrides import editor, parse_overrides
from bench.points import points_of
from bench.procedure.language import ProcedureHead
from bench.procedure.parse import parse_procedure
from bench.verify.findings import Check, Finding, attempt, collect

if TYPE_CHECKING:
    import pandas as pd

JOURNAL = "journal.jsonl"


@dataclass(frozen=True)
class Record:
    """What a run folder's journal says.

    entries: the whole records. damaged: some are missing, so that nothing may be folded from them. state: 'ended',
    'resumed' (begun again and not ended since) or 'open' (never ended). head: of the procedure, None if its copy
    cannot be read.
    """

    folder: Path
    entries: Sequence[Entry]
    damaged: bool
    head: ProcedureHead | None

    @property
    def state(self) -> Literal["ended", "resumed", "open"]:
        """How far the run has come."""
        kinds = (entry.get("kind") for entry in reversed(self.entries))
        last = next((kind for kind in kinds if kind in ("end", "resumed")), None)
        return "ended" if last == "end" else "resumed" if last else "open"

    @cached_property
    def points(self) -> pd.DataFrame:
        """The fold of the journal that points.csv should be."""
        return points_of(self.entries)

    def before_resuming(self) -> Record:
        """The run as it was before it was last resumed."""
        last = max(i for i, entry in enumerate(self.entries) if entry["kind"] == "resumed")
        return Record(self.folder, self.entries[:last], self.damaged, self.head)


def read_record(folder: Path) -> tuple[Record, list[Check]]:
    """Read journal and copies; what is wrong with them is in the checks."""
    findings: list[Finding] = []
    entries: list[Entry] = []
    collect(findings, JOURNAL, _read_whole_records, folder / JOURNAL, entries)
    if not entries:
        findings.append(Finding("holds no whole record: nothing can be held against it", JOURNAL))
    damaged = any(finding.severity == "wrong" for finding in findings)
    copies: list[Finding] = []
    head = attempt(copies, "procedure.yaml", _head, folder, entries) if entries else None
    record = Record(folder, entries, damaged, head)
    collect(findings, JOURNAL, _torn, record)
    collect(copies, JOURNAL, _copies, record)
    summary = f"{len(entries)} records, {'the run ended' if record.state == 'ended' else 'the run is not ended'}"
    return record, [Check("journal", summary, findings), Check("copies", "procedure.yaml and bench.yaml", copies)]


def _read_whole_records(path: Path, entries: list[Entry]) -> Iterator[Finding]:
    """Fill `entries` as far as the journal can be trusted."""
    if not path.is_file():
        raise JournalDamaged("it is not a regular file")
    try:
        for entry in read_journal(path):
            entries.append(entry)
    except JournalDamaged as error:
        yield Finding(str(error).partition(": ")[2], f"{JOURNAL}:{len(entries) + 1}")


def _torn(record: Record) -> list[Finding]:
    """Bytes after the last whole record: a crash leaves them, an orderly end does not."""
    if record.damaged or not record.entries:
        return []
    path = record.folder / JOURNAL
    lines = path.read_bytes().split(b"\n")
    extra = sum(len(line) + 1 for line in lines) - 1 - whole_bytes(record)
    if not extra:
        return []
    ended = record.state == "ended"
    text = f"{extra} bytes after the last whole record: " + (
        "the run had ended, so they do not belong there" if ended else "a record torn by a crash; it is left out"
    )
    return [Finding(text, f"{JOURNAL}:{len(record.entries) + 1}", severity="wrong" if ended else "note")]


def whole_bytes(record: Record) -> int:
    """Length of the record's entries in the journal file."""
    lines = (record.folder / JOURNAL).read_bytes().split(b"\n")
    return sum(len(line) + 1 for line in lines[: len(record.entries)])


def _head(folder: Path, entries: Sequence[Entry]) -> ProcedureHead:
    overrides = parse_overrides(entries[0].get("overrides", []))
    procedure, problems = parse_procedure(
        folder / "procedure.yaml", editor(overrides, "procedure"), follow_includes=False
    )
    if procedure is None:
        raise InvalidFiles(problems)
    return procedure.head


def _copies(record: Record) -> list[Finding]:
    """Copies whose hash is not the one the journal has of the file that was run."""
    findings = []
    for kind in ("procedure", "bench"):
        name = f"{kind}.yaml"
        expected, found = _hashes(record.entries, kind), sha256(record.folder / name)
        if expected and found not in expected:
            text = "is not the file that was run" if found else "is missing or cannot be read"
            findings.append(Finding(text, name, figure="sha256", expected=expected[-1], found=found))
    return findings


def _hashes(entries: Sequence[Entry], kind: str) -> list[str]:
    """Hashes of a file in the head, and in the records of resuming if it was changed then."""
    found: list[Any] = [entry.get(kind) for entry in entries if entry["kind"] in ("journal", "resumed")]
    return [item["sha256"] for item in found if isinstance(item, dict) and "sha256" in item]
