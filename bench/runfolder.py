"""The run folder: where everything about one run is written, and nothing half."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from bench.errors import UserMistake

# Folders of a run folder with copies of what procedure and bench file refer to.
INCLUDED, DECLARATIONS = "included", "declarations"
RUN_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")


def check_run_id(run_id: str) -> None:
    """Raise UserMistake if `run_id` cannot name a folder."""
    if not RUN_ID.fullmatch(run_id) or run_id.endswith("."):
        raise UserMistake(
            f"--run-id '{run_id}' cannot name a run. Allowed: letters, digits, '.', '_' and '-', starting with a "
            "letter or digit, at most 128 characters. Choose another, or leave it out to get one by itself."
        )


def new_run_folder(results: Path, run_id: str) -> Path:
    """Where run `run_id` will live; it must not exist yet and `results` must be writable. Raises UserMistake."""
    check_run_id(run_id)
    folder = results / run_id
    existing = _nearest(results)
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise UserMistake(
            f"{results}: results cannot be written here ({existing} is not a writable folder). Choose another folder "
            "with --results, or change its permissions. Nothing was started."
        )
    if folder.exists():
        raise UserMistake(
            f"the run '{run_id}' already exists in {results}. A run is never overwritten: choose another --run-id, or "
            f"look at it with: fogbench report {folder}"
        )
    return folder


def _nearest(folder: Path) -> Path:
    """The folder, or the nearest of those above it that can be seen."""
    for path in (folder, *folder.absolute().parents):
        with contextlib.suppress(OSError, ValueError):
            path.lstat()
            return path
    return Path("/")


def find_run(run: str, results: Path) -> Path:
    """The folder of a run given as a folder or a run id. Raises UserMistake."""
    if _holds_a_run(Path(run)):
        return Path(run)
    if RUN_ID.fullmatch(run) and _holds_a_run(results / run):
        return results / run
    known = sorted(path.parent.name for path in results.glob("*/journal.jsonl")) if results.is_dir() else []
    shown = f" Runs in {results}: {', '.join(known[-8:])}." if known else f" There are no runs in {results}."
    raise UserMistake(f"'{run}' is neither a run folder nor a run id.{shown} See: fogbench list")


def _holds_a_run(folder: Path) -> bool:
    try:
        return (folder / "journal.jsonl").is_file()
    except OSError:  # a name too long, a folder that may not be entered
        return False


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, durably. Raises OSError."""
    with atomic_file(path) as file:
        file.write(data)


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write piece by piece that is there whole or not at all, durably. Raises OSError."""
    temporary = path.with_name(path.name + ".tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        sync_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, value: Any) -> None:
    """Write JSON whole or not at all; NaN becomes null. Raises OSError."""
    text = json.dumps(_finite(value), indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(path, text.encode() + b"\n")


def sync_folder(folder: Path) -> None:
    """Make renames in a folder durable."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def copy_into(folder: Path, name: str, source: Path) -> None:
    """Copy a file into the run folder under `name`."""
    target = folder / name
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and value - value != 0.0:
        return None
    return value
