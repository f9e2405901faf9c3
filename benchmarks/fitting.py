"""Times and accuracy of our models beside other methods on the same data in the same run.

    python -m benchmarks.fitting             # from the repository's root; some minutes
    python -m benchmarks.fitting --seeds 10
    python3 do.py bench fitting              # the same

Data: error surface A on the 684-point grid of reference experiment `ts` with the white noise of a 1 deg/h gyro,
470 rows to fit and 214 to judge; and the same with errors common to a dwell, whole temperatures left out in turn.
One BLAS thread for everybody; times are of the processor; the fit time is the best of three; ratios are to the joint
model with four rules. The floor is the error of the exact inverse of the surface, which knows all but the noise.
"""

import argparse
import sys
import warnings
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from time import process_time
from typing import Any

if not __package__:  # run as a file: this folder would hide the package `fitting` behind this script
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != Path(__file__).resolve().parent]

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.neural_network import MLPRegressor
from sklearn.svm import SVR
from soft_clustering import GK

from fitting import ls_svm
from fitting.automatic import AutomaticCompensation
from fitting.blas import one_thread
from fitting.gaussian_process import GaussianProcess
from fitting.gustafson_kessel import gustafson_kessel, random_partitions
from fitting.linear import LinearCompensation
from fitting.polynomial import PolynomialCompensation
from fitting.rbf import RadialBasisSpline
from fitting.scaling import Scaling
from fitting.svr import GridSearch, SupportVectorRegression, shuffled_folds, to_unit_range
from fitting.svr import campaign as svr_of_a_campaign
from fitting.takagi_sugeno import TakagiSugeno, automatic

Array = NDArray[np.float64]
PREDICTED_ROWS = 200_000
FOLDS = 6


