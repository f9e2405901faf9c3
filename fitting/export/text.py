"""Pieces of C text: names, comments, arrays, checks."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Table
from fitting.export.precision import Precision

_WIDTH = 116
_LONGEST_NAME = 48


def identifier(*words: str) -> str:
    """A name in C made of words: lower case, digits and underscores; its prefix keeps it off C's names and our own.

    >>> identifier("FOG-A01", "ts_joint"), identifier("7 Ω"), identifier("", "int")
    ('gyro_fog_a01_ts_joint', 'gyro_7', 'gyro_int')
    """
    name = re.sub(r"[^a-z0-9]+", "_", "_".join(words).lower()).strip("_")[:_LONGEST_NAME].rstrip("_")
    return name if name.startswith("gyro_") else f"gyro_{name or 'model'}"


def fill(template: str, words: Mapping[str, str]) -> str:
    """Replace every @WORD@ once, so that no text put in is taken for one."""
    return re.sub(r"@([A-Z_]+)@", lambda found: words[found[1]], template)


def comment(text: str) -> str:
    """Text that can stand in a C comment: printable ASCII, no end of the comment, no trigraph."""
    plain = "".join(c if c == "\n" or (c.isascii() and c.isprintable()) else "?" for c in text)
    return re.sub(r"\?(?=\?)", "? ", plain.replace("*/", "* /").replace("/*", "/ *"))


def table_text(table: Table, precision: Precision) -> str:
    """One static array; C has no empty ones, so that an empty table holds a zero."""
    values = table.values.ravel() if table.size else np.zeros(1)
    return whole_array(table.name, values) if table.whole else real_array(table.name, values, precision)


def real_array(name: str, values: NDArray[np.float64], precision: Precision) -> str:
    """A static array of floating numbers."""
    return _array("real", name, map(precision.literal, values.ravel()))


def whole_array(name: str, values: NDArray[Any]) -> str:
    """A static array of whole numbers from 0 to 255."""
    return _array("unsigned char", name, (str(int(value)) for value in values.ravel()))


def _array(kind: str, name: str, literals: Iterable[str]) -> str:
    lines, line = [f"static const {kind} {name}[] = {{"], "   "
    for literal in literals:
        if len(line) + len(literal) + 2 > _WIDTH:
            lines.append(line)
            line = "   "
        line += f" {literal},"
    return "\n".join([*lines, line, "};"])


def table_checks(tables: Sequence[Table], precision: Precision) -> dict[str, str]:
    """Words of the self-test that compare the tables with their checksum."""
    checked = [table for table in tables if not table.whole and table.size]
    first, second = checksum(np.concatenate([table.values.ravel() for table in checked]).astype(precision.dtype))
    calls = "\n".join(f"    add(sums, {table.name}, {table.size});" for table in checked)
    return {"CHECKS": calls, "FIRST": str(first), "SECOND": str(second)}


def checksum(values: NDArray[np.floating[Any]]) -> tuple[int, int]:
    """Fletcher's two sums modulo 2^32 over exponent, upper and lower half of the mantissa of each number, (n,)."""
    mantissas, exponents = np.frexp(values)
    scaled = mantissas.astype(np.float64) * 2.0**26
    upper = np.trunc(scaled)
    words = np.column_stack([exponents, upper, (scaled - upper) * 2.0**27]).astype(np.int64).ravel()
    first = np.add.accumulate(words.astype(np.uint64) & np.uint64(0xFFFFFFFF))
    return int(first[-1]) & 0xFFFFFFFF, int((first & np.uint64(0xFFFFFFFF)).sum()) & 0xFFFFFFFF
