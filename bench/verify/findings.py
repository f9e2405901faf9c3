"""What a verification found: checks, each with its findings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeVar

from bench.errors import ExitCode

Tell = Callable[[str], None]
T = TypeVar("T")
Value = str | int | float | None


@dataclass(frozen=True)
class Finding:
    """One thing that does not match (`wrong`), or that a reader should know and is no damage (`note`)."""

    text: str
    file: str
    point: int | None = None
    dut: str | None = None
    figure: str | None = None
    expected: Value = None
    found: Value = None
    severity: Literal["wrong", "note"] = "wrong"

    def __str__(self) -> str:
        numbers = f": expected {self.expected!r}, found {self.found!r}" if self.figure else ""
        return f"{self.file}: {self.text}{numbers}"


@dataclass(frozen=True)
class Check:
    """One question asked of the run, what was looked at, and what was found."""

    name: str
    summary: str
    findings: Sequence[Finding] = ()

    @property
    def verdict(self) -> Literal["ok", "note", "wrong"]:
        """The worst of the findings."""
        kinds = {finding.severity for finding in self.findings}
        return "wrong" if "wrong" in kinds else "note" if kinds else "ok"


@dataclass(frozen=True)
class Verification:
    """All checks of one run."""

    folder: str
    checks: Sequence[Check]

    @property
    def wrong(self) -> list[Finding]:
        """Everything that does not match."""
        return [finding for check in self.checks for finding in check.findings if finding.severity == "wrong"]

    @property
    def exit_code(self) -> ExitCode:
        """0 if everything matches."""
        return ExitCode.FAILED if self.wrong else ExitCode.PASSED

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "run": self.folder,
            "matches": not self.wrong,
            "exit_code": int(self.exit_code),
            "checks": [
                {
                    "name": check.name,
                    "verdict": check.verdict,
                    "summary": check.summary,
                    "findings": [asdict(finding) for finding in check.findings],
                }
                for check in self.checks
            ],
        }


def attempt(findings: list[Finding], file: str, question: Callable[..., T], *about: Any) -> T | None:
    """Ask a question of a file that may be damaged in any way; None, and a finding, if that fails."""
    try:
        return question(*about)
    except Exception as error:
        # Damaged files make libraries raise nearly anything; not one of them may end the verification.
        findings.append(Finding(f"cannot be used: {' '.join(str(error).split())[:300] or type(error).__name__}", file))
    return None


def collect(findings: list[Finding], file: str, questions: Callable[..., Iterable[Finding]], *about: Any) -> None:
    """Add what questions find in a file, up to the one that cannot be asked, which is a finding too."""

    def ask() -> None:
        for finding in questions(*about):
            findings.append(finding)

    attempt(findings, file, ask)
