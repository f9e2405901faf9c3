"""--set path=value: change single values of a procedure or bench file for one run."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bench.errors import InvalidFiles, Mark, UserMistake, did_you_mean
from bench.yamlfile import Document, Path_, parse_yaml

ROOTS = ("procedure", "bench")


@dataclass(frozen=True)
class Override:
    """One --set: which file, where in it, and the new value."""

    root: str
    path: tuple[str, ...]
    value: Any
    text: str


def parse_overrides(texts: Sequence[str]) -> list[Override]:
    """Read `procedure.a.b=value` and `bench.a.b=value`; list items by their number from 0. Raises UserMistake."""
    return [_parse(text) for text in texts]


def _parse(text: str) -> Override:
    path_text, equals, value_text = text.partition("=")
    root, *parts = path_text.strip().split(".")
    if not equals or root not in ROOTS or not parts or not all(parts):
        raise UserMistake(
            f"--set {text!r} is not path=value. Allowed: a path that starts with 'procedure.' or 'bench.', e.g. "
            "--set bench.simulation.seed=7 or --set procedure.raw=none"
        )
    try:
        value = parse_yaml(value_text, f"--set {path_text}").data
    except InvalidFiles as error:
        raise UserMistake(str(error)) from None
    return Override(root, tuple(parts), value, text)


def editor(overrides: Sequence[Override], root: str) -> Callable[[Document], Document]:
    """The function that applies the overrides of one file to its document; it raises UserMistake for a wrong path."""
    mine = [item for item in overrides if item.root == root]

    def edit(document: Document) -> Document:
        for item in mine:
            document = _apply(document, item)
        return document

    return edit


def _apply(document: Document, item: Override) -> Document:
    data = copy.deepcopy(document.data)
    place: Any = data
    path: list[str | int] = []
    made = len(item.path)
    for depth, part in enumerate(item.path[:-1]):
        if isinstance(place, dict) and part not in place and item.root == "bench" and depth > 0:
            place[part] = {}
            made = min(made, depth + 1)
        path.append(_key(place, part, item))
        place = place[path[-1]]
    if not isinstance(place, dict | list):
        raise UserMistake(f"--set {item.text}: there is no mapping or list to put '{item.path[-1]}' into.")
    path.append(item.path[-1] if isinstance(place, dict) else _key(place, item.path[-1], item))
    place[path[-1]] = item.value  # type: ignore[index]
    return _marked(replace(document, data=data), tuple(path), made, item)


def _key(place: Any, part: str, item: Override) -> str | int:
    """The key or index that a part of a path means."""
    if isinstance(place, dict) and part in place:
        return part
    indices = [str(index) for index in range(len(place))] if isinstance(place, list) else []
    if part in indices:
        return int(part)
    keys = list(place) if isinstance(place, dict) else indices
    raise UserMistake(f"--set {item.text}: the file has no '{part}' there.{did_you_mean(part, keys)}")


def _marked(document: Document, path: Path_, made: int, item: Override) -> Document:
    """The document with the marks of the new value, and of the `made`-th part of its path on, on the --set."""
    mark = Mark(f"--set {item.text}")
    new = dict.fromkeys([path[:end] for end in range(made, len(path))] + list(_paths(path, item.value)), mark)
    values = {at: old for at, old in document.values.items() if at[: len(path)] != path}
    keys = {at: old for at, old in document.keys.items() if at[: len(path)] != path}
    return replace(document, values=values | new, keys=keys | new)


def _paths(path: Path_, value: Any) -> Iterator[Path_]:
    yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in children:
        yield from _paths((*path, key), inner)
