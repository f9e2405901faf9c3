"""Acutronic ACUTROL command language (ACL), both roles: command lines and the answers to them.

Grammar and keywords are what three open clients show (protocol notes, rate tables, section 1); the wording of error
answers is not public, so `ERROR ...` here is ours and a receiver must not rely on it.

A line is one or more commands joined by ';'. A command is `:Main:Sub arg,arg`; case is ignored, keywords may be
shortened as far as they stay unambiguous, and a command after ';' without a leading ':' continues in the branch of the
one before. An answer is a text line; over TCP it may be preceded by a 32-bit error word and a 32-bit text length (byte
order open).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

KEYWORDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "Interlock": ("Close", "Open", "Reset"),
        "Mode": ("Off", "Position", "Rate", "Synthesis"),
        "Demand": ("Acceleration", "Oscillator", "Position", "Rate"),
        "Read": ("Acceleration", "Position", "Rate"),
        "Limit": ("Acceleration", "Rate"),
        "Utility": ("Lockout",),
    }
)
COMMON = ("*IDN", "*STB")
TERMINATORS: Mapping[str, bytes] = MappingProxyType({"lf": b"\n", "crlf": b"\r\n"})
# Longer than any line seen; what is longer is no ACL.
MAX_LINE = 1024

_PREFIX_BYTES = 8


class AclError(ValueError):
    """A line that is no ACL: unknown or ambiguous keyword, bytes that are no text, or no end."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command with its keywords in full: ('Demand', 'Rate'), ('Mode',), ('*IDN',)."""

    path: tuple[str, ...]
    arguments: tuple[str, ...] = ()
    query: bool = False


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer line; `error` is the error word of a prefixed answer, None for plain text."""

    text: str
    error: int | None = None

    @property
    def fields(self) -> list[str]:
        """Answers to the joined queries of one line, in their order."""
        return [field.strip() for field in self.text.split(";")]


def encode_commands(commands: Iterable[Command], terminator: Literal["lf", "crlf"] = "crlf") -> bytes:
    """One line that carries the commands, each written from the root.

    >>> encode_commands([Command(("Demand", "Rate"), ("1", "20.0"))])
    b':Demand:Rate 1,20.0\\r\\n'
    """
    text = ";".join(spell(command) for command in commands)
    if not text.isascii() or not text.isprintable():
        raise AclError(f"a command line holds printable ASCII only, not {text!r}")
    return text.encode("ascii") + TERMINATORS[terminator]


def spell(command: Command) -> str:
    """A command as text, keywords in full."""
    stem = command.path[0] if command.path[0].startswith("*") else ":" + ":".join(command.path)
    arguments = " " + ",".join(command.arguments) if command.arguments else ""
    return f"{stem}{'?' if command.query else ''}{arguments}"


def decode_commands(line: str) -> list[Command]:
    """The commands of one line (without its end). Raises AclError naming the keyword it does not know.

    >>> decode_commands(":read:pos? 1;r? 1")[1]
    Command(path=('Read', 'Rate'), arguments=('1',), query=True)
    """
    commands: list[Command] = []
    branch: tuple[str, ...] = ()
    for part in filter(None, (part.strip() for part in line.split(";"))):
        command = _decode_command(part, branch)
        if not command.path[0].startswith("*"):
            branch = command.path[:-1]
        commands.append(command)
    return commands


def _decode_command(part: str, branch: tuple[str, ...]) -> Command:
    head, _, tail = part.partition(" ")
    query = head.endswith("?")
    head = head.removesuffix("?")
    arguments = tuple(argument.strip() for argument in tail.split(",")) if tail.strip() else ()
    if head.startswith("*"):
        return Command((_match(head, COMMON, "the line"),), arguments, query)
    path = () if head.startswith(":") else branch
    for keyword in head.removeprefix(":").split(":"):
        path = (*path, _match(keyword, _known_below(path), ":" + ":".join(path)))
    return Command(path, arguments, query or path[0] == "Read")


def _known_below(path: tuple[str, ...]) -> Sequence[str]:
    if not path:
        return tuple(KEYWORDS)
    return KEYWORDS[path[0]] if len(path) == 1 else ()


def _match(keyword: str, known: Sequence[str], where: str) -> str:
    found = [name for name in known if keyword and name.lower().startswith(keyword.lower())]
    if len(found) == 1:
        return found[0]
    problem = "ambiguous" if found else "unknown"
    raise AclError(f"{problem} keyword '{keyword}' in {where}; known are {', '.join(found or known) or 'none'}")


def encode_answer(answer: Answer, prefixed: bool = False) -> bytes:
    """An answer line, ending CR LF; `prefixed` puts error word and text length before it, big-endian."""
    text = answer.text.encode("ascii") + b"\r\n"
    if not prefixed:
        return text
    return (answer.error or 0).to_bytes(4, "big", signed=True) + len(text).to_bytes(4, "big") + text


class LineParser:
    """Command lines out of a stream of bytes, as an instrument receives them; LF or CR LF ends a line."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """All lines complete by now. Bytes that are no text become '?'; a line without end is dropped at `MAX_LINE`."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest if len(rest) <= MAX_LINE else b""
        return ["".join(chr(byte) if 32 <= byte < 127 else "?" for byte in line.rstrip(b"\r")) for line in lines]


class AnswerParser:
    """Answers out of a stream of bytes, plain or prefixed, as a client receives them."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Answer]:
        """All answers complete by now. Raises AclError for bytes that can be no answer, and forgets them."""
        self._rest += data
        answers = []
        try:
            while (found := self._next(self._rest)) is not None:
                answer, length = found
                answers.append(answer)
                self._rest = self._rest[length:]
        except AclError:
            self._rest = b""
            raise
        return answers

    def _next(self, data: bytes) -> tuple[Answer, int] | None:
        # A 32-bit error word holds a byte 00 or, if negative, one above 7F; text holds neither.
        if any(byte == 0 or byte > 0x7F for byte in data[:4]):
            return _prefixed(data)
        line, end, _ = data.partition(b"\n")
        if not end:
            if len(data) > MAX_LINE:
                raise AclError(f"no end of line within {MAX_LINE} bytes")
            return None
        return Answer(_text(line)), len(line) + 1


def _prefixed(data: bytes) -> tuple[Answer, int] | None:
    if len(data) < _PREFIX_BYTES:
        return None
    # The longest text allowed is shorter than 64 Ki, so that at most one byte order makes sense of a length above 0.
    for order in ("big", "little"):
        length = int.from_bytes(data[4:_PREFIX_BYTES], order)
        if length <= MAX_LINE:
            break
    else:
        raise AclError("neither a line of text nor an answer with error word and length")
    end = _PREFIX_BYTES + length
    if len(data) < end:
        return None
    return Answer(_text(data[_PREFIX_BYTES:end]), int.from_bytes(data[:4], order, signed=True)), end


def _text(line: bytes) -> str:
    text = line.strip(b"\r\n \0")
    if not all(32 <= byte < 127 or byte == 9 for byte in text):
        raise AclError("a line holding bytes that are no text")
    return text.decode("ascii")
