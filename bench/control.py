"""Requests from other processes: pause, continue, abort; a file, read by the run process alone (law 6)."""

from __future__ import annotations

import contextlib
import json
import threading
from pathlib import Path
from typing import Literal

from bench.clock import StopRequest, utc_now
from bench.runfolder import write_json

Ask = Literal["pause", "continue", "abort"]
FILE = "request.json"
# How soon a request is noticed.
PERIOD_S = 0.2


def ask(folder: Path, what: Ask) -> None:
    """Write a request; the newest counts. Raises OSError."""
    write_json(folder / FILE, {"ask": what, "utc": utc_now()})


class Control:
    """Watches for requests beside the run: an abort interrupts whoever waits, a pause is taken between two steps."""

    def __init__(self, folder: Path, stop: StopRequest) -> None:
        self._path = folder / FILE
        self._stop = stop
        self._seen: tuple[int, int] | None = None
        self._closed = threading.Event()
        self.paused = False
        self._path.unlink(missing_ok=True)
        self._thread = threading.Thread(target=self._watch, name="requests", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching and take the last request away."""
        self._closed.set()
        self._thread.join()
        # On a disk that takes no more changes the request stays; the next attempt takes it away.
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _watch(self) -> None:
        while not self._closed.wait(PERIOD_S):
            try:
                status = self._path.stat()
                if (status.st_mtime_ns, status.st_ino) == self._seen:
                    continue
                self._seen = (status.st_mtime_ns, status.st_ino)
                what = json.loads(self._path.read_text(encoding="utf-8"))["ask"]
            except (OSError, ValueError, KeyError, TypeError, RecursionError):
                continue
            self.paused = what == "pause"
            if what == "abort":
                self._stop.ask()
