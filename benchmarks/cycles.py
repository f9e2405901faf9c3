"""Thermal-cycle models on the synthetic twins of reference experiments `bp` and `rlg`, and networks on surface A.

    python -m benchmarks.cycles              # from the repository's root; some minutes
    python -m benchmarks.cycles --seeds 3

What is left on data a model has never seen, as a multiple of the white floor (std of a row's white noise): median and
worst over the seeds, each a unit of its own, all methods on the same data. `bp`: the other cycle. `rlg`: the second
cycle, another profile, and the warming half after training on the cooling half. One BLAS thread for everybody; the fit
time is the median, features included where the method uses them.
"""

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

if not __package__:  # run as a file: this folder would hide the package `fitting` behind this script
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != Path(__file__).resolve().parent]

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR

from benchmarks.fitting import Correction
from fitting.blas import one_thread
from fitting.csapso import CsapsoNetwork
from fitting.cycle import figures, first_dwell, improvement_percent
from fitting.gaussian_process import GaussianProcess
from fitting.lag_bank import LagBankCompensation
from fitting.lag_bank_history import History
from fitting.linear import LinearCompensation
from fitting.network import BackPropagationNetwork
from fitting.svr import SupportVectorRegression
from fitting.swarm import UnstableSwarmWarning
from tests.fitting.conftest import make_campaign
from tests.fitting.twins import ROW_S, Cycle, bp, rlg

Array = NDArray[np.float64]
Features = Callable[[Array], Array]


def as_they_are(temperatures: Array) -> Array:
    return temperatures


def with_slope(temperatures: Array) -> Array:
    return History(()).features(temperatures, ROW_S)


def with_history(temperatures: Array) -> Array:
    return History().features(temperatures, ROW_S)


class Scaled:
    """scikit-learn's SVR with its defaults, z-scores on both sides."""

    def fit(self, X: Array, y: Array) -> "Scaled":
        self.mean, self.std = y.mean(), y.std()
        self.inner = make_pipeline(StandardScaler(), SVR()).fit(X, (y - self.mean) / self.std)
        return self

    def predict(self, X: Array) -> Array:
        return np.asarray(self.mean + self.std * self.inner.predict(X))


class Nothing:
    """No compensation."""

    def fit(self, X: Array, y: Array) -> "Nothing":
        return self

    def predict(self, X: Array) -> Array:
        return np.zeros(len(X))


METHODS: dict[str, tuple[Features, Callable[[int], Any]]] = {
    "none": (as_they_are, lambda seed: Nothing()),
    "linear": (as_they_are, lambda seed: LinearCompensation()),
    "linear, slope": (with_slope, lambda seed: LinearCompensation()),
    "sklearn SVR, default": (as_they_are, lambda seed: Scaled()),
    "sklearn SVR, default, slope": (with_slope, lambda seed: Scaled()),
    "SVR, published grid": (as_they_are, lambda seed: SupportVectorRegression()),
    "BP, gradient": (with_slope, lambda seed: BackPropagationNetwork(random_state=seed)),
    "BP, Levenberg-Marquardt": (
        with_slope,
        lambda seed: BackPropagationNetwork(training="levenberg_marquardt", random_state=seed),
    ),
    "CSAPSO published, no finish": (with_slope, lambda seed: CsapsoNetwork(finish="none", random_state=seed)),
    "CSAPSO published, gradient": (with_slope, lambda seed: CsapsoNetwork(random_state=seed)),
    "CSAPSO stable, no finish": (with_slope, lambda seed: CsapsoNetwork(10, "stable", "none", random_state=seed)),
    "CSAPSO stable, gradient": (with_slope, lambda seed: CsapsoNetwork(10, "stable", random_state=seed)),
    "CSAPSO stable, Levenberg-Marquardt": (
        with_slope,
        lambda seed: CsapsoNetwork(10, "stable", "levenberg_marquardt", goal=0.0, random_state=seed),
    ),
    "BP, gradient, lag bank": (with_history, lambda seed: BackPropagationNetwork(random_state=seed)),
    "Gaussian process, lag bank": (with_history, lambda seed: GaussianProcess()),
    "lag bank": (with_history, lambda seed: LagBankCompensation()),
}
SLOW = {"SVR, published grid"}  # three units at most


@dataclass(frozen=True)
class Task:
    """Learn from some rows of a cycle, be judged on some rows of another; errors (n,) in deg/h."""

    name: str
    learn: Cycle
    learned: slice
    judge: Cycle
    judged: slice
    errors: tuple[Array, Array]


def centred(cycle: Cycle) -> Array:
    return np.asarray(cycle.bias_dph - cycle.bias_dph.mean())


def from_first_dwell(cycle: Cycle) -> Array:
    dwell = first_dwell(cycle.temperatures_degc.mean(axis=1), ROW_S)
    return np.asarray(cycle.bias_dph - cycle.bias_dph[dwell].mean())


def tasks(seed: int) -> Iterator[Task]:
    whole, first, second = slice(None), bp(seed), bp(seed, 1)
    yield Task("bp other cycle", first, whole, second, whole, (centred(first), centred(second)))
    cycle, again, steps = rlg(seed), rlg(seed, 1), rlg(seed, 2, "steps")
    error = from_first_dwell(cycle)
    yield Task("rlg second cycle", cycle, whole, again, whole, (error, from_first_dwell(again)))
    yield Task("rlg other profile", cycle, whole, steps, whole, (error, from_first_dwell(steps)))
    half = len(error) // 2
    yield Task("rlg cool to warm", cycle, slice(0, half), cycle, slice(half, None), (error, error))


