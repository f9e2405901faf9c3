"""Our models beside other people's packages, on the same data in the same run, each in a process of its own.

    python3 do.py bench peers                      # ours, scikit-learn, scipy, and the peers installed before
    python3 do.py bench peers --install            # first install the others, each into an environment in .venv-peers
    python3 do.py bench peers --install pyfume     # only that one (xanfis brings torch: up to some gigabytes)
    python3 do.py bench peers --seeds 3 --limit 60

Data: error surface A on the 684-point grid of reference experiment `ts` with the white noise of a 1 deg/h gyro
averaged over a point, 470 rows to fit and 214 to judge, drawn at random for each seed.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import peer_environments
from benchmarks.peer_runs import DataSets, Outcome, run

SCRIPTS = Path(__file__).resolve().parent / "peer_scripts"
TRAINING_ROWS = 470
LIMIT_S = 120.0


@dataclass(frozen=True)
class Peer:
    """A row of the table. environment: None beside us; sets: at most so many, for the slow ones."""

    label: str
    script: str
    method: str
    environment: str | None = None
    sets: int = 10

    @property
    def python(self) -> Path:
        return Path(sys.executable) if self.environment is None else peer_environments.python_of(self.environment)


REFERENCE = Peer("T-S joint, 6 rules", "ours", "joint 6")
PEERS = (
    REFERENCE,
    Peer("T-S joint, 4 rules", "ours", "joint 4"),
    Peer("T-S published, 4 rules", "ours", "published 4"),
    Peer("LS-SVM, exact leave-one-out", "ours", "ls-svm"),
    Peer("SVR, default", "scikit", "svr"),
    Peer("SVR, 4 x 4 grid, 3 folds", "scikit", "tuned svr", sets=3),
    Peer("MLPRegressor(10), lbfgs", "scikit", "network"),
    Peer("Gaussian process, ARD", "scikit", "gaussian process"),
    Peer("RBFInterpolator, quintic", "spline", "quintic"),
    Peer("LS-SVM", "neo_svm", "dual", "neo-ls-svm"),
    Peer("ANFIS, 16 rules", "toolbox_rules", "16 rules", "anfis-toolbox"),
    Peer("ANFIS, 4 rules", "xanfis_rules", "4 rules", "xanfis"),
    Peer("ANFIS, 12 rules", "xanfis_rules", "12 rules", "xanfis"),
    Peer("T-S, 4 rules", "pyfume_rules", "4 rules", "pyfume"),
    Peer("T-S, 8 rules", "pyfume_rules", "8 rules", "pyfume"),
)
# What a script's version belongs to.
PACKAGES = {"ours": "fogbench", "scikit": "scikit-learn", "spline": "scipy"}


def data_sets(seeds: int) -> DataSets:
    """The campaigns of seeds 0, 1 ...: the same noise and the same splits as in `benchmarks.fitting`."""
    from benchmarks.fitting import campaign  # brings scikit-learn along

    parts = []
    for seed in range(seeds):
        inputs, rate, _ = campaign(seed, False)
        order = np.random.default_rng(1000 + seed).permutation(len(rate))
        train, test = order[:TRAINING_ROWS], order[TRAINING_ROWS:]
        parts.append((inputs[train], rate[train], inputs[test], rate[test]))
    return DataSets(*(np.array(part) for part in zip(*parts, strict=True)))


def outcomes(peers: Sequence[Peer], data: DataSets, limit_s: float) -> Iterator[tuple[Peer, Outcome]]:
    """Each peer's outcome, in order; what one does costs the others nothing."""
    for peer in peers:
        with TemporaryDirectory() as folder:
            command: list[str | Path] = [peer.python, SCRIPTS / f"{peer.script}.py", peer.method]
            yield peer, run(command, Path(folder), data, min(peer.sets, len(data.train_inputs)), limit_s)


