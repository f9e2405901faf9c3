"""Least-squares support vector machine (Suykens and Vandewalle, 1999), tuned by its exact leave-one-out error."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.blas import one_thread
from fitting.estimator import CompensationEstimator, checked_groups, require, require_rows
from fitting.kernel_system import KernelSystem
from fitting.kernels import KernelModel, gaussian, monomial_powers, monomials, squared_distances
from fitting.scaling import Scaling, scale_target

# 13 kernel widths in z-scores and 13 values of gamma: from a bend over a few grid steps to one over everything, and
# from noise as large as the signal to the rounding of the solution.
WIDTHS = 2.0 ** np.linspace(-2.0, 4.0, 13)
GAMMAS = 10.0 ** np.linspace(0.0, 12.0, 13)
_TREND_DEGREE = {"constant": 0, "linear": 1}
# Each input's own width is then doubled or halved as long as that helps, this often in all.
_STRETCHES = 4


@dataclass(frozen=True)
class Machine:
    """A tuned machine on z-scores: widths of the inputs (d,), gamma, and the mean square of its left-out errors."""

    system: KernelSystem
    widths: NDArray[np.float64]
    gamma: float
    error: float


class WidthSearch:
    """Machines on z-scored inputs (n, d) and targets (n,); groups as in `KernelSystem.tune`."""

    def __init__(
        self,
        inputs: NDArray[np.float64],
        targets: NDArray[np.float64],
        trend: NDArray[np.float64],
        groups: NDArray[np.intp] | None,
    ) -> None:
        self.n_inputs, self.targets, self.trend, self.groups = inputs.shape[1], targets, trend, groups
        self.squares = [squared_distances(column, column) for column in np.split(inputs, inputs.shape[1] or 1, axis=1)]

    def machine(self, widths: NDArray[np.float64], gammas: NDArray[np.float64]) -> Machine:
        """The best of several gammas at given widths, by one eigendecomposition."""
        squares = np.zeros((len(self.targets), len(self.targets)))
        for own, width in zip(self.squares, widths, strict=False):  # without inputs there is one matrix of zeros
            squares += own / width**2
        system = KernelSystem(gaussian(squares), self.trend)
        found = system.tune(self.targets, 1.0 / gammas, self.groups)
        return Machine(system, widths, 1.0 / found.ridge, found.error)

    def common(self, widths: NDArray[np.float64], gammas: NDArray[np.float64]) -> Machine:
        """The best of one width for all inputs."""
        ones = np.ones(self.n_inputs)
        return min((self.machine(width * ones, gammas) for width in widths), key=lambda machine: machine.error)

    def stretched(self, best: Machine, gammas: NDArray[np.float64]) -> Machine:
        """From one width for all inputs to one for each, by doubling and halving them in turn."""
        trials = 0
        moves = [(k, factor) for k in reversed(range(len(best.widths))) for factor in (2.0, 0.5)]
        while moves and trials < _STRETCHES:
            k, factor = moves[0]
            widths = best.widths.copy()
            widths[k] *= factor
            trial = self.machine(widths, gammas)
            trials += 1
            if trial.error < best.error:
                best = trial
            else:
                moves.pop(0)
        return best


class LeastSquaresSVM(CompensationEstimator):
    """LS-SVM with a Gaussian kernel exp(-|x - s|^2 / (2 sigma^2)) on z-scored inputs and outputs.

    Parameters
    ----------
    gamma, sigma: regularisation and kernel width, in z-scores; None chooses them by the exact leave-one-out error over
        13 widths and 13 gammas, with one eigendecomposition a width (fitting notes, section 6). With groups,
        `fit` leaves out whole groups instead, as errors common to a temperature dwell require.
    trend: what is not penalised: 'constant', the bias term of the textbook, or 'linear'. A rate that is nearly the true
        one is learned forty times better beside a linear trend, and the published figures can only be meant so.
    stretch: when sigma is None, adapt the width of each input by itself as well.

    Attributes
    ----------
    gamma_: as used; widths_: of the columns used, in units of X, (d,); left_out_std_: root mean square of the left-out
    errors in the unit of y; n_parameters_: effective degrees of freedom. model_, training_: see
    `CompensationEstimator`.
    """

    def __init__(
        self,
        gamma: float | None = None,
        sigma: float | None = None,
        trend: Literal["constant", "linear"] = "linear",
        stretch: bool = True,
    ) -> None:
        self.gamma = gamma
        self.sigma = sigma
        self.trend = trend
        self.stretch = stretch

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "LeastSquaresSVM":
        """Fit to X (n >= 2, k) and y (n,); groups: label of each row, (n,), to tune by leaving out whole groups."""
        require(self.trend in _TREND_DEGREE, self, "trend", self.trend, "'constant', 'linear'")
        for name, value in (("gamma", self.gamma), ("sigma", self.sigma)):
            require(value is None or value > 0.0, self, name, value, "a number above 0, or None to tune it")
        inputs, target = self._checked(X, y)
        require_rows(self, len(target))
        scaling = Scaling.of(inputs)
        scaled, (scaled_target, mean, std) = scaling.apply(inputs), scale_target(target)
        powers = monomial_powers(scaled.shape[1], _TREND_DEGREE[self.trend])
        search = WidthSearch(scaled, scaled_target, monomials(scaled, powers), checked_groups(groups, len(target)))
        best = self._search(search)
        weights, coefficients = best.system.solve(scaled_target, 1.0 / best.gamma)
        self.gamma_, self.widths_ = best.gamma, best.widths * scaling.std
        self.left_out_std_ = std * float(np.sqrt(best.error))
        self.n_parameters_ = best.system.freedom(1.0 / best.gamma)
        # The kernel sees z / width, the trend was solved on z.
        coefficients = coefficients * np.prod(best.widths**powers, axis=1)
        model = KernelModel(
            scaling.columns,
            scaling.mean,
            self.widths_,
            "gaussian",
            scaled / best.widths,
            weights,
            powers,
            coefficients,
            mean,
            std,
        )
        self._keep(model, inputs, target)
        return self

    def _search(self, search: WidthSearch) -> Machine:
        gammas = GAMMAS if self.gamma is None else np.array([self.gamma])
        if self.sigma is not None:
            return search.common(np.array([self.sigma]), gammas)
        best = search.common(WIDTHS, gammas)
        return search.stretched(best, gammas) if self.stretch else best


def published() -> LeastSquaresSVM:
    """Untuned, as the paper of reference experiment `ts` has it: gamma = 10, sigma = 1 in scaled units."""
    return LeastSquaresSVM(gamma=10.0, sigma=1.0)


def tuned() -> LeastSquaresSVM:
    """Tuned by exact leave-one-out."""
    return LeastSquaresSVM()
