"""Kill -9 trials: a campaign killed at a chosen journal record or at a random instant, resumed until it ends, examined.

`python3 do.py crash` runs many and prints a tally; the tests run a few. Each attempt is a forked process that dies with
os._exit or SIGKILL: no handler, no finally, no flush.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from bench import journal
from bench.errors import FogbenchError
from bench.journal import load_journal
from bench.points import finished_rows
from bench.resume import prepare_resume
from bench.run import Prepared, RunRequest, prepare, run
from bench.verify.verify import verify

ROOT = Path(__file__).resolve().parents[1]

# A campaign in which everything happens that the journal knows, in a second of wall time.
PROCEDURE = """\
procedure: crash
raw: samples
quality: {slope: 50 degC/min}
steps:
  - note: begin
  - sweep:
      temperature: [20 degC, 30 degC]
      steps:
        - soak: 10 min
        - sweep:
            rate: [-50 deg/s, 0 deg/s, 50 deg/s]
            steps:
              - settle: {band: 0.02 deg/s, for: 0.5 s}
              - acquire: {count: 20, every: 0.5 s}
  - go_to_position: 0 deg
  - dwell: 1 min
analysis: {models: [linear], splits: {random: {train: 4}, leave_temperatures_out: {folds: 2}}}
"""
POINTS, DUTS = 6, 2


@dataclass
class Tally:
    """What the trials found; every count but `kills` and `by_kind` must be 0."""

    kills: int = 0
    points_lost: int = 0
    points_twice: int = 0
    refused: int = 0
    unfinished: int = 0
    unverified: int = 0
    by_kind: Counter[str] = field(default_factory=Counter)

    @property
    def clean(self) -> bool:
        """Whether nothing was lost, doubled, refused, left unfinished or does not match its own raw files."""
        return not (self.points_lost or self.points_twice or self.refused or self.unfinished or self.unverified)

    def __str__(self) -> str:
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(self.by_kind.items()))
        return (
            f"kills {self.kills}; points lost {self.points_lost}, points measured twice {self.points_twice}, "
            f"journals refused {self.refused}, runs not brought to their end {self.unfinished}, "
            f"runs that fail verify {self.unverified}\nkilled at: {kinds}"
        )


def trial(folder: Path, kills: list[Callable[[], None]], tally: Tally) -> None:
    """One campaign: an attempt for each kill, then one that is let live, then the examination of its journal."""
    procedure = folder / "crash.yaml"
    procedure.write_text(PROCEDURE, encoding="utf-8")
    request = RunRequest(procedure, ROOT / "benches" / "virtual.yaml", folder / "results", "crash")
    run_folder = folder / "results" / "crash"
    finished: set[tuple[int, str]] = set()
    entries: list[journal.Entry] = []
    for kill in [*kills, None]:
        begun = (run_folder / "journal.jsonl").exists()
        killed = _attempt((lambda: prepare_resume(run_folder)) if begun else (lambda: prepare(request)), kill)
        tally.kills += killed
        if not (run_folder / "journal.jsonl").exists():
            continue
        try:
            entries = load_journal(run_folder / "journal.jsonl")
        except FogbenchError:
            tally.refused += 1
            return
        tally.by_kind[entries[-1]["kind"]] += killed
        now = {(row["point"], row["dut"]) for row in finished_rows(entries)}
        tally.points_lost += len(finished - now)
        finished = now
    rows = Counter((row["point"], row["dut"]) for row in finished_rows(entries))
    tally.points_lost += POINTS * DUTS - len(rows)
    tally.points_twice += sum(count - 1 for count in rows.values())
    end = [entry for entry in entries if entry["kind"] == "end"]
    tally.unfinished += not end or end[-1]["failure"] is not None
    tally.unverified += bool(verify(run_folder).wrong)


def _attempt(prepared: Callable[[], Prepared], kill: Callable[[], None] | None) -> bool:
    """Run in a forked process in which `kill` arranges the death; whether it died of it."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        try:
            ready = prepared()
            if kill is not None:
                kill()
            run(ready)
        except BaseException as error:
            if "finished; there is nothing to resume" not in str(error):
                os.write(2, f"{type(error).__name__}: {error}\n".encode())
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def at_record(number: int, torn: bool) -> Callable[[], None]:
    """Die when record `number` of this attempt is to be written; `torn` leaves half of it on the disk."""

    def arrange() -> None:
        whole = journal.Journal.append
        count = 0

        def append(self: journal.Journal, kind: str, t_s: float, **fields: object) -> None:
            nonlocal count
            whole(self, kind, t_s, **fields)
            count += 1
            if count >= number:
                self._file.flush()
                if torn:
                    size = self._file.tell()
                    os.ftruncate(self._file.fileno(), size - 7)
                os.kill(os.getpid(), signal.SIGKILL)

        journal.Journal.append = append  # type: ignore[method-assign]

    return arrange


def after(seconds: float) -> Callable[[], None]:
    """Die some wall time from now, wherever that is: nobody handles SIGALRM, so it ends the process on the spot."""
    return lambda: signal.setitimer(signal.ITIMER_REAL, seconds) and None


def main() -> int:
    """Print the tally of many trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, tally = random.Random(options.seed), Tally()
    while tally.kills < options.kills:
        chosen = [
            after(rng.uniform(0.001, 0.3)) if rng.random() < 0.5 else at_record(rng.randint(1, 110), rng.random() < 0.5)
            for _ in range(rng.randint(1, 4))
        ]
        with tempfile.TemporaryDirectory() as folder:
            trial(Path(folder), chosen, tally)
        print(f"\r{tally.kills} kills", end="", flush=True)
    print(f"\r{tally}")
    return 0 if tally.clean else 1


if __name__ == "__main__":
    sys.exit(main())