def row(peer: Peer, outcome: Outcome, ours: Outcome | None) -> str:
    """A line of the table; the ratios are medians over the sets that both fitted."""
    package = peer.environment or PACKAGES[peer.script]
    name, n = f"{peer.label:28}{package + ' ' + outcome.version:22}", len(outcome.fit_s)
    if not n:
        return f"{name} {outcome.trouble}"
    figures = "".join(
        f"{np.median(values):10.5f} ({values.max():8.5f})" for values in (outcome.largest_dps, outcome.std_dps)
    )
    ratios = "" if ours is None or not len(ours.fit_s) else _ratios(outcome, ours)
    trouble = f"  {outcome.trouble}" if outcome.trouble else ""
    return f"{name}{n:5}{figures}{1e3 * np.median(outcome.fit_s):11.1f}{ratios}{trouble}"


def _ratios(outcome: Outcome, ours: Outcome) -> str:
    n = min(len(outcome.fit_s), len(ours.fit_s))
    slower, larger, wider = (
        float(np.median(getattr(outcome, field)[:n]) / np.median(getattr(ours, field)[:n]))
        for field in ("fit_s", "largest_dps", "std_dps")
    )
    return f"{slower:9.2f}{larger:9.2f}{wider:9.2f}"


def missing() -> list[str]:
    """Environments that are not installed."""
    return [name for name in peer_environments.REQUIREMENTS if not peer_environments.is_ready(name)]


def any_installed() -> bool:
    """Whether there is more to show than `benchmarks.fitting` shows."""
    return len(missing()) < len(peer_environments.REQUIREMENTS)


def install(names: Sequence[str]) -> dict[str, str]:
    """Install environments; those that failed, and why."""
    failed = {}
    for name in names:
        print(f"installing {name} into {peer_environments.FOLDER.name} ...", file=sys.stderr, flush=True)
        problem = peer_environments.install(name)
        if problem is not None:
            failed[name] = problem
    return failed


def print_table(seeds: int, limit_s: float, failed: dict[str, str]) -> None:
    print(f"surface A, {TRAINING_ROWS} rows to fit, seeds 0 to {seeds - 1}: median (worst) in deg/s")
    print("fit: processor time on one thread, best of 3 if quick; x: times that of T-S joint, 6 rules")
    titles = f"{'max':>21}{'std':>21}{'fit ms':>11}{'x fit':>9}{'x max':>9}{'x std':>9}"
    print(f"{'':28}{'package':22}{'sets':>5}{titles}")
    absent = missing()
    present = [peer for peer in PEERS if peer.environment not in absent]
    ours: Outcome | None = None
    for peer, outcome in outcomes(present, data_sets(seeds), limit_s):
        ours = outcome if peer is REFERENCE else ours
        print(row(peer, outcome, ours), flush=True)
    for name in absent:
        why = f"does not install: {failed[name]}" if name in failed else f"not installed (bench peers --install {name})"
        print(f"{'':28}{name:22} {why}")


def arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser("do.py bench peers", description=__doc__.splitlines()[0] if __doc__ else None)
    names = ", ".join(peer_environments.REQUIREMENTS)
    parser.add_argument("--install", nargs="*", metavar="NAME", help=f"install these first, or all: {names}")
    parser.add_argument("--seeds", type=int, default=10, help="data sets, 1 or more (default 10)")
    parser.add_argument("--limit", type=float, default=LIMIT_S, help=f"seconds for each row (default {LIMIT_S:g})")
    given = parser.parse_args(argv)
    unknown = [name for name in given.install or () if name not in peer_environments.REQUIREMENTS]
    if unknown:
        parser.error(f"unknown peer {unknown[0]}. Allowed: {names}")
    if given.seeds < 1 or given.limit <= 0.0:
        parser.error("--seeds must be 1 or more, --limit above 0")
    return given


def main(argv: Sequence[str] = ()) -> None:
    """Install what is asked for, then print the table."""
    given = arguments(argv)
    wanted = list(peer_environments.REQUIREMENTS) if given.install == [] else given.install or []
    print_table(given.seeds, given.limit, install(wanted))
