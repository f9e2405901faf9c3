"""Reading JSON that somebody else may have written: bounded, finite, and with a reason for every refusal."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 20
# No rate, temperature or slope is beyond this, and products of four such numbers stay finite.
LARGEST_NUMBER = 1e30


class Refused(ValueError):
    """The text or a value in it is not acceptable; the message is the reason."""


def read_object(path: Path) -> dict[str, Any]:
    """The JSON object in a file. `Refused` with the reason; OSError passes."""
    if not path.is_file():
        raise Refused("there is no such file" if not path.exists() else "it is not a regular file")
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise Refused(f"it is larger than {MAX_BYTES // 2**20} MiB")
    return parse_object(data)


def parse_object(data: bytes) -> dict[str, Any]:
    """The JSON object in UTF-8 bytes: no NaN or infinity, no key twice, at most 20 levels deep."""
    try:
        value = json.loads(data.decode("utf-8"), parse_constant=_no_constant, object_pairs_hook=_no_twins)
    except RecursionError:
        raise Refused(f"it is nested more than {MAX_DEPTH} levels deep") from None
    except Refused:
        raise
    except ValueError as error:
        raise Refused(f"it is not JSON in UTF-8 ({error})") from None
    _check_depth(value)
    if not isinstance(value, dict):
        raise Refused(f"it holds {_kind(value)} instead of an object")
    return value


def _no_constant(text: str) -> float:
    raise Refused(f"it contains {text}, which is not a finite number")


def _no_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise Refused(f"it has the key {key[:40]!r} twice")
        result[key] = value
    return result


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(MAX_DEPTH):
        level = [child for node in level if isinstance(node, dict | list) for child in _children(node)]
    if level:
        raise Refused(f"it is nested more than {MAX_DEPTH} levels deep")


def _children(node: dict[str, Any] | list[Any]) -> list[Any]:
    return list(node.values()) if isinstance(node, dict) else node


def _kind(value: object) -> str:
    names = {
        dict: "an object",
        list: "a list",
        str: "a text",
        bool: "true or false",
        int: "a number",
        float: "a number",
    }
    return names.get(type(value), "null")


def member(parent: Mapping[str, Any], key: str, expected: type, where: str = "") -> Any:
    """A required member of the expected JSON type (dict, list, str, int); `Refused` if it is missing or not that."""
    if key not in parent:
        raise Refused(f"{where}{key} is missing")
    if type(parent[key]) is not expected:
        wanted = "a whole number" if expected is int else _kind(expected())
        raise Refused(f"{where}{key} is {_kind(parent[key])} instead of {wanted}")
    return parent[key]


def number(value: object, where: str) -> float:
    """A finite number, at most 1e30 in size."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"{where} is {_kind(value)} instead of a number")
    if not abs(value) <= LARGEST_NUMBER or not math.isfinite(value):
        raise Refused(f"{where} is not a finite number of at most {LARGEST_NUMBER:g}")
    return float(value)


def vector(value: object, size: int, where: str) -> NDArray[np.float64]:
    """A list of exactly size numbers, shape (size,)."""
    if not isinstance(value, list) or len(value) != size:
        found = f"{len(value)} entries" if isinstance(value, list) else _kind(value)
        raise Refused(f"{where} has {found}; expected a list of {size} numbers")
    return np.array([number(entry, f"{where}[{k}]") for k, entry in enumerate(value)], dtype=np.float64)


def matrix(value: object, rows: int, columns: int, where: str) -> NDArray[np.float64]:
    """A list of rows lists of columns numbers, shape (rows, columns)."""
    if not isinstance(value, list) or len(value) != rows:
        found = f"{len(value)} rows" if isinstance(value, list) else _kind(value)
        raise Refused(f"{where} has {found}; expected {rows} rows of {columns} numbers")
    lines = [vector(line, columns, f"{where}[{k}]") for k, line in enumerate(value)]
    return np.array(lines, dtype=np.float64).reshape(rows, columns)


def columns_used(parameters: Mapping[str, Any], n_inputs: int) -> NDArray[np.intp]:
    """`columns` of a model's parameters: which of n_inputs inputs it looks at, ascending, shape (d,)."""
    columns = member(parameters, "columns", list, "parameters.")
    whole = all(type(column) is int for column in columns)
    if not whole or columns != sorted({*columns}) or any(not 0 <= column < n_inputs for column in columns):
        raise Refused(f"parameters.columns is not an ascending choice of the inputs 0 to {n_inputs - 1}")
    return np.array(columns, dtype=np.intp)
