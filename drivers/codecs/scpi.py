"""SCPI over a line of text, both roles: program messages and the answers to them.

Source: SCPI-99, volume 1, sections 5 (headers), 6 (program messages) and 7.2 (Boolean), volume 2, chapter 21
(SYSTem:ERRor); IEEE 488.2 for the common commands. A header is written like `OUTPut[:STATe]`: capitals are its short
form, brackets may be left out, and case is ignored. Messages of one line are separated by ';'; one that does not begin
with ':' or '*' continues in the branch of the one before.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import isfinite, nan

# Longer than any line seen; what is longer is no SCPI.
MAX_LINE = 1024
NO_ERROR = 0
# Standard numbers of errors (SCPI-99 volume 2, 21.8).
UNDEFINED_HEADER, DATA_OUT_OF_RANGE, MISSING_PARAMETER, DATA_TYPE_ERROR = -113, -222, -109, -104

_ERROR = re.compile(r'\s*([+-]?\d{1,6})\s*,\s*"((?:[^"]|"")*)"\s*')
_PART = re.compile(r"\[|\]|:|[A-Za-z*]+|\d+")


class ScpiError(ValueError):
    """A line that is no answer to what was asked."""


@dataclass(frozen=True, slots=True)
class Message:
    """One program message: its header from the root ('OUTP:STAT'), arguments, and whether it asks."""

    header: str
    arguments: tuple[str, ...] = ()
    query: bool = False


def encode_message(header: str, *arguments: str, query: bool = False) -> bytes:
    """A line, ending LF.

    >>> encode_message("OUTP", "ON"), encode_message("MEAS:VOLT", query=True)
    (b'OUTP ON\\n', b'MEAS:VOLT?\\n')
    """
    text = f"{header}{'?' if query else ''}{' ' + ','.join(arguments) if arguments else ''}"
    if not text.isascii() or not text.isprintable():
        raise ScpiError(f"a line holds printable ASCII only, not {text!r}")
    return text.encode("ascii") + b"\n"


def decode_messages(line: str) -> list[Message]:
    """The messages of one line (without its end), headers from the root.

    >>> decode_messages("MEAS:VOLT?;CURR?;*IDN?")[1]
    Message(header='MEAS:CURR', arguments=(), query=True)
    """
    messages: list[Message] = []
    branch = ""
    for part in filter(None, (part.strip() for part in line.split(";"))):
        head, _, tail = part.partition(" ")
        query, head = head.endswith("?"), head.removesuffix("?")
        if not head.startswith("*"):
            head = head.removeprefix(":") if head.startswith(":") or not branch else f"{branch}:{head}"
            branch = head.rpartition(":")[0]
        arguments = tuple(argument.strip() for argument in tail.split(",")) if tail.strip() else ()
        messages.append(Message(head, arguments, query))
    return messages


def is_header(header: str, form: str) -> bool:
    """Whether a header is a way of writing this form.

    >>> is_header("outp:state", "OUTPut[:STATe]"), is_header("OUTPU", "OUTPut[:STATe]")
    (True, False)
    """
    return _pattern(form).fullmatch(header) is not None


@cache
def _pattern(form: str) -> re.Pattern[str]:
    def written(part: str) -> str:
        if part in "[]:":
            return {"[": "(?:", "]": ")?", ":": ":"}[part]
        short = "".join(letter for letter in part if not letter.islower())
        return f"(?:{re.escape(short)}|{re.escape(part)})"

    return re.compile("".join(map(written, _PART.findall(form))), re.IGNORECASE)


def number(text: str) -> float:
    """A decimal number. Raises ScpiError for text that is none, or is not finite."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    # 9.91E37 stands for 'not a number', 9.9E37 for infinity (SCPI-99 volume 1, 7.2.1).
    if not isfinite(value) or abs(value) > 9.8e37:
        raise ScpiError(f"'{text}' is no number")
    return value


def boolean(text: str) -> bool:
    """0, 1, OFF or ON. Raises ScpiError for anything else.

    >>> boolean("1"), boolean("off")
    (True, False)
    """
    known = {"0": False, "1": True, "OFF": False, "ON": True}
    if text.strip().upper() not in known:
        raise ScpiError(f"'{text}' is neither 0, 1, OFF nor ON")
    return known[text.strip().upper()]


def error_of(text: str) -> tuple[int, str]:
    """Number and words of an answer to SYST:ERR?. Raises ScpiError for text that is none.

    >>> error_of('-222,"Data out of range"')
    (-222, 'Data out of range')
    """
    found = _ERROR.fullmatch(text)
    if found is None:
        raise ScpiError(f"'{text}' is no entry of an error queue, like 0,\"No error\"")
    return int(found[1]), found[2].replace('""', '"')


def encode_answer(texts: Sequence[str]) -> bytes:
    """The answers to the queries of one line, ending LF."""
    return ";".join(texts).encode("ascii", "replace") + b"\n"
