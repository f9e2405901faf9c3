"""Support vector regression as reference experiment `rlg` has it: all columns in [-1, 1], a grid of powers of two.

E = f(x) by epsilon-SVR with the kernel exp(-g |x - s|^2); C and g from 2^-8 ... 2^8 in exponents of 0.1, by three-fold
cross-validation. The grid has 161 x 161 points; coarse-to-fine visits some hundreds of them: the score varies slowly
with both exponents, and every level is searched around the best points of the one before, over a wider cell than it
came from.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.svm import SVR
from sklearn.utils import check_random_state

from fitting.blas import one_thread
from fitting.consequents import batch
from fitting.estimator import CompensationEstimator, checked_groups, require, require_rows
from fitting.kernels import KernelModel, monomial_powers
from fitting.scaling import Scaling

LIMIT, STEP = 8.0, 0.1
_POINTS = 161
_EXPONENTS = np.linspace(-LIMIT, LIMIT, _POINTS)
# Distance between visited points at each level, in steps of the grid; and how many of the best are searched around.
_LEVELS, _KEPT = (16, 4, 1), (3, 2)
_KERNEL_MB = 100


def to_unit_range(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middle and half range of the columns of (n, k), each (k,); a constant column has the half range 1."""
    low, high = values.min(axis=0), values.max(axis=0)
    half = 0.5 * (high - low)
    return 0.5 * (low + high), np.where(half > 0.0, half, 1.0)


@dataclass
class GridSearch:
    """Scores of (C, g) on the grid, remembered; score: mean square error of cross-validation at two exponents."""

    inputs: NDArray[np.float64]  # (n, d), in [-1, 1]
    targets: NDArray[np.float64]  # (n,), in [-1, 1]
    folds: NDArray[np.intp]  # (n,)
    epsilon: float
    scores: dict[tuple[int, int], float] = field(default_factory=dict)

    def score(self, point: tuple[int, int]) -> float:
        """Mean square error at grid indices (of C, of g)."""
        if point not in self.scores:
            total = 0.0
            for fold in np.unique(self.folds):
                held = self.folds == fold
                machine = support_vectors(self.inputs[~held], self.targets[~held], *powers_of_two(point), self.epsilon)
                total += float(np.sum((machine.predict(self.inputs[held]) - self.targets[held]) ** 2))
            self.scores[point] = total / len(self.targets)
        return self.scores[point]

    def full(self) -> tuple[int, int]:
        """The best of all points."""
        return min(((i, j) for i in range(_POINTS) for j in range(_POINTS)), key=self.score)

    def coarse_to_fine(self) -> tuple[int, int]:
        """The best point of three levels, each around the best of the one before."""
        coarse = range(0, _POINTS, _LEVELS[0])
        points = [(i, j) for i in coarse for j in coarse]
        for step, kept in zip(_LEVELS[1:], _KEPT, strict=True):
            best = sorted(points, key=self.score)[:kept]
            reach = np.arange(-_LEVELS[_LEVELS.index(step) - 1], _LEVELS[_LEVELS.index(step) - 1] + 1, step)
            around = {(i + a, j + b) for i, j in best for a in reach.tolist() for b in reach.tolist()}
            points = sorted((i, j) for i, j in around if 0 <= i < _POINTS and 0 <= j < _POINTS)
        return min(points, key=self.score)


def powers_of_two(point: tuple[int, int]) -> tuple[float, float]:
    """C and g at grid indices."""
    return float(2.0 ** _EXPONENTS[point[0]]), float(2.0 ** _EXPONENTS[point[1]])


def support_vectors(
    inputs: NDArray[np.float64], targets: NDArray[np.float64], penalty: float, gamma: float, epsilon: float
) -> SVR:
    """scikit-learn's machine, fitted."""
    machine = SVR(kernel="rbf", C=penalty, gamma=gamma, epsilon=epsilon, cache_size=_KERNEL_MB)
    return machine.fit(inputs, targets)


