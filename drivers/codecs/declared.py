"""Declarations of frames as data: finding them by name, building one on another, and reading their keys strictly.

A declaration is a YAML mapping. `{base: kvh_36, rate: {kind: rate}}` is the packaged declaration `kvh_36` with one key
changed; a key set to null is taken out.
"""

import contextlib
import difflib
from collections.abc import Iterable, Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from reprlib import repr as short
from typing import Any, TypeGuard

import yaml

# A declaration is a page of text; anything much larger is another kind of file.
_LARGEST_BYTES = 64 * 1024
_DEEPEST_BASE = 8
_DEEPEST_NESTING = 20


class FrameSpecError(ValueError):
    """A declaration is wrong: the message names the key path, what is allowed there and what to do."""


class Keys:
    """Reads a mapping key by key, strictly."""

    def __init__(self, mapping: Mapping[str, Any], path: str) -> None:
        self._mapping, self._path = mapping, path

    def only(self, *allowed: str) -> None:
        """Refuse other keys."""
        for key in self._mapping:
            if key not in allowed:
                text = f"unknown key. Allowed: {', '.join(allowed)}.{did_you_mean(key, allowed)}"
                raise self.error(str(key), text)

    def path(self, key: str) -> str:
        """Key path as messages show it."""
        return f"{self._path}.{key}" if self._path else key

    def error(self, key: str, text: str) -> FrameSpecError:
        """An error about one key."""
        return FrameSpecError(f"{self.path(key)}: {text}")

    def get(self, key: str) -> Any:
        """The value, None if missing."""
        return self._mapping.get(key)

    def names(self) -> list[str]:
        """All keys there are, where a user chooses them."""
        return [str(key) for key in self._mapping]

    def required(self, key: str, what: str) -> Any:
        """The value. `what` says in the message what is missing."""
        value = self.get(key)
        if value is None:
            raise self.error(key, f"is missing; it gives {what}")
        return value

    def text(self, key: str, what: str) -> str:
        """A required text."""
        value = self.required(key, what)
        if not isinstance(value, str):
            raise self.error(key, f"{short(value)} is not a text; it gives {what}")
        return value

    def choice(self, key: str, allowed: Iterable[str], default: str | None, what: str) -> str:
        """One of a few words."""
        allowed = list(allowed)
        value = self.required(key, what) if default is None else self.get(key)
        if value is None and default is not None:
            return default
        if value not in allowed:
            raise self.error(
                key, f"{short(value)} is not allowed. Allowed: {', '.join(allowed)}.{did_you_mean(value, allowed)}"
            )
        return str(value)

    def integer(self, key: str, low: int, high: int, default: int | None = None, what: str = "a number") -> int:
        """A whole number in low..high; '0x7F' is one too."""
        value = self.required(key, what) if default is None else self.get(key)
        if value is None and default is not None:
            return default
        number = whole_number(value)
        if number is None or not low <= number <= high:
            raise self.error(key, f"{short(value)} is not allowed. Allowed: a whole number {low} to {high}")
        return number

    def number(self, key: str, default: float) -> float:
        """A finite number."""
        value = self.get(key)
        if value is None:
            return default
        if isinstance(value, str):
            with contextlib.suppress(ValueError):
                value = float(value)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not -1e300 < value < 1e300:
            raise self.error(key, f"{short(value)} is not allowed. Allowed: a finite number, like {default:g}")
        return float(value)

    def flag(self, key: str) -> bool:
        """True or false; missing is false."""
        value = self.get(key)
        if value not in (None, True, False, "true", "false"):
            raise self.error(key, f"{short(value)} is not allowed. Allowed: true, false")
        return value in (True, "true")

    def section(self, key: str) -> "Keys | None":
        """A nested mapping, None if missing."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, Mapping):
            raise self.error(key, f"{short(value)} is not a mapping of keys and values")
        return Keys(value, self.path(key))

    def sections(self, key: str) -> list["Keys"]:
        """A list of nested mappings."""
        value = self.get(key)
        if not isinstance(value, list) or not all(isinstance(item, Mapping) for item in value):
            raise self.error(key, "must be a list of mappings, like - {name: rate, at: 2, type: i32}")
        return [Keys(item, f"{self.path(key)}[{number}]") for number, item in enumerate(value)]


def whole_number(value: object) -> int | None:
    """A whole number, also written as text like '0x7F'; None if it is none.

    >>> whole_number("0x7F"), whole_number("010"), whole_number(True)
    (127, None, None)
    """
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            return int(value, 0)
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def did_you_mean(word: object, allowed: Iterable[str]) -> str:
    """The end of a message: ' Did you mean ...?', or nothing."""
    near = [other for other in allowed if other.startswith(str(word))]
    near = near or difflib.get_close_matches(str(word), list(allowed), n=1)
    return f" Did you mean {near[0]}?" if near else ""


def packaged_folder(parts: Iterable[str]) -> Traversable:
    """A folder of files that come with fogbench, as path parts below the package `drivers`."""
    return resources.files("drivers").joinpath(*parts)


def load_declaration(declaration: str | Mapping[str, Any], packaged: Iterable[str]) -> dict[str, Any]:
    """A declaration with its bases merged in.

    declaration: the name of a packaged one, the path of a YAML file, or the mapping itself, which may say
    `base: <name or path>`. packaged: the folder of packaged ones, as path parts below the package `drivers`.
    Raises FrameSpecError.
    """
    return _load(declaration, packaged_folder(packaged), _DEEPEST_BASE)


def find_file(name: str, folder: Traversable, suffix: str, what: str) -> Path | Traversable:
    """The packaged file `name` (without suffix) in a folder, or the file at that path. Raises FrameSpecError."""
    names = sorted(entry.name.removesuffix(suffix) for entry in folder.iterdir() if entry.name.endswith(suffix))
    if name in names:
        return folder.joinpath(name + suffix)
    if Path(name).is_file():
        return Path(name)
    raise FrameSpecError(
        f"{what} '{name}' is neither a packaged one ({', '.join(names)}) nor a file here.{did_you_mean(name, names)}"
    )


def read_small(file: Path | Traversable, encoding: str = "utf-8", largest: int = _LARGEST_BYTES) -> str:
    """The text of a file. Raises FrameSpecError if it cannot be read as such."""
    try:
        content = file.read_bytes()
        if len(content) > largest:
            raise FrameSpecError(f"{file}: {len(content)} bytes; a declaration has at most {largest}")
        return content.decode(encoding)
    except (OSError, UnicodeDecodeError) as error:
        raise FrameSpecError(f"{file}: cannot be read as text: {error}") from error


class _Plain(yaml.BaseLoader):
    """YAML in which every scalar is text but an empty one, ~ and null: numbers are read where one is expected.

    So 1e-6 is a number, 010 is refused instead of being eight, and 94 in a header is the byte 94.
    """

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.style is None and node.value in ("", "~", "null"):
            return None
        if isinstance(node, yaml.MappingNode):
            seen: set[str] = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key.value in seen:
                    problem = f"the key '{key.value}' stands twice"
                    raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
                seen.add(key.value)
        return super().construct_object(node, deep)


def _yaml(text: str) -> Any:
    """The data in a text that is not nested deeper than any declaration. Raises yaml.YAMLError."""
    depth = 0
    for event in yaml.parse(text, Loader=_Plain):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST_NESTING:
            problem = f"nested more than {_DEEPEST_NESTING} levels deep"
            raise yaml.YAMLError(f"{problem}, line {event.start_mark.line + 1 if event.start_mark else '?'}")
    return yaml.load(text, Loader=_Plain)


def _load(declaration: str | Mapping[str, Any], folder: Traversable, depth: int) -> dict[str, Any]:
    if isinstance(declaration, str):
        file = find_file(declaration, folder, ".yaml", "frame")
        try:
            mapping = _yaml(read_small(file))
        except yaml.YAMLError as error:
            raise FrameSpecError(f"{file}: cannot be read as YAML: {error}") from error
        if not isinstance(mapping, Mapping):
            raise FrameSpecError(f"{file}: must hold a mapping of keys and values (name, length, header, fields, ...)")
        mapping = {"name": declaration, **mapping}
    elif isinstance(declaration, Mapping):
        mapping = dict(declaration)
    else:
        raise FrameSpecError(f"frame: {short(declaration)} is neither a name, a path nor a mapping")
    base = mapping.pop("base", None)
    if base is None:
        return mapping
    if depth == 0:
        raise FrameSpecError(f"base: {short(base)}: declarations are built on one another in a circle, or too deep")
    return _merged(_load(base, folder, depth - 1), mapping)


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        before = merged.get(key)
        if value is None:
            merged.pop(key, None)
        elif isinstance(before, Mapping) and isinstance(value, Mapping):
            merged[key] = _merged(before, value)
        elif _named(before) and _named(value):
            by_name = {item["name"]: item for item in before}
            changed = {item["name"]: _merged(by_name.get(item["name"], {}), item) for item in value}
            merged[key] = list({**by_name, **changed}.values())
        else:
            merged[key] = value
    return merged


def _named(value: Any) -> TypeGuard[list[Mapping[str, Any]]]:
    return isinstance(value, list) and all(isinstance(item, Mapping) and "name" in item for item in value)
