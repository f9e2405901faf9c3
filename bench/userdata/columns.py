"""Which columns of a file hold what: --map temperature=COL,rate=COL, and what is taken without it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from bench.errors import UserMistake, did_you_mean
from bench.userdata.tables import Table

# Units of the quantities a user maps, as suffixes of column names.
UNITS = {"temperature": "degc", "rate": "dps", "truth": "dps"}
_NEXT = re.compile(r",(?=\s*[A-Za-z_]\w*\s*=)")


def parse_map(options: Iterable[str], allowed: Sequence[str]) -> dict[str, str]:
    """`temperature=T1+T2,rate=w` to quantity -> text; the same quantity again adds columns. Raises UserMistake.

    >>> parse_map(["temperature=T1,rate=w", "temperature=T2"], ["temperature", "rate"])
    {'temperature': 'T1+T2', 'rate': 'w'}
    """
    found: dict[str, str] = {}
    for item in (item for option in options for item in _NEXT.split(option)):
        key, equals, text = (part.strip() for part in item.partition("="))
        if not equals or not text:
            raise UserMistake(f"--map {item!r} is not QUANTITY=COLUMN, as in --map temperature=T_coil,rate=omega")
        if key not in allowed:
            raise UserMistake(f"--map {item!r}: unknown quantity '{key}'.{did_you_mean(key, allowed)}")
        found[key] = f"{found[key]}+{text}" if key in found else text
    return found


def columns_named(table: Table, text: str, what: str) -> list[str]:
    """The columns that `T1+T2` names; a column that has a + in its name goes before two columns."""
    names = [text] if text in table.header else [name.strip() for name in text.split("+")]
    return [table.column(name, what) for name in names]


def one_column(table: Table, text: str, what: str) -> str:
    """The single column that a text names. Raises UserMistake if it names more."""
    names = columns_named(table, text, what)
    if len(names) != 1:
        raise UserMistake(f"--map {what}={text}: the {what} is one column; only temperature may be several.")
    return names[0]


def unmapped(table: Table, quantity: str, chosen: Mapping[str, str]) -> str | None:
    """What is mapped, or a column of the quantity's own name with or without its unit; None if there is neither."""
    if quantity in chosen:
        return chosen[quantity]
    names = (quantity, f"{quantity}_{UNITS[quantity]}" if quantity in UNITS else quantity)
    return next((name for name in names if name in table.header), None)
