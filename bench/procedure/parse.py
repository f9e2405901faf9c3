"""Reads a procedure file and what it includes into a checked tree of steps; mistakes are collected, not thrown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.errors import InvalidFiles, Mark, Problem, did_you_mean
from bench.fields import YamlMapping, validate
from bench.procedure.language import BLOCKS, SHORT_FORM, VERBS, Include, ProcedureHead
from bench.yamlfile import Document, Path_, load_yaml

MAX_INCLUDE_DEPTH = 8
# Eight levels of ten includes each would be a hundred million files.
MAX_INCLUDES = 1000


@dataclass(frozen=True)
class StepNode:
    """One step as written: its verb, checked arguments, place, and the steps inside it."""

    verb: str
    args: YamlMapping
    mark: Mark
    children: tuple[StepNode, ...] = ()


@dataclass(frozen=True)
class ParsedProcedure:
    """A procedure file read and checked by itself; no bench and no expansion yet."""

    head: ProcedureHead
    steps: tuple[StepNode, ...]
    document: Document
    included: tuple[Path, ...] = field(default=())


def parse_procedure(
    path: Path,
    edit: Callable[[Document], Document] = lambda document: document,
    follow_includes: bool = True,
    recorded: Sequence[Path] = (),
) -> tuple[ParsedProcedure | None, list[Problem]]:
    """Read a procedure; `edit` may change the document first (--set). Returns what could be read and all mistakes.

    `recorded` are copies of the included files in the order they were read, for a procedure in a run folder.
    """
    try:
        document = edit(load_yaml(path))
    except InvalidFiles as error:
        return None, error.problems
    reader = _Reader(follow_includes, recorded)
    steps = tuple(reader.steps(document, ("steps",), path.parent, depth=0))
    head = validate(ProcedureHead, document, (), reader.problems)
    if head is None:
        return None, reader.problems
    return ParsedProcedure(head, steps, document, tuple(reader.included)), reader.problems


class _Reader:
    def __init__(self, follow_includes: bool, recorded: Sequence[Path]) -> None:
        self._follow_includes = follow_includes
        self._recorded = recorded
        self.problems: list[Problem] = []
        self.included: list[Path] = []

    def steps(self, document: Document, at: Path_, folder: Path, depth: int) -> Iterator[StepNode]:
        items = _get(document.data, at)
        # That it is a list is checked with the mapping around it.
        for index, item in enumerate(items if isinstance(items, list) else ()):
            node = self._step(document, (*at, index), item, folder, depth)
            if node is not None:
                yield node

    def _step(self, document: Document, at: Path_, item: Any, folder: Path, depth: int) -> StepNode | None:
        if not isinstance(item, dict) or len(item) != 1:
            self._say(document, at, f"a step is one verb with its arguments. Allowed verbs: {', '.join(VERBS)}")
            return None
        verb = next(iter(item))
        here = (*at, verb)
        if verb not in VERBS:
            hint = did_you_mean(verb, VERBS)
            self.problems.append(Problem(document.mark(here, key=True), f"unknown verb '{verb}'.{hint}"))
            return None
        args = self._arguments(document, here, verb, item[verb])
        children: tuple[StepNode, ...] = ()
        if verb in BLOCKS and isinstance(item[verb], dict):
            children = tuple(self.steps(document, (*here, "steps"), folder, depth))
        if isinstance(args, Include) and self._follow_includes:
            children = self._include(document, here, folder / args.file, depth)
        if args is None:
            return None
        return StepNode(verb, args, document.mark(here, key=True), children)

    def _arguments(self, document: Document, here: Path_, verb: str, value: Any) -> YamlMapping | None:
        if verb in SHORT_FORM and not isinstance(value, dict):
            key = SHORT_FORM[verb]
            document = _with_long_form(document, here, key)
        return validate(VERBS[verb], document, here, self.problems)

    def _include(self, document: Document, here: Path_, path: Path, depth: int) -> tuple[StepNode, ...]:
        if depth >= MAX_INCLUDE_DEPTH or len(self.included) >= MAX_INCLUDES:
            allowed = f"includes are {MAX_INCLUDE_DEPTH} levels deep and {MAX_INCLUDES} altogether at most"
            self._say(document, here, f"{allowed}. Does a file include itself? Use repeat to do something again")
            return ()
        if len(self.included) < len(self._recorded):
            path = self._recorded[len(self.included)]
        try:
            inner = load_yaml(path)
        except InvalidFiles as error:
            self.problems.extend(Problem(document.mark(here), str(problem)) for problem in error.problems)
            return ()
        self.included.append(path)
        steps = inner.data.get("steps") if isinstance(inner.data, dict) and len(inner.data) == 1 else None
        if not isinstance(steps, list) or not steps:
            message = "an included file holds one key, 'steps', with a list of steps, and nothing else."
            self.problems.append(Problem(inner.mark(()), message))
            return ()
        return tuple(self.steps(inner, ("steps",), path.parent, depth + 1))

    def _say(self, document: Document, at: Path_, message: str) -> None:
        self.problems.append(Problem(document.mark(at), f"{message}."))


def _get(data: Any, path: Sequence[str | int]) -> Any:
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _with_long_form(document: Document, here: Path_, key: str) -> Document:
    """The document with `verb: value` at `here` seen as `verb: {key: value}`."""
    value = _get(document.data, here)
    data: Any = {key: value}
    for part in reversed(here):
        data = {part: data}
    return Document(document.file, data, {**document.values, (*here, key): document.mark(here)}, document.keys)