def run(name: str, task: Task, seed: int) -> tuple[Array, float, float]:
    """What is left (n,), seconds to fit, share of guarded rows."""
    features, make = METHODS[name]
    model = make(seed)
    began = perf_counter()
    model.fit(features(task.learn.temperatures_degc)[task.learned], task.errors[0][task.learned])
    seconds = perf_counter() - began
    inputs = features(task.judge.temperatures_degc)[task.judged]
    left = task.errors[1][task.judged] - model.predict(inputs)
    return left, seconds, float(1.0 - model.inside(inputs).mean()) if hasattr(model, "inside") else 0.0


def print_cycles(seeds: int) -> None:
    names = [task.name for task in tasks(0)]
    print(f"std of what is left in white floors, median (worst) of {seeds} units; bp columns: against its other cycle")
    print(
        f"{'':36}"
        + "".join(f"{name:>18}" for name in names)
        + f"{'bp fit ms':>11}{'bp improved %':>15}{'guarded %':>11}"
    )
    for name in METHODS:
        left: dict[str, list[float]] = {task: [] for task in names}
        seconds, improved, guarded = [], [], []
        for seed in range(min(seeds, 3) if name in SLOW else seeds):
            for task in tasks(seed):
                residual, fit_s, share = run(name, task, seed)
                left[task.name].append(float(residual.std()) / task.judge.floor_dph)
                if task.name == names[0]:
                    seconds.append(fit_s)
                    raw, now = (figures(v, ROW_S).stability.value_dph for v in (task.errors[1], residual))
                    improved.append(improvement_percent(raw, now))
                if task.name == names[-1]:
                    guarded.append(100.0 * share)
        cells = "".join(f"{np.median(values):10.3f} ({max(values):5.2f})" for values in left.values())
        print(f"{name:36}{cells}{1e3 * np.median(seconds):11.1f}{np.median(improved):15.1f}{np.median(guarded):11.0f}")


def print_figures(seeds: int) -> None:
    """The paper's figures on the other cycle of `bp`."""
    print(f"\nbp, other cycle, medians of {seeds} units{'':6}{'MAE':>12}{'MSE':>16}{'Bs(100 s)':>18}  (deg/h)")
    for name in ("none", "BP, gradient", "CSAPSO published, gradient", "CSAPSO stable, gradient", "lag bank"):
        found = [figures(run(name, next(tasks(seed)), seed)[0], ROW_S) for seed in range(seeds)]
        mae, mse, stability = np.median([(f.mae_dph, f.mse_dph2, f.stability.value_dph) for f in found], axis=0)
        print(f"{name:42}{mae:12.5f}{mse:16.3e}{stability:18.5f}")


def second_order(hidden: int, linear_path: bool, n_starts: int) -> Callable[[int], Any]:
    return lambda seed: BackPropagationNetwork(
        hidden,
        "levenberg_marquardt",
        activation="tanh",
        linear_path=linear_path,
        n_starts=n_starts,
        random_state=seed,
    )


NETWORKS: dict[str, Callable[[int], Any]] = {
    "10 sigmoids, gradient": lambda seed: BackPropagationNetwork(random_state=seed),
    "10 sigmoids, gradient, correction": lambda seed: Correction(BackPropagationNetwork(random_state=seed)),
    "10 tanh, gradient, correction": lambda seed: Correction(
        BackPropagationNetwork(activation="tanh", random_state=seed)
    ),
    "10 tanh, L-M, 1 start": second_order(10, False, 1),
    "10 tanh, L-M, 3 starts": second_order(10, False, 3),
    "20 tanh, L-M, 1 start": second_order(20, False, 1),
    "10 tanh, linear path, L-M, 3 starts": second_order(10, True, 3),
    "20 tanh, linear path, L-M, 1 start": second_order(20, True, 1),
    "20 tanh, linear path, L-M, 3 starts": second_order(20, True, 3),
}


def print_networks(seeds: int) -> None:
    print(f"\nnetworks on surface A, 470 rows to fit, 214 held back, {seeds} seeds: median (worst) in deg/s")
    for name, make in NETWORKS.items():
        found = []
        for seed in range(seeds):
            data = make_campaign(seed)
            rows, held = data.split(seed, 470)
            began = perf_counter()
            model = make(seed).fit(data.inputs[rows], data.reference[rows])
            seconds = perf_counter() - began
            error = model.predict(data.inputs[held]) - data.reference[held]
            found.append((np.abs(error).max(), error.std(), 1e3 * seconds))
        (largest, std, fit_ms), worst = np.median(found, axis=0), np.max(found, axis=0)
        print(f"{name:36}max {largest:9.4f} ({worst[0]:8.4f})  std {std:9.5f} ({worst[1]:9.5f})  fit {fit_ms:7.1f} ms")


def main(seeds: int = 10) -> None:
    """Print everything; seeds: units, or data sets, per method."""
    warnings.simplefilter("ignore", ConvergenceWarning)  # of the peers' optimisers, which we only time
    warnings.simplefilter("ignore", UnstableSwarmWarning)  # the table shows what it warns of
    with one_thread():
        run("lag bank", next(tasks(0)), 0)  # the first call of anything pays for imports
        print_cycles(seeds)
        print_figures(seeds)
        print_networks(seeds)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="units per method (default 10)")
    main(parser.parse_args().seeds)
