"""Ways to die, for the trials of `tests.crash`: at a record of the journal, at a kind of record, some time from now.

Each is called in the forked process that is to die, and patches that process alone. SIGKILL and an unhandled SIGALRM
end it on the spot: no handler, no finally, no flush.
"""

import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bench import control, journal, steps
from bench.errors import BenchFailure
from bench.procedure.conditions import Guard
from bench.watches import Trip, Watches
from drivers.chambers.watlow_f4 import WatlowF4
from drivers.errors import NoReply

Kill = Callable[[], None]
Watch = Callable[[journal.Journal, str], None]

BENCH = Path(journal.__file__).parent
_RECORDED = re.compile(r"\.append\(\s*\"([a-z_]+)\",")
# Says in the results folder at which kind of record a process was killed.
KILLED_AT = "killed_at"


def kinds() -> list[str]:
    """Every kind of record that the sources write into a journal."""
    texts = (path.read_text(encoding="utf-8") for path in sorted(BENCH.rglob("*.py")))
    return sorted({kind for text in texts for kind in _RECORDED.findall(text)})


def at_record(number: int, torn: bool) -> Kill:
    """Die when record `number` of this attempt is written; `torn` leaves half of it on the disk."""

    def arrange() -> None:
        count = 0

        def watch(writer: journal.Journal, kind: str) -> None:
            nonlocal count
            count += 1
            if count >= number:
                _die(writer, kind, torn)

        _watch_appends(watch)

    return arrange


def at_kind(kind: str, torn: bool) -> Kill:
    """Die when the first record of this kind is written; what does not happen by itself is provoked."""

    def arrange() -> None:
        provoke = _PROVOKED.get(kind)

        def watch(writer: journal.Journal, written: str) -> None:
            if written == kind:
                _die(writer, kind, torn)
            if provoke:
                provoke(writer, written)

        if kind in _FORCED:
            _FORCED[kind]()
        control.PERIOD_S = 0.001
        _watch_appends(watch)

    return arrange


def after(seconds: float) -> Kill:
    """Die some wall time from now, wherever that is: nobody handles SIGALRM, so it ends the process on the spot."""
    return lambda: signal.setitimer(signal.ITIMER_REAL, seconds) and None


def _watch_appends(watch: Watch) -> None:
    whole = journal.Journal.append

    def append(self: journal.Journal, kind: str, t_s: float, **fields: Any) -> None:
        whole(self, kind, t_s, **fields)
        watch(self, kind)

    journal.Journal.append = append  # type: ignore[method-assign]


def _die(writer: journal.Journal, kind: str, torn: bool) -> None:
    if torn:
        os.ftruncate(writer._file.fileno(), writer._file.tell() - 7)
    (_run_folder(writer).parent / KILLED_AT).write_text(kind, encoding="utf-8")
    os.kill(os.getpid(), signal.SIGKILL)


def _run_folder(writer: journal.Journal) -> Path:
    """The run of a journal; while it is created its folder has another name."""
    folder = Path(str(writer._file.name)).parent
    return folder.with_name(folder.name.removeprefix(".").removesuffix(".new"))


def _asking(when: str, what: control.Ask) -> Watch:
    """Ask for something from outside when a record of kind `when` is written."""

    def provoke(writer: journal.Journal, written: str) -> None:
        if written == when:
            control.ask(_run_folder(writer), what)

    return provoke


def _pausing(writer: journal.Journal, written: str) -> None:
    _asking("step", "pause")(writer, written)
    _asking("paused", "continue")(writer, written)


def _trip(action: str, dut: str | None) -> Kill:
    """Let a guard trip once, some checks from now."""
    about = {"name": "provoked", "watch": "dut_temperature", "inside": {"from": "0 degC", "to": "1 degC"}}
    guard = Guard.model_validate({**about, "action": action, "clear_for": "1 s"})

    def force() -> None:
        checks = 0

        def tripped(self: Watches, engine: Any) -> Iterator[Trip]:
            nonlocal checks
            checks += 1
            if checks == 5:
                yield guard, dut, "provoked"

        Watches.tripped = tripped  # type: ignore[method-assign]

    return force


def _fail_to_dwell() -> None:
    def fail(engine: Any, step: Any) -> None:
        raise BenchFailure("provoked")

    steps.STEPS["dwell"] = fail


def _lose_the_chamber() -> None:
    whole, asked = WatlowF4.temperature_degc, 0

    def silent(self: WatlowF4) -> str:
        raise NoReply("the chamber", "anything", 1.0, 3)

    def soon_silent(self: WatlowF4) -> float:
        nonlocal asked
        asked += 1
        if asked < 5:
            return whole(self)
        WatlowF4.identify = silent  # type: ignore[method-assign]
        raise NoReply("the chamber", "its temperature", 1.0, 3)

    WatlowF4.temperature_degc = soon_silent  # type: ignore[method-assign]


_PROVOKED: dict[str, Watch] = {"paused": _pausing, "continued": _pausing, "interrupted": _asking("step", "abort")}
_FORCED: dict[str, Kill] = {
    **dict.fromkeys(("guard", "held", "clear"), _trip("hold", None)),
    "dropped": _trip("drop", "FOG-A01"),
    "error": _fail_to_dwell,
    "link": _lose_the_chamber,
}
