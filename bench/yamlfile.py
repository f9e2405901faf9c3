"""YAML read safely, every value with the place it came from.

Only plain data is accepted: no anchors or aliases (a seven-line alias bomb stalls a walking reader for seconds), no
tags, no duplicate keys (pyyaml keeps the last one silently), bounded size and depth. Scalars are those of the YAML 1.2
core schema without octal and hexadecimal numbers: `on` and `no` are words, `1:30`, `010` and `0x1F` are text, `1e3` is
a number.
"""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
    StreamEndEvent,
)

from bench.errors import InvalidFiles, Mark, Problem

MAX_BYTES = 1_000_000
MAX_DEPTH = 40
MAX_NODES = 100_000

Path_ = tuple[str | int, ...]

_INT = re.compile(r"[+-]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[+-]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+)([eE][+-]?[0-9]+)?")
# What YAML 1.2 counts as not printable (section 5.1).
_UNREADABLE = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ud800-\udfff\ufffe\uffff]")
_SPECIAL_FLOAT = re.compile(r"[+-]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS: dict[str, Any] = {"": None, "~": None} | {
    spelling: value
    for word, value in (("null", None), ("true", True), ("false", False))
    for spelling in (word, word.capitalize(), word.upper())
}
# What pyyaml says, and what a stranger to YAML may have done.
_HINTS = {
    "cannot start any token": "Indent with spaces, not tabs; put text that begins with % or @ in quotes.",
    "mapping values are not allowed": "Is a line above it indented wrongly, or a text with ': ' in it not in quotes?",
}


@dataclass(frozen=True)
class Document:
    """YAML data and the mark of every key and value, by path from the root."""

    file: str
    data: Any
    values: dict[Path_, Mark] = field(default_factory=dict)
    keys: dict[Path_, Mark] = field(default_factory=dict)

    def mark(self, path: Path_, key: bool = False) -> Mark:
        """The mark of `path` or of its nearest known parent; of the key rather than the value if `key`."""
        if key and path in self.keys:
            return self.keys[path]
        for end in range(len(path), -1, -1):
            if path[:end] in self.values:
                return self.values[path[:end]]
        return Mark(self.file)


class _Refused(Exception):
    def __init__(self, mark: Mark, message: str) -> None:
        self.problem = Problem(mark, message)


def load_yaml(path: Path, name: str | None = None) -> Document:
    """Read `path`; `name` is what messages call it. Raises InvalidFiles."""
    shown = name or str(path)
    try:
        about = path.stat()
        # Never a device or a pipe: an include of /dev/zero has no end.
        raw = path.read_bytes() if stat.S_ISREG(about.st_mode) and about.st_size <= MAX_BYTES else b""
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidFiles(
            [Problem(Mark(shown), f"cannot be read: {reason}. Check the path and its permissions.")]
        ) from error
    if not stat.S_ISREG(about.st_mode):
        raise InvalidFiles([Problem(Mark(shown), "is not a file. Give the path of a YAML file.")])
    if about.st_size > MAX_BYTES:
        raise InvalidFiles(
            [Problem(Mark(shown), f"has {about.st_size} bytes; at most {MAX_BYTES} are read. Is this the right file?")]
        )
    try:
        return parse_yaml(raw.decode("utf-8"), shown)
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}). Save the file as UTF-8."
        raise InvalidFiles([Problem(Mark(shown), message)]) from error


