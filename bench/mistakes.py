"""From what pydantic reports to mistakes with a place, in the words of the YAML file (law 12)."""

from __future__ import annotations

import re
import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from bench.errors import Problem, did_you_mean
from bench.units import DIMENSIONS, shown, split_suffix
from bench.yamlfile import Document, Path_

_EXPECTED = {
    "string_type": "text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "list_type": "a list (its items start with '- ')",
    "dict_type": "a mapping",
}
_BOUNDS = {"greater_than": ("gt", "above"), "greater_than_equal": ("ge", "at least")} | {
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}
_LENGTHS = {
    "too_short": ("min_length", "fewer than", "items"),
    "too_long": ("max_length", "more than", "items"),
    "string_too_short": ("min_length", "fewer than", "characters"),
    "string_too_long": ("max_length", "more than", "characters"),
}
_NAME_RULE = "letters, digits, '.', '_' and '-', the first a letter or digit, at most 64 characters"


@dataclass(frozen=True)
class _Mistake:
    """One error of pydantic; `path` are the keys and indices below the mapping that was validated."""

    error: dict[str, Any]
    path: Path_
    value: Any

    @property
    def kind(self) -> str:
        return str(self.error["type"])

    @property
    def untaken(self) -> bool:
        """Whether the value is of another kind than one of the alternatives that may stand here."""
        return len(self.error["loc"]) > len(self.path) and self.kind in (*_EXPECTED, "model_type")


def problems_of(model: type[BaseModel], document: Document, base: Path_, errors: Sequence[Any]) -> Iterator[Problem]:
    """The problems behind the `errors` of validating the mapping at `base` of a document as `model`."""
    data = document.data
    for part in base:
        data = data[part]
    mistakes = [_mistake(data, dict(error)) for error in errors]
    taken = [mistake.path for mistake in mistakes if not mistake.untaken]
    alternatives: dict[Path_, list[_Mistake]] = {}
    for mistake in mistakes:
        if not mistake.untaken:
            yield _problem(model, document, base, mistake)
        elif not any(path[: len(mistake.path)] == mistake.path for path in taken):
            alternatives.setdefault(mistake.path, []).append(mistake)
    for path, untaken in alternatives.items():
        kinds = {_expected(model, item) for item in untaken}
        expected = " or ".join(sorted(kinds, key=lambda kind: (len(kind), kind)))
        text = f"{_subject(path)}expected {expected}, not {shown(untaken[0].value)}."
        yield Problem(document.mark((*base, *path)), text)


def _mistake(data: Any, error: dict[str, Any]) -> _Mistake:
    """Finds the YAML path of an error: pydantic's location also names the alternatives of a union."""
    path: list[str | int] = []
    for part in error["loc"]:
        in_list = isinstance(data, list) and isinstance(part, int) and part < len(data)
        if in_list or (isinstance(data, dict) and part in data):
            path.append(part)
            data = data[part]
    if error["type"] == "missing":
        path.append(error["loc"][-1])
    return _Mistake(error, tuple(path), data)


def _problem(model: type[BaseModel], document: Document, base: Path_, mistake: _Mistake) -> Problem:
    path = (*base, *mistake.path)
    last = str(path[-1]) if path else ""
    if mistake.kind == "extra_forbidden":
        parent = model_at(model, mistake.path[:-1])
        hint = did_you_mean(last, keys_of(parent)) if parent else ""
        return Problem(document.mark(path, key=True), f"unknown key '{last}'.{hint}")
    if mistake.kind == "missing":
        owner = document.mark(path[:-1], key=True)
        return Problem(owner, f"the key '{last}' is missing here.{_example(model, mistake.path)}")
    if mistake.error["loc"][-1:] == ("[key]",):
        return Problem(document.mark(path, key=True), f"'{last}' cannot be a name. Allowed: {_NAME_RULE}.")
    about_whole = mistake.kind == "value_error" and isinstance(mistake.value, dict)
    subject = "" if about_whole else _subject(mistake.path)
    return Problem(document.mark(path), subject + sentence(_text(model, mistake)))


def _text(model: type[BaseModel], mistake: _Mistake) -> str:
    kind, context, value = mistake.kind, mistake.error.get("ctx", {}), shown(mistake.value)
    if kind == "value_error":
        return str(context["error"])
    if kind == "literal_error":
        words = re.findall(r"'([^']*)'", context["expected"])
        return f"{value} is not allowed.{did_you_mean(str(mistake.value), words)}"
    if kind in _BOUNDS:
        name, relation = _BOUNDS[kind]
        return f"must be {relation} {_with_unit(context[name], suffix_at(model, mistake.path))}, not {value}"
    if kind == "finite_number":
        return f"must be a finite number, not {value}"
    if kind in _LENGTHS:
        name, relation, things = _LENGTHS[kind]
        return "must not be empty" if context.get("min_length") == 1 else f"has {relation} {context[name]} {things}"
    if kind == "string_pattern_mismatch":
        return f"{value} cannot be a name. Allowed: {_NAME_RULE}"
    if kind in _EXPECTED or kind == "model_type":
        return f"expected {_expected(model, mistake)}, not {value}"
    return f"{mistake.error['msg']}, not {value}"


def _subject(path: Path_) -> str:
    """The key that a message is about: the nearest one above a list item."""
    keys = [part for part in path if isinstance(part, str)]
    return f"'{keys[-1]}': " if keys else ""


def _expected(model: type[BaseModel], mistake: _Mistake) -> str:
    inner = model_at(model, mistake.path) if mistake.kind == "model_type" else None
    return f"a mapping with the keys {', '.join(keys_of(inner))}" if inner else _EXPECTED.get(mistake.kind, "a mapping")


def _with_unit(value: float, suffix: str | None) -> str:
    return f"{value:g} {next(iter(DIMENSIONS[suffix].factors))}" if suffix else f"{value:g}"


def _example(model: type[BaseModel], path: Path_) -> str:
    suffix = suffix_at(model, path)
    return f" Example: {path[-1]}: {DIMENSIONS[suffix].example}" if suffix else ""


def sentence(text: str) -> str:
    """The text with a full stop, unless it ends with a mark of its own."""
    return text if text.endswith((".", "?")) else f"{text}."


def keys_of(model: type[BaseModel]) -> list[str]:
    """The YAML keys of a mapping."""
    return [field.alias or name for name, field in model.model_fields.items()]


def suffix_at(model: type[BaseModel], path: Path_) -> str | None:
    """The unit suffix of the field at `path`, or of the list whose item is at `path`."""
    while path and isinstance(path[-1], int):
        path = path[:-1]
    owner = model_at(model, path[:-1]) if path else None
    names = owner.model_fields if owner else {}
    return next((split_suffix(name)[1] for name, field in names.items() if (field.alias or name) == path[-1]), None)


def model_at(model: type[BaseModel], path: Path_) -> type[BaseModel] | None:
    """The model of the mapping at `path`; None if it is free."""
    annotation: Any = model
    for part in path:
        if isinstance(part, int):
            continue
        if typing.get_origin(annotation) is dict:
            annotation = typing.get_args(annotation)[1]
            continue
        owner = _inner_model(annotation)
        fields = owner.model_fields.items() if owner else ()
        annotation = next((field.annotation for name, field in fields if (field.alias or name) == part), None)
    return None if typing.get_origin(annotation) is dict else _inner_model(annotation)


def _inner_model(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for arg in typing.get_args(annotation) if (found := _inner_model(arg))), None)
