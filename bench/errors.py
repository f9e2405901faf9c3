"""What can go wrong, as the user sees it: exit code, place, what is allowed, what to do next (law 12)."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes of every command."""

    PASSED = 0
    FAILED = 1
    USER_MISTAKE = 2
    BENCH_FAILED = 3
    INTERRUPTED = 130


@dataclass(frozen=True, order=True)
class Mark:
    """A place in a file; line and column count from 1."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


@dataclass(frozen=True, order=True)
class Problem:
    """One mistake at one place."""

    mark: Mark
    message: str

    def __str__(self) -> str:
        return f"{self.mark}: {self.message}"


class FogbenchError(Exception):
    """Base of what fogbench reports as one paragraph instead of a traceback."""

    exit_code = ExitCode.BENCH_FAILED


class UserMistake(FogbenchError):
    """Something the user wrote or asked for cannot be done; nothing was touched."""

    exit_code = ExitCode.USER_MISTAKE


class InvalidFiles(UserMistake):
    """All mistakes found in procedure and bench files, in file order."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = sorted(set(problems))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class BenchFailure(FogbenchError):
    """An instrument or the host failed while the bench was in use."""


class Interrupted(FogbenchError):
    """Ctrl-C or SIGTERM: the run ends in order, safe, with what was measured kept."""

    exit_code = ExitCode.INTERRUPTED


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """' Allowed: a, b. Did you mean a?' for an unknown `word`.

    >>> did_you_mean("bnd", ["for", "band"])
    ' Allowed: band, for. Did you mean band?'
    """
    names = sorted(allowed)
    hint = f" Allowed: {', '.join(names)}." if names else ""
    near = difflib.get_close_matches(word, names, n=1)
    return f"{hint} Did you mean {near[0]}?" if near else hint