class Correction:
    """A method that wants z-scores on both sides; it learns the correction, fifty times smaller than the rate."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner

    def fit(self, X: Array, y: Array) -> "Correction":
        correction = y - X[:, 1]
        self.scaling, self.mean, self.std = Scaling.of(X), correction.mean(), correction.std()
        self.inner.fit(self.scaling.apply(X), (correction - self.mean) / self.std)
        return self

    def predict(self, X: Array) -> Array:
        return np.asarray(X[:, 1] + self.mean + self.std * self.inner.predict(self.scaling.apply(X)))


class Inverse:
    """The surface inverted exactly: the floor."""

    def fit(self, X: Array, y: Array) -> "Inverse":
        return self

    def predict(self, X: Array) -> Array:
        gain, bias = gain_and_bias(X[:, 0])
        return np.asarray(np.arcsin((X[:, 1] - bias) / gain * 0.0013) / 0.0013)


METHODS: dict[str, Callable[[], Any]] = {
    "T-S joint, 4 rules": lambda: TakagiSugeno(4),
    "T-S joint, 6 rules": lambda: TakagiSugeno(6),
    "T-S joint, 12 rules": lambda: TakagiSugeno(12),
    "T-S tied, 4 rules": lambda: TakagiSugeno(4, structure="tied"),
    "T-S tied, 6 rules": lambda: TakagiSugeno(6, structure="tied"),
    "T-S joint, automatic": automatic,
    "automatic, any model": AutomaticCompensation,
    "T-S published, 4 rules, 1 start": lambda: TakagiSugeno(4, "gustafson_kessel", "recursive", n_starts=1),
    "T-S published, 4 rules, 5 starts": lambda: TakagiSugeno(4, "gustafson_kessel", "recursive"),
    "T-S published, 12 rules, 5 starts": lambda: TakagiSugeno(12, "gustafson_kessel", "recursive"),
    "linear": LinearCompensation,
    "polynomial of degree 3": PolynomialCompensation,
    "polynomial of degree 5": lambda: PolynomialCompensation(5),
    "LS-SVM, untuned": ls_svm.published,
    "LS-SVM, one width for all inputs": lambda: ls_svm.LeastSquaresSVM(stretch=False),
    "LS-SVM, leave-one-out": ls_svm.tuned,
    "radial basis spline": RadialBasisSpline,
    "Gaussian process": GaussianProcess,
    "SVR, grid coarse to fine": svr_of_a_campaign,
    "SVR, grid, narrow tube": lambda: SupportVectorRegression(trend="linear", epsilon=0.003),
    "sklearn SVR, default": lambda: Correction(SVR()),
    "sklearn MLPRegressor(10), lbfgs": lambda: Correction(
        MLPRegressor(hidden_layer_sizes=(10,), activation="tanh", solver="lbfgs", max_iter=2000, random_state=0)
    ),
    "sklearn GaussianProcess, ARD": lambda: Correction(
        GaussianProcessRegressor(
            ConstantKernel(100.0, (1e-3, 1e8)) * RBF([1.0, 3.0]) + WhiteKernel(1e-8, (1e-12, 1.0)), random_state=0
        )
    ),
    "floor": Inverse,
}
# One data set, one repetition, fewer rows predicted, no folds.
SLOW = {"sklearn GaussianProcess, ARD", "SVR, grid coarse to fine", "SVR, grid, narrow tube"}
# One repetition; and predictions that cost microseconds a row.
ONCE = SLOW | {"T-S joint, automatic", "automatic, any model", "Gaussian process"}
COSTLY = SLOW | {name for name in METHODS if "LS-SVM" in name or name in ("Gaussian process", "radial basis spline")}


def gain_and_bias(temperature: Array) -> tuple[Array, Array]:
    """Of surface A; fitting notes, section 1."""
    gain = 1.049530876 + 0.020260709 * np.tanh((temperature - 24.87441) / 14.0)
    return gain, 0.40871934 + 0.42963359 * (temperature - 15.0) / 45.0


def campaign(seed: int, dwell_errors: bool) -> tuple[Array, Array, NDArray[np.int64]]:
    """Inputs (684, 2), true rate and dwell number; fitting notes, sections 1 and 5."""
    rng = np.random.default_rng(seed)
    temperatures = np.arange(-30.0, 61.0, 5.0)
    rates = np.concatenate([np.arange(-180.0, 0.0, 10.0), np.arange(10.0, 181.0, 10.0)])
    dwell = np.repeat(np.arange(len(temperatures)), len(rates))
    temperature, rate = temperatures[dwell], np.tile(rates, len(temperatures))
    gain, bias = gain_and_bias(temperature)
    output = gain * np.sin(0.0013 * rate) / 0.0013 + bias + 2.8e-4 * rng.standard_normal(len(rate))
    if dwell_errors:
        scale, bias, sensor = rng.standard_normal((3, len(temperatures))) * [[1e-4], [2.0 / 3600.0], [0.1]]
        output, temperature = output * (1.0 + scale[dwell]) + bias[dwell], temperature + sensor[dwell]
    return np.column_stack([temperature, output]), rate, dwell


def best_time(work: Callable[[], Any], repetitions: int) -> float:
    """Processor seconds of the quickest of several runs."""
    times = []
    for _ in range(repetitions):
        started = process_time()
        work()
        times.append(process_time() - started)
    return min(times)


def white(name: str, seed: int) -> tuple[float, float, float, float]:
    """Largest error, std (deg/s), fit time (s) and predict time (s a row) on a random split."""
    inputs, rate, _ = campaign(seed, False)
    order = np.random.default_rng(1000 + seed).permutation(len(rate))
    train, test = order[:470], order[470:]
    model = METHODS[name]()
    fit_s = best_time(lambda: model.fit(inputs[train], rate[train]), 1 if name in ONCE else 3)
    error = model.predict(inputs[test]) - rate[test]
    n = PREDICTED_ROWS // (100 if name in COSTLY else 1)
    many = np.random.default_rng(0).uniform(inputs.min(axis=0), inputs.max(axis=0), (n, 2))
    return float(np.abs(error).max()), float(error.std()), fit_s, best_time(lambda: model.predict(many), 2) / n


def left_out(name: str, seed: int) -> float:
    """std (deg/s) with dwell errors, every sixth temperature left out in turn."""
    inputs, rate, dwell = campaign(seed, True)
    error = np.empty(len(rate))
    for fold in range(FOLDS):
        out = dwell % FOLDS == fold
        model = METHODS[name]()
        groups = {"groups": dwell[~out]} if "groups" in signature(model.fit).parameters else {}
        error[out] = model.fit(inputs[~out], rate[~out], **groups).predict(inputs[out]) - rate[out]
    return float(error.std())


def measure(name: str, seeds: int) -> dict[str, float]:
    """Median and worst over data sets of everything the table shows, by the names of the targets."""
    count = 1 if name in SLOW else seeds
    runs = np.array([white(name, seed) for seed in range(count)])
    dwells = [np.nan] if name in SLOW else [left_out(name, seed) for seed in range(seeds)]
    (largest, std), (worst_largest, worst_std) = np.median(runs[:, :2], axis=0), runs[:, :2].max(axis=0)
    fit_s, row_s = np.median(runs[:, 2:], axis=0)
    return {
        "max": largest,
        "worst max": worst_largest,
        "std": std,
        "worst std": worst_std,
        "dwell std": float(np.median(dwells)),
        "worst dwell std": float(np.max(dwells)),
        "fit_s": fit_s,
        "row_s": row_s,
    }


def print_methods(seeds: int) -> dict[str, dict[str, float]]:
    print(f"surface A, 470 rows to fit, {seeds} seeds: median (worst) in deg/s; dwell errors: temperatures left out")
    print(f"{'':34}{'max':>19}{'std':>21}{'dwell errors, std':>21}{'fit ms':>11}{'ratio':>8}{'ns/row':>8}{'ratio':>8}")
    found: dict[str, dict[str, float]] = {}
    for name in METHODS:
        one = found[name] = measure(name, seeds)
        first = found["T-S joint, 4 rules"]
        print(
            f"{name:34}{one['max']:9.4f} ({one['worst max']:7.4f}){one['std']:11.5f} ({one['worst std']:7.5f})"
            f"{one['dwell std']:11.4f} ({one['worst dwell std']:6.4f}){1e3 * one['fit_s']:12.1f}"
            f"{one['fit_s'] / first['fit_s']:8.2f}{1e9 * one['row_s']:8.0f}{one['row_s'] / first['row_s']:8.2f}",
            flush=True,
        )
    return found


# What the product promises of its models: method, figure, at most.
TARGETS = (
    ("T-S joint, automatic", "std", 3.1e-4),
    ("T-S joint, automatic", "worst std", 4e-4),
    ("T-S joint, 6 rules", "worst max", 0.0147),
    ("T-S joint, 6 rules", "worst std", 0.00286),
    ("T-S joint, 4 rules", "max", 0.011),
    ("T-S joint, 4 rules", "worst max", 0.05),
    ("T-S joint, automatic", "dwell std", 0.0155),
    ("T-S joint, automatic", "worst dwell std", 0.023),
    ("T-S joint, 4 rules", "fit_s", 0.3),
    ("T-S joint, 6 rules", "fit_s", 0.1),
    ("T-S joint, 12 rules", "fit_s", 0.35),
    ("T-S joint, 12 rules", "row_s", 0.25e-6),
    ("LS-SVM, leave-one-out", "std", 7e-4),
    ("LS-SVM, leave-one-out", "fit_s", 0.35),
)


def print_targets(found: dict[str, dict[str, float]]) -> None:
    print("\npromised, and measured in this run")
    for name, figure, limit in TARGETS:
        value = found[name][figure]
        print(f"{name:34}{figure:>16}{limit:12.3g}{value:12.3g}   {'reached' if value <= limit else 'MISSED'}")
    # The tube with which the grid reaches the std of 0.010 deg/s that the fitting notes give it.
    ratio = found["SVR, grid, narrow tube"]["fit_s"] / found["LS-SVM, leave-one-out"]["fit_s"]
    print(
        f"{'SVR grid / LS-SVM':34}{'fit_s':>16}{60.0:12.3g}{ratio:12.3g}   {'reached' if ratio >= 60.0 else 'MISSED'}"
    )


def cycle() -> tuple[Array, Array]:
    """336 rows of three temperatures of a slow cycle, and an error in deg/h; as reference experiment `rlg`."""
    rng, time_s = np.random.default_rng(0), 100.0 * np.arange(336)
    air = np.interp(time_s, [0.0, 9000.0, 12300.0, 21300.0, 24600.0, 33600.0], [25.0, 25.0, -30.0, -30.0, 25.0, 25.0])
    nodes = np.empty((336, 3))
    nodes[0] = 25.0
    for i in range(1, 336):
        nodes[i] = nodes[i - 1] + (air[i] - nodes[i - 1]) * -np.expm1(-100.0 / np.array([600.0, 1200.0, 2400.0]))
    error = 0.02 * np.tanh((nodes[:, 2] + 5.0) / 20.0) + 0.0008 * (nodes[:, 0] - nodes[:, 2])
    return nodes + 0.02 * rng.standard_normal((336, 3)), error + 0.006 * rng.standard_normal(336)


def print_grid() -> None:
    """The paper's grid of 161 x 161 points: every eighth line of it, the time scaled up, against coarse to fine."""
    inputs, error = cycle()
    model = SupportVectorRegression()
    quick = best_time(lambda: model.fit(inputs, error), 1)
    scaled = [(v - to_unit_range(v)[0]) / to_unit_range(v)[1] for v in (inputs, error[:, np.newaxis])]
    seed = np.random.RandomState(0).randint(2**31 - 1)
    grid = GridSearch(scaled[0], scaled[1][:, 0], shuffled_folds(336, 3, np.random.default_rng(seed)), model.epsilon)
    points = [(i, j) for i in range(0, 161, 8) for j in range(0, 161, 8)]
    full = best_time(lambda: [grid.score(point) for point in points], 1) * 161**2 / len(points)
    best = min(grid.scores.values())
    print(f"\nSVR, 336 rows, 3 inputs: {model.n_scored_} points in {quick:.1f} s, score {model.score_:.5f}")
    print(
        f"full grid, from every eighth line: {full:.0f} s ({full / quick:.0f} times as long), best of these {best:.5f}"
    )


