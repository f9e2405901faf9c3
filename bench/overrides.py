"""--set path=value: change single values of a procedure or bench file for one run."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bench.errors import InvalidFiles, Mark, UserMistake, did_you_mean
from bench.yamlfile import Document, Path_, parse_yaml

ROOTS = ("procedure", "bench")


@dataclass(frozen=True)
class Override:
    """One --set: which file, where in it, and the new value."""

    root: str
    path: Path_
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
    path = tuple(int(part) if part.isdigit() else part for part in parts)
    return Override(root, path, value, text)


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
    place = data
    for depth, part in enumerate(item.path[:-1]):
        if isinstance(place, dict) and part not in place and item.root == "bench" and depth > 0:
            place[part] = {}
        place = _descend(place, part, item)
    last = item.path[-1]
    if isinstance(place, list):
        _descend(place, last, item)
    elif not isinstance(place, dict):
        raise UserMistake(f"--set {item.text}: there is no mapping or list to put '{last}' into.")
    place[last] = item.value
    mark = Mark(f"--set {item.text}")
    return replace(
        document,
        data=data,
        values={**document.values, item.path: mark},
        keys={**document.keys, item.path: mark},
    )


def _descend(place: Any, part: str | int, item: Override) -> Any:
    if isinstance(place, list) and isinstance(part, int) and part < len(place):
        return place[part]
    if isinstance(place, dict) and part in place:
        return place[part]
    keys = [str(key) for key in place] if isinstance(place, dict) else [str(i) for i in range(len(place or []))]
    raise UserMistake(f"--set {item.text}: the file has no '{part}' there.{did_you_mean(str(part), keys)}")
