"""The guardian: a small process that outlives the run process of a real bench and makes the bench safe in its place.

The runner sends it a beat down a pipe whenever it waits. When the pipe breaks (the runner died) or stays silent for too
long (it hangs, and is killed first), the guardian takes the ports of table and chamber, and of a supply that is to be
switched off, brings them to their declared safe states, and tries again until that worked; an instrument that is not
the one the run began with is not commanded. What it did is in guardian.json of the run folder.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from bench.benchfile import Bench, load_bench
from bench.clock import WallClock, utc_now
from bench.engine import Engine
from bench.errors import BenchFailure, InvalidFiles
from bench.journal import MemoryLog, load_journal
from bench.opening import open_commanded
from bench.overrides import editor, parse_overrides
from bench.runfolder import DECLARATIONS, write_json
from bench.safe import make_safe

FILE, LOG = "guardian.json", "guardian.log"
# A runner waits in slices of a second and asks an instrument for a few at most; half a minute of silence is no work.
PATIENCE_S = 30.0
PATIENCE_VARIABLE = "FOGBENCH_GUARDIAN_PATIENCE_S"
# How long the guardian goes on trying, and how often.
PERSISTENCE_S, RETRY_S = 900.0, 2.0
READY, BEAT, DISMISS = b"ready\n", b".", b"q"


class Guardian:
    """The runner's side: starts the process, keeps it informed, dismisses it."""

    def __init__(self, folder: Path) -> None:
        """Start it and wait until it is ready. Raises BenchFailure if it does not start."""
        patience_s = float(os.environ.get(PATIENCE_VARIABLE, PATIENCE_S))
        with (folder / LOG).open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "bench.guardian", str(folder), str(os.getpid()), str(patience_s)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                # A Ctrl-C or a closed terminal is for the runner.
                start_new_session=True,
            )
        assert self._process.stdin and self._process.stdout
        self._pipe = self._process.stdin.fileno()
        if self._process.stdout.readline() != READY:
            raise BenchFailure(f"the guardian process did not start; {folder / LOG} says why. Nothing was started.")

    def beat(self) -> None:
        """Say that the runner is alive."""
        self._say(BEAT)

    def dismiss(self) -> None:
        """The bench is safe; the guardian may go."""
        self._say(DISMISS)
        self._process.wait()

    def leave(self) -> None:
        """The runner could not make the bench safe: the guardian shall go on trying when it has gone."""
        assert self._process.stdin
        self._process.stdin.close()

    def _say(self, word: bytes) -> None:
        try:
            os.write(self._pipe, word)
        except OSError:
            # A guardian that died is found by its absence in the log; the run itself goes on.
            return


def watch(folder: Path, runner: int, patience_s: float) -> None:
    """Be the guardian of a run: returns when dismissed, or when the bench is safe or was tried for long enough."""
    bench, identities = _recorded(folder)
    os.write(sys.stdout.fileno(), READY)
    why = _wait_for_trouble(runner, patience_s)
    if why:
        _take_over(folder, bench, identities, why)


def _wait_for_trouble(runner: int, patience_s: float) -> str | None:
    """Why the runner needs to be replaced; None when it dismissed us."""
    pipe = sys.stdin.fileno()
    while True:
        heard, _, _ = select.select([pipe], [], [], patience_s)
        if not heard:
            os.kill(runner, signal.SIGKILL)
            return f"the run process gave no sign of life for {patience_s:g} s and was killed"
        words = os.read(pipe, 4096)
        if DISMISS in words:
            return None
        if not words:
            return "the run process died"


def _take_over(folder: Path, bench: Bench, identities: Mapping[str, str], why: str) -> None:
    clock, log = WallClock(), MemoryLog()
    tries, failures = 0, ["not tried"]
    while failures and clock.now() < PERSISTENCE_S:
        tries += 1
        log.entries.clear()
        station, failures = open_commanded(bench, clock, identities)
        # The engine only carries what making safe needs: no step is run here.
        engine = Engine({}, bench, station, clock, log, cast(Any, None))
        failures += make_safe(engine)
        station.close()
        about = {"why": why, "utc": utc_now(), "tries": tries, "took_s": round(clock.now(), 2), "failures": failures}
        # A disk that takes nothing must not end the tries: the bench comes first, its record second.
        with contextlib.suppress(OSError):
            write_json(folder / FILE, {**about, "done": [entry["text"] for entry in log.entries]})
        if failures:
            clock.wait(RETRY_S)


def _recorded(folder: Path) -> tuple[Bench, dict[str, str]]:
    """The bench of a run from the copies in its folder, and who its instruments said that they are when it began.

    Raises InvalidFiles.
    """
    entries = load_journal(folder / "journal.jsonl")
    overrides = parse_overrides(entries[0].get("overrides", []))
    bench, problems = load_bench(folder / "bench.yaml", editor(overrides, "bench"), folder / DECLARATIONS)
    if bench is None:
        raise InvalidFiles(problems)
    identities: dict[str, str] = {}
    for entry in entries:
        if entry["kind"] == "identities":
            identities |= entry["found"]
    return bench, identities


if __name__ == "__main__":
    watch(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