def print_clustering() -> None:
    """The same number of sweeps from the same kind of start, ours and soft-clustering's."""
    inputs, rate, _ = campaign(0, False)
    raw = np.column_stack([inputs, rate])
    points, sweeps = Scaling.of(raw).apply(raw), 100
    starts = random_partitions(5, 4, len(points), np.random.default_rng(0))
    ours = best_time(lambda: gustafson_kessel(points, starts[:1], tol=0.0, max_iter=sweeps), 5)
    batch = best_time(lambda: gustafson_kessel(points, starts, tol=0.0, max_iter=sweeps), 5) / len(starts)
    peer = GK(random_state=0, max_iter=sweeps, tol=-1.0, init="random", reg_covar=0.0)
    theirs = best_time(lambda: peer.fit_predict(points, 4), 5)
    print(f"\nGustafson-Kessel, 684 points, 4 clusters, {sweeps} sweeps")
    for name, seconds in (("one start", ours), ("each of five starts at once", batch), ("soft-clustering", theirs)):
        print(f"{name:34}{1e3 * seconds:9.1f} ms{seconds / ours:8.2f}")


def main(seeds: int = 3) -> None:
    """Print everything; seeds: data sets per method."""
    warnings.simplefilter("ignore", ConvergenceWarning)  # of the peers' optimisers, which we only time
    with one_thread():
        print_targets(print_methods(seeds))
        print_grid()
        print_clustering()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="data sets per method (default 3)")
    main(parser.parse_args().seeds)
