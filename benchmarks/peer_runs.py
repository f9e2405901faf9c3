"""Runs one peer's script in a process of its own and judges what it predicted."""

import json
import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
REASON_LENGTH = 150


@dataclass(frozen=True)
class DataSets:
    """Several campaigns, already split; rates in deg/s, inputs [temperature in degC, rate as the gyro gave it]."""

    train_inputs: Array  # (sets, n, 2)
    train_rate_dps: Array  # (sets, n)
    test_inputs: Array  # (sets, m, 2)
    test_rate_dps: Array  # (sets, m); never handed over

    def hand_over(self, path: Path) -> None:
        """Write all but the answers."""
        np.savez(
            path,
            train_inputs=self.train_inputs,
            train_rate_dps=self.train_rate_dps,
            test_inputs=self.test_inputs,
        )


@dataclass(frozen=True)
class Outcome:
    """Of the sets that were finished, in order: fit time in s, largest error and std in deg/s, each (finished,)."""

    version: str
    fit_s: Array
    largest_dps: Array
    std_dps: Array
    trouble: str | None = None


def run(command: Sequence[str | Path], folder: Path, data: DataSets, sets: int, limit_s: float) -> Outcome:
    """Run PYTHON SCRIPT METHOD (`peer_scripts/handover.py`) on the first sets; never raises for what a peer does.

    folder: for its files. limit_s: for everything, loading included; what it finished by then counts.
    """
    handed, results, complaints = folder / "data.npz", folder / "results.jsonl", folder / "stderr.txt"
    data.hand_over(handed)
    results.unlink(missing_ok=True)
    trouble = _execute([*map(str, command), str(handed), str(results), str(sets)], complaints, limit_s)
    return _judge(results, data, sets, trouble)


def _execute(command: list[str], complaints: Path, limit_s: float) -> str | None:
    """What went wrong, in one line."""
    try:
        process = _started(command, complaints)
    except OSError as problem:
        return f"could not be started: {problem}"[:REASON_LENGTH]
    try:
        status = process.wait(limit_s)
    except subprocess.TimeoutExpired:
        return f"stopped after {limit_s:g} s"
    finally:
        _end(process)
    if not status:
        return None
    return f"ended with status {status}: {last_line(complaints)}" if status > 0 else f"died of signal {-status}"


def _started(command: list[str], complaints: Path) -> subprocess.Popen[bytes]:
    """In a process group of its own, so that a peer's helpers end with it."""
    with complaints.open("wb") as stderr:
        return subprocess.Popen(
            command,
            # Some leave files where they are started.
            cwd=complaints.parent,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            env=os.environ | ONE_THREAD,
            start_new_session=True,
        )


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()


def last_line(path: Path, prefix: str = "") -> str:
    """The last line with something on it that starts with the prefix, shortened; else the last line of all."""
    lines = [line.strip() for line in path.read_text(errors="replace").splitlines() if line.strip()]
    found = [line for line in lines if line.startswith(prefix)] or lines or ["it said nothing"]
    return found[-1][:REASON_LENGTH]


def _judge(results: Path, data: DataSets, sets: int, trouble: str | None) -> Outcome:
    lines = results.read_text(encoding="utf-8", errors="replace").split("\n") if results.exists() else []
    versions, fit_s, errors = [], [], []
    for text, truth in zip(lines[:-1], data.test_rate_dps, strict=False):  # the part after the last newline is torn
        try:
            line = json.loads(text)
            error = np.array(line["predicted_dps"], dtype=np.float64) - truth
            if error.shape != truth.shape or not np.isfinite(error).all():
                raise ValueError(f"predicted {np.isfinite(error).sum()} finite rates of {truth.size}")
            versions.append(str(line["version"]))
            fit_s.append(float(line["fit_s"]))
            errors.append(error)
        except (ValueError, KeyError, TypeError) as problem:
            trouble = trouble or f"set {len(errors)} is unusable: {problem}"[:REASON_LENGTH]
            break
    if len(errors) < sets and trouble is None:
        trouble = "ended without the rest"
    table = np.array(errors).reshape(len(errors), data.test_rate_dps.shape[1])
    version = versions[0] if versions else "-"
    largest, std = np.abs(table).max(axis=1, initial=0.0), table.std(axis=1) if errors else np.zeros(0)
    return Outcome(version, np.array(fit_s), largest, std, trouble)
