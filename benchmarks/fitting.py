"""Times and accuracy of the Takagi-Sugeno models beside other methods on the same data in the same run.

    python -m benchmarks.fitting             # from the repository's root; about half a minute
    python -m benchmarks.fitting --seeds 10
    python3 do.py bench fitting              # the same

Data: error surface A on the 684-point grid of reference experiment `ts` with the white noise of a 1 deg/h gyro,
470 rows to fit and 214 to judge; and the same with errors common to a dwell, whole temperatures left out in turn.
One BLAS thread for everybody; the fit time is the best of three; ratios are to the joint model with four rules.
"""

import argparse
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

if not __package__:  # run as a file: this folder would hide the package `fitting` behind this script
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != Path(__file__).resolve().parent]

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.svm import SVR
from soft_clustering import GK

from fitting.blas import one_thread
from fitting.gustafson_kessel import gustafson_kessel, random_partitions
from fitting.linear import LinearCompensation
from fitting.scaling import Scaling
from fitting.takagi_sugeno import TakagiSugeno

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


class Spline:
    """scipy's RBFInterpolator behind fit and predict."""

    def fit(self, X: Array, y: Array) -> "Spline":
        self.spline = RBFInterpolator(X, y, kernel="quintic")
        return self

    def predict(self, X: Array) -> Array:
        return np.asarray(self.spline(X))


def polynomial() -> Any:
    return make_pipeline(StandardScaler(), PolynomialFeatures(5), LinearCompensation())


METHODS: dict[str, Callable[[], Any]] = {
    "T-S joint, 4 rules": lambda: TakagiSugeno(4),
    "T-S joint, 6 rules": lambda: TakagiSugeno(6),
    "T-S joint, 12 rules": lambda: TakagiSugeno(12),
    "T-S published, 4 rules, 1 start": lambda: TakagiSugeno(4, "gustafson_kessel", "recursive", n_starts=1),
    "T-S published, 4 rules, 5 starts": lambda: TakagiSugeno(4, "gustafson_kessel", "recursive"),
    "T-S published, 12 rules, 5 starts": lambda: TakagiSugeno(12, "gustafson_kessel", "recursive"),
    "linear": LinearCompensation,
    "polynomial of degree 5": polynomial,
    "scipy RBFInterpolator, quintic": lambda: Correction(Spline()),
    "sklearn SVR, default": lambda: Correction(SVR()),
    "sklearn MLPRegressor(10), lbfgs": lambda: Correction(
        MLPRegressor(hidden_layer_sizes=(10,), activation="tanh", solver="lbfgs", max_iter=2000, random_state=0)
    ),
    "sklearn GaussianProcess, ARD": lambda: Correction(
        GaussianProcessRegressor(
            ConstantKernel(100.0, (1e-3, 1e8)) * RBF([1.0, 3.0]) + WhiteKernel(1e-8, (1e-12, 1.0)), random_state=0
        )
    ),
}
SLOW = {"sklearn GaussianProcess, ARD"}  # one data set, one repetition, fewer rows predicted, no folds


def campaign(seed: int, dwell_errors: bool) -> tuple[Array, Array, NDArray[np.int64]]:
    """Inputs (684, 2), true rate and dwell number; fitting notes, sections 1 and 5."""
    rng = np.random.default_rng(seed)
    temperatures = np.arange(-30.0, 61.0, 5.0)
    rates = np.concatenate([np.arange(-180.0, 0.0, 10.0), np.arange(10.0, 181.0, 10.0)])
    dwell = np.repeat(np.arange(len(temperatures)), len(rates))
    temperature, rate = temperatures[dwell], np.tile(rates, len(temperatures))
    gain = 1.049530876 + 0.020260709 * np.tanh((temperature - 24.87441) / 14.0)
    output = gain * np.sin(0.0013 * rate) / 0.0013 + 0.40871934 + 0.42963359 * (temperature - 15.0) / 45.0
    output = output + 2.8e-4 * rng.standard_normal(len(rate))
    if dwell_errors:
        scale, bias, sensor = rng.standard_normal((3, len(temperatures))) * [[1e-4], [2.0 / 3600.0], [0.1]]
        output, temperature = output * (1.0 + scale[dwell]) + bias[dwell], temperature + sensor[dwell]
    return np.column_stack([temperature, output]), rate, dwell


def best_time(work: Callable[[], Any], repetitions: int) -> float:
    """Seconds of the quickest of several runs."""
    times = []
    for _ in range(repetitions):
        started = perf_counter()
        work()
        times.append(perf_counter() - started)
    return min(times)


def white(name: str, seed: int) -> tuple[float, float, float, float]:
    """Largest error, std (deg/s), fit time (s) and predict time (s a row) on a random split."""
    inputs, rate, _ = campaign(seed, False)
    order = np.random.default_rng(1000 + seed).permutation(len(rate))
    train, test = order[:470], order[470:]
    model = METHODS[name]()
    fit_s = best_time(lambda: model.fit(inputs[train], rate[train]), 1 if name in SLOW else 3)
    error = model.predict(inputs[test]) - rate[test]
    n = PREDICTED_ROWS // (100 if name in SLOW else 1)
    many = np.random.default_rng(0).uniform(inputs.min(axis=0), inputs.max(axis=0), (n, 2))
    return float(np.abs(error).max()), float(error.std()), fit_s, best_time(lambda: model.predict(many), 2) / n


def left_out(name: str, seed: int) -> float:
    """std (deg/s) with dwell errors, every sixth temperature left out in turn."""
    inputs, rate, dwell = campaign(seed, True)
    error = np.empty(len(rate))
    for fold in range(FOLDS):
        out = dwell % FOLDS == fold
        error[out] = METHODS[name]().fit(inputs[~out], rate[~out]).predict(inputs[out]) - rate[out]
    return float(error.std())


def print_methods(seeds: int) -> None:
    print(f"surface A, 470 rows to fit, {seeds} seeds: median (worst) in deg/s; dwell errors: temperatures left out")
    print(f"{'':34}{'max':>19}{'std':>21}{'dwell errors, std':>19}{'fit ms':>10}{'ratio':>8}{'ns/row':>8}{'ratio':>8}")
    reference: tuple[float, float] | None = None
    for name in METHODS:
        runs = np.array([white(name, seed) for seed in range(1 if name in SLOW else seeds)])
        (largest, spread), (worst, worst_spread) = np.median(runs[:, :2], axis=0), runs[:, :2].max(axis=0)
        fit_s, predict_s = np.median(runs[:, 2:], axis=0)
        reference = reference or (fit_s, predict_s)
        dwell = "-" if name in SLOW else f"{np.median([left_out(name, seed) for seed in range(seeds)]):.4f}"
        print(
            f"{name:34}{largest:9.4f} ({worst:7.4f}){spread:11.5f} ({worst_spread:7.5f}){dwell:>18}"
            f"{1e3 * fit_s:11.1f}{fit_s / reference[0]:8.2f}{1e9 * predict_s:8.0f}{predict_s / reference[1]:8.2f}"
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
        print_methods(seeds)
        print_clustering()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="data sets per method (default 3)")
    main(parser.parse_args().seeds)
