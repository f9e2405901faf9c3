"""Kill -9 trials: a campaign killed at a chosen journal record or at a random instant, resumed until it ends, examined.

`python3 do.py crash` runs many and prints a tally; the tests run a few. Each attempt is a forked process. On a virtual
bench the world dies with it; live simulators go on, and their truth log says whether every end was safe.
"""

import argparse
import os
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bench import journal
from bench.errors import FogbenchError
from bench.journal import load_journal
from bench.points import finished_rows
from bench.resume import prepare_resume
from bench.run import Prepared, RunRequest, prepare, run
from bench.verify.verify import verify
from tests import crash_live
from tests.crash_kills import KILLED_AT, Kill, after, at_kind, at_record, kinds
from tests.crash_live import LiveSimulators

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
        - soak: {for: 5 min, until: {slope: 1e-9 degC/min, over: 5 min}, timeout: 10 min, on_timeout: continue}
        - sweep:
            rate: [-50 deg/s, 0 deg/s, 50 deg/s]
            steps:
              - settle: {band: 0.02 deg/s, for: 0.5 s}
              - acquire: {count: 20, every: 0.5 s}
  - go_to_position: 0 deg
  - record: {name: drift, every: 1 s, steps: [dwell: 1 min]}
analysis: {models: [linear], splits: {random: {train: 4}, leave_temperatures_out: {folds: 2}}}
"""
POINTS, DUTS = 6, 2
# A live bench that was killed in a bad moment may need another start; an attempt costs some seconds of the wall.
LAST_TRIES = 4


@dataclass(frozen=True)
class Setting:
    """What is run in a trial, and on what; `ended_unsafe` judges the bench after the process has gone."""

    bench: Path
    procedure: str = PROCEDURE
    rows: int = POINTS * DUTS
    ended_unsafe: Callable[[Path, bool], bool] = lambda run_folder, killed: False


VIRTUAL = Setting(ROOT / "benches" / "virtual.yaml")
# Only a bench with a supply can switch its DUTs off.
POWERED = Setting(
    ROOT / "benches" / "virtual_metrics.yaml",
    PROCEDURE.replace("  - note: begin\n", "  - note: begin\n  - power: off\n  - dwell: 1 min\n  - power: on\n"),
)


@dataclass
class Tally:
    """What the trials found; every count but `kills`, `live_kills` and `by_kind` must be 0."""

    kills: int = 0
    live_kills: int = 0
    points_lost: int = 0
    points_twice: int = 0
    refused: int = 0
    unsafe: int = 0
    unfinished: int = 0
    unverified: int = 0
    by_kind: Counter[str] = field(default_factory=Counter)

    @property
    def clean(self) -> bool:
        """Whether nothing was lost, doubled, refused, left unsafe or unfinished, or does not match its raw files."""
        found = (self.points_lost, self.points_twice, self.refused, self.unsafe, self.unfinished, self.unverified)
        return not any(found)

    def __str__(self) -> str:
        by_kind = ", ".join(f"{kind} {count}" for kind, count in sorted(self.by_kind.items()))
        return (
            f"kills {self.kills}: {self.kills - self.live_kills} on the virtual bench, {self.live_kills} on live "
            f"simulators\npoints lost {self.points_lost}, points measured twice {self.points_twice}, journals refused "
            f"{self.refused}, unsafe ends {self.unsafe}, runs not brought to their end {self.unfinished}, runs that "
            f"fail verify {self.unverified}\nkilled at: {by_kind}"
        )


def trial(folder: Path, kills: Sequence[Kill], tally: Tally, setting: Setting = VIRTUAL) -> None:
    """One campaign: an attempt for each kill, then it is let live until it ends, then its journal is examined."""
    procedure = folder / "crash.yaml"
    procedure.write_text(setting.procedure, encoding="utf-8")
    request = RunRequest(procedure, setting.bench, folder / "results", "crash")
    run_folder = folder / "results" / "crash"
    finished: set[tuple[int, str]] = set()
    entries: list[journal.Entry] = []
    for number, kill in enumerate([*kills, *[None] * LAST_TRIES]):
        # One is let live in any case: it completes what a run wrote that died after its end.
        if number > len(kills) and _ended_well(entries):
            break
        begun = (run_folder / "journal.jsonl").exists()
        killed = _attempt((lambda: prepare_resume(run_folder)) if begun else (lambda: prepare(request)), kill)
        _count_kill(folder / "results" / KILLED_AT, killed, setting, tally)
        tally.unsafe += setting.ended_unsafe(run_folder, killed)
        if not (run_folder / "journal.jsonl").exists():
            continue
        try:
            entries = load_journal(run_folder / "journal.jsonl")
        except FogbenchError:
            tally.refused += 1
            return
        now = {(row["point"], row["dut"]) for row in finished_rows(entries)}
        tally.points_lost += len(finished - now)
        finished = now
    _examine(run_folder, entries, setting, tally)


def _count_kill(told: Path, killed: bool, setting: Setting, tally: Tally) -> None:
    tally.kills += killed
    tally.live_kills += killed and setting is not VIRTUAL
    if killed:
        tally.by_kind[told.read_text(encoding="utf-8") if told.exists() else "a random instant"] += 1
    told.unlink(missing_ok=True)


def _ended_well(entries: Sequence[journal.Entry]) -> bool:
    """Whether the last attempt came to its end without failure."""
    last = next((entry for entry in reversed(entries) if entry["kind"] in ("end", "resumed")), None)
    return last is not None and last["kind"] == "end" and last["failure"] is None


def _examine(run_folder: Path, entries: Sequence[journal.Entry], setting: Setting, tally: Tally) -> None:
    rows = Counter((row["point"], row["dut"]) for row in finished_rows(entries))
    tally.points_lost += setting.rows - len(rows)
    tally.points_twice += sum(count - 1 for count in rows.values())
    tally.unfinished += not _ended_well(entries)
    tally.unverified += bool(verify(run_folder).wrong)


def _attempt(prepared: Callable[[], Prepared], kill: Kill | None) -> bool:
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


def setting_of(kind: str) -> Setting:
    """A campaign in which records of this kind are written."""
    return POWERED if kind == "power" else VIRTUAL


def kills_of(kind: str, rng: random.Random) -> list[Kill]:
    """The kills of a trial that dies at a record of this kind; a resume has to come first for some."""
    kill = at_kind(kind, torn=rng.random() < 0.5)
    return [at_record(rng.randint(20, 60), torn=False), kill] if kind == "resumed" else [kill]


def at_random(rng: random.Random, records: int, seconds: float) -> list[Kill]:
    """One to four kills, half of them by the clock and half by the journal."""
    by_clock = [rng.random() < 0.5 for _ in range(rng.randint(1, 4))]
    return [
        after(rng.uniform(0.001, seconds)) if clock else at_record(rng.randint(1, records), rng.random() < 0.5)
        for clock in by_clock
    ]


def live_trials(kills: int, rng: random.Random, tally: Tally, show: Callable[[], None] = lambda: None) -> None:
    """Trials against one set of live simulators that goes on through all of them."""
    with tempfile.TemporaryDirectory() as folder, LiveSimulators(Path(folder)) as live:
        rows = crash_live.POINTS * crash_live.DUTS
        setting = Setting(live.bench, crash_live.PROCEDURE, rows, live.ended_unsafe)
        number = 0
        while tally.live_kills < kills:
            number += 1
            inside = Path(folder) / str(number)
            inside.mkdir()
            left = kills - tally.live_kills
            trial(inside, at_random(rng, 45, 8.0)[:left], tally, setting)
            show()


def main() -> int:
    """Print the tally of many trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="of both benches together")
    parser.add_argument("--live", type=int, default=32, help="how many of them on live simulators")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, tally = random.Random(options.seed), Tally()

    def show() -> None:
        print(f"\r{tally.kills} kills", end="", flush=True)

    wanted = kinds()
    while wanted or tally.kills < options.kills - options.live:
        with tempfile.TemporaryDirectory() as folder:
            if wanted:
                kind = wanted.pop()
                trial(Path(folder), kills_of(kind, rng), tally, setting_of(kind))
            else:
                trial(Path(folder), at_random(rng, 110, 0.3), tally)
        show()
    live_trials(options.live, rng, tally, show)
    never = sorted(set(kinds()) - set(tally.by_kind))
    print(f"\r{tally}\nnever killed at: {', '.join(never) or 'none'}")
    return 0 if tally.clean and not never else 1


if __name__ == "__main__":
    sys.exit(main())