def parse_yaml(text: str, name: str) -> Document:
    """Parse YAML text; see the module for what is refused. Raises InvalidFiles."""
    if unreadable := _UNREADABLE.search(text):
        before = text[: unreadable.start()]
        mark = Mark(name, before.count("\n") + 1, len(before) - before.rfind("\n"))
        message = f"the character U+{ord(unreadable[0]):04X} is not read. Is this a text file? Then take it out."
        raise InvalidFiles([Problem(mark, message)])
    try:
        return _Builder(text, name).document()
    except _Refused as refused:
        raise InvalidFiles([refused.problem]) from None
    except yaml.MarkedYAMLError as error:
        place = error.problem_mark or error.context_mark
        mark = Mark(name, place.line + 1, place.column + 1) if place else Mark(name)
        detail = " ".join(part for part in (error.context, error.problem) if part)
        hint = next((f" {hint}" for sign, hint in _HINTS.items() if sign in detail), "")
        raise InvalidFiles([Problem(mark, f"is not YAML: {detail}.{hint}")]) from None
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise InvalidFiles([Problem(Mark(name), f"is not YAML: {reason}.")]) from None


class _Builder:
    """Builds data from parser events, so that marks, anchors, tags and duplicates are all seen."""

    def __init__(self, text: str, name: str) -> None:
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        self._events = iter(yaml.parse(text, Loader=loader))
        self._name = name
        self._nodes = 0
        self._values: dict[Path_, Mark] = {}
        self._keys: dict[Path_, Mark] = {}

    def document(self) -> Document:
        data: Any = None
        documents = 0
        for event in self._events:
            if isinstance(event, DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise _Refused(self._mark(event), "a second document starts here. Allowed: one document per file.")
                data = self._node(next(self._events), ())
            elif isinstance(event, StreamEndEvent):
                break
        return Document(self._name, data, self._values, self._keys)

    def _mark(self, event: Event) -> Mark:
        start = event.start_mark
        return Mark(self._name, start.line + 1, start.column + 1) if start else Mark(self._name)

    def _node(self, event: Event, path: Path_) -> Any:
        mark = self._mark(event)
        self._nodes += 1
        if self._nodes > MAX_NODES or len(path) > MAX_DEPTH:
            raise _Refused(
                mark, f"too large: more than {MAX_NODES} values or {MAX_DEPTH} levels. Use sweeps and includes."
            )
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise _Refused(mark, "anchors (&) and aliases (*) are not read. Write the value out, or use include.")
        if tag := getattr(event, "tag", None):
            written = tag.replace("tag:yaml.org,2002:", "!!")
            raise _Refused(mark, f"the tag {written} is not read. Allowed: plain text, numbers, true/false, null.")
        self._values[path] = mark
        if isinstance(event, MappingStartEvent):
            return self._mapping(path)
        if isinstance(event, SequenceStartEvent):
            return self._sequence(path)
        assert isinstance(event, ScalarEvent)
        return _scalar(event) if event.implicit[0] else event.value

    def _sequence(self, path: Path_) -> list[Any]:
        items: list[Any] = []
        while not isinstance(event := next(self._events), SequenceEndEvent):
            items.append(self._node(event, (*path, len(items))))
        return items

    def _mapping(self, path: Path_) -> dict[str, Any]:
        result: dict[str, Any] = {}
        while not isinstance(event := next(self._events), MappingEndEvent):
            mark = self._mark(event)
            if not isinstance(event, ScalarEvent):
                raise _Refused(mark, "a key must be plain text.")
            key = event.value
            if getattr(event, "anchor", None) or event.tag:
                raise _Refused(mark, "anchors and tags are not read. Write plain keys.")
            if key == "<<":
                raise _Refused(mark, "merge keys (<<) are not read. Write the keys out.")
            if key in result:
                first = self._keys[(*path, key)]
                raise _Refused(mark, f"the key '{key}' stands twice (first in line {first.line}). Remove one of them.")
            self._keys[(*path, key)] = mark
            result[key] = self._node(next(self._events), (*path, key))
        return result


def _scalar(event: ScalarEvent) -> Any:
    text = event.value
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text) and len(text) < 20:
        return int(text)
    if _SPECIAL_FLOAT.fullmatch(text):
        return float(text.replace(".", "", 1))
    if _FLOAT.fullmatch(text) and not re.fullmatch(r"[+-]?0\d+", text):
        return float(text)
    return text
