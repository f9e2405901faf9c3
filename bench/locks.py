"""One process per run and per real port: locks that die with their holder, and say who it is."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from bench.clock import utc_now
from bench.errors import UserMistake

PORT_LOCKS = "fogbench-ports"


@contextmanager
def run_lock(folder: Path) -> Iterator[None]:
    """Hold a run. Raises UserMistake naming the process that does."""
    with _held(folder.parent / f".{folder.name}.lock", f"the run '{folder.name}'", folder.name):
        yield


def run_is_held(folder: Path) -> bool:
    """Whether a living process holds the run."""
    path = folder.parent / f".{folder.name}.lock"
    if not path.exists():
        return False
    try:
        with FileLock(path, timeout=0):
            return False
    except Timeout:
        return True


@contextmanager
def port_locks(ports: Iterable[str], run_id: str) -> Iterator[None]:
    """Hold real ports, in a fixed order so that two benches cannot wait for each other. Raises UserMistake."""
    folder = Path(tempfile.gettempdir()) / PORT_LOCKS
    folder.mkdir(mode=0o1777, exist_ok=True)
    with ExitStack() as stack:
        for port in sorted(set(ports)):
            name = hashlib.sha256(port.encode()).hexdigest()[:24]
            stack.enter_context(_held(folder / f"{name}.lock", f"the port {port}", run_id))
        yield


@contextmanager
def _held(path: Path, what: str, run_id: str) -> Iterator[None]:
    lock, holder = FileLock(path, timeout=0), path.with_suffix(".holder")
    try:
        lock.acquire()
    except Timeout:
        raise UserMistake(f"{what} is in use by {_name(holder)}. Wait for it, or end it: fogbench abort RUN") from None
    try:
        holder.write_text(json.dumps({"pid": os.getpid(), "run": run_id, "since": utc_now()}), encoding="utf-8")
        yield
    finally:
        # On a disk that takes no more changes the note stays; the lock is what counts.
        with suppress(OSError):
            holder.unlink(missing_ok=True)
        lock.release()


def _name(holder: Path) -> str:
    """Who holds a lock, as far as it said."""
    try:
        about = json.loads(holder.read_text(encoding="utf-8"))
        return f"process {about['pid']} (run '{about['run']}', since {about['since']})"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "another process"