def shuffled_folds(n_rows: int, folds: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Fold number of every row, drawn at random, of equal size."""
    return np.asarray(rng.permutation(n_rows) % folds, dtype=np.intp)


class SupportVectorRegression(CompensationEstimator):
    """Epsilon-SVR with a Gaussian kernel on inputs and output scaled to [-1, 1].

    Parameters
    ----------
    search: 'coarse_to_fine' (some 400 points of the grid), 'full' (all 25 921, minutes), 'none' (C and gamma as given).
    C, gamma: of the machine when search is 'none'. epsilon: half width of the tube, in the scaled output; 0.1 is the
        usual one, the paper names none, and it bounds what can be reached: an error below a twentieth of the range of y
        costs nothing.
    trend: 'none' as published, or 'linear': the machine learns what a linear fit leaves.
    folds: of the cross-validation; with groups given to `fit`, whole groups are dealt to them.
    random_state: of the division into folds.

    Attributes
    ----------
    C_, gamma_: as used; score_: mean square error of the cross-validation in the scaled output, None without search;
    n_scored_: points of the grid visited; n_support_, n_parameters_: support vectors. model_, training_: see
    `CompensationEstimator`.
    """

    def __init__(
        self,
        search: Literal["coarse_to_fine", "full", "none"] = "coarse_to_fine",
        C: float = 1.0,
        gamma: float = 1.0,
        epsilon: float = 0.1,
        trend: Literal["none", "linear"] = "none",
        folds: int = 3,
        random_state: Any = 0,
    ) -> None:
        self.search = search
        self.C = C
        self.gamma = gamma
        self.epsilon = epsilon
        self.trend = trend
        self.folds = folds
        self.random_state = random_state

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "SupportVectorRegression":
        """Fit to X (n >= 2, k) and y (n,); groups: label of each row, (n,), to leave out whole groups."""
        self._check_parameters()
        inputs, target = self._checked(X, y)
        require_rows(self, len(target))
        columns = Scaling.of(inputs).columns
        middle, half = to_unit_range(inputs[:, columns])
        scaled = (inputs[:, columns] - middle) / half
        line = np.zeros(scaled.shape[1] + 1)
        if self.trend == "linear":
            line = batch(np.column_stack([np.ones(len(target)), scaled]), target, 0.0).theta
        rest = target - line[0] - scaled @ line[1:]
        centre, reach = to_unit_range(rest[:, np.newaxis])
        scaled_rest = (rest - centre[0]) / reach[0]
        self.C_, self.gamma_ = self._searched(scaled, scaled_rest, checked_groups(groups, len(target)))
        machine = self._machine(scaled, scaled_rest)
        self.n_parameters_ = self.n_support_ = len(machine.support_)
        width = 1.0 / np.sqrt(2.0 * self.gamma_)
        line = line / reach[0]
        line[0] += machine.intercept_[0]
        model = KernelModel(
            columns,
            middle,
            half * width,
            "gaussian",
            machine.support_vectors_ / width,
            machine.dual_coef_[0],
            monomial_powers(len(columns), 1),
            np.concatenate([line[:1], line[1:] * width]),
            float(centre[0]),
            float(reach[0]),
        )
        self._keep(model, inputs, target)
        return self

    def _check_parameters(self) -> None:
        searches = ("coarse_to_fine", "full", "none")
        require(self.search in searches, self, "search", self.search, ", ".join(map(repr, searches)))
        require(self.trend in ("none", "linear"), self, "trend", self.trend, "'none', 'linear'")
        require(self.C > 0.0, self, "C", self.C, "above 0")
        require(self.gamma > 0.0, self, "gamma", self.gamma, "above 0")
        require(self.epsilon >= 0.0, self, "epsilon", self.epsilon, "0 or more")
        require(self.folds >= 2, self, "folds", self.folds, "a whole number of at least 2")

    def _machine(self, inputs: NDArray[np.float64], targets: NDArray[np.float64]) -> Any:
        if inputs.shape[1]:
            return support_vectors(inputs, targets, self.C_, self.gamma_, self.epsilon)
        return _Constant(np.array([np.median(targets)]))

    def _searched(
        self, inputs: NDArray[np.float64], targets: NDArray[np.float64], groups: NDArray[np.intp] | None
    ) -> tuple[float, float]:
        self.score_, self.n_scored_ = None, 0
        if self.search == "none" or not inputs.shape[1] or len(targets) < 2 * self.folds:
            return self.C, self.gamma
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        folds = shuffled_folds(len(targets) if groups is None else int(groups.max()) + 1, self.folds, rng)
        grid = GridSearch(inputs, targets, folds if groups is None else folds[groups], self.epsilon)
        best = grid.full() if self.search == "full" else grid.coarse_to_fine()
        self.score_, self.n_scored_ = grid.score(best), len(grid.scores)
        return powers_of_two(best)


def campaign() -> SupportVectorRegression:
    """For a temperature x rate campaign: beside a linear fit, with a tube of a hundredth of half the rest's range.

    A narrower tube is more accurate and slower: on surface A 0.01 reaches a std of 0.026 deg/s in 15 s, 0.001 reaches
    0.004 deg/s in 150 s.
    """
    return SupportVectorRegression(trend="linear", epsilon=0.01)


@dataclass(frozen=True)
class _Constant:
    """What is left of a machine without inputs."""

    intercept_: NDArray[np.float64]
    support_: tuple[()] = ()
    dual_coef_: NDArray[np.float64] = field(default_factory=partial(np.zeros, (1, 0)))
    support_vectors_: NDArray[np.float64] = field(default_factory=partial(np.zeros, (0, 0)))
