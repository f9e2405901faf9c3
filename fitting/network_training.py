"""Two ways to train a network of one hidden layer from given weights: gradient descent and Levenberg-Marquardt.

Inputs (n, d) and targets (n,) are z-scores. Levenberg-Marquardt searches the hidden weights only; the output weights
are solved at every step (variable projection, Golub and Pereyra, 1973; Jacobian after Kaufman, 1975).
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from fitting.levenberg_marquardt import Walk
from fitting.network_core import Shape

Array = NDArray[np.float64]

# z-scores reach about 3: with input weights of this size a hidden unit is a step between two rows
_LARGEST_WEIGHT = 50.0
# of the output weights: sigmoids that look alike would otherwise get huge weights of opposite sign
_LEAST_DECAY = 1e-13


@dataclass(frozen=True)
class Trained:
    """weights (p,), their mean squared error on the training rows, the epochs it took, and whether it was at its goal
    (gradient descent) or at a minimum (Levenberg-Marquardt)."""

    weights: Array
    mean_square: float
    epochs: int
    converged: bool


def descend(
    shape: Shape, start: Array, inputs: Array, target: Array, *, rate: float, epochs: int, goal: float, decay: float
) -> Trained:
    """Gradient descent over all rows with a fixed learning rate, as published; the best weights on the way are kept.

    decay: weight of the mean square of all weights in the cost. Too high a rate ends where the error is not finite.
    """
    weights, best = start.copy(), Trained(start, np.inf, 0, False)
    for epoch in range(epochs + 1):
        with np.errstate(over="ignore", invalid="ignore"):
            mean_square, gradient = shape.gradient(weights, inputs, target)
        if not np.isfinite(mean_square):
            break
        if mean_square < best.mean_square:
            best = Trained(weights, mean_square, epoch, mean_square <= goal)
        if mean_square <= goal:
            break
        weights = weights - rate * (gradient + 2.0 * decay / len(weights) * weights)
    return best


@dataclass(frozen=True)
class _Point:
    """The reduced problem at one set of hidden weights."""

    cost: float
    parameters: Array
    values: Array  # of the hidden units, (h, n)
    basis: Array  # orthonormal columns of the output layer's regressors, upper rows, (n, q)
    residual: Array
    linear: Array  # output weights, constant, linear path, (q,)


class ProjectedNetwork:
    """min over output weights theta of |y - Phi theta|^2 + decay (|theta|^2 + |p|^2), for hidden weights p."""

    def __init__(self, shape: Shape, inputs: Array, target: Array, decay: float) -> None:
        self._shape, self._inputs, self._target = shape, inputs, target
        self._decay, self._ridge = decay, max(decay, _LEAST_DECAY * len(target))
        fixed = [np.ones((len(target), 1)), inputs] if shape.linear_path else [np.ones((len(target), 1))]
        self._fixed = np.hstack(fixed)
        self._extended = np.column_stack([inputs, np.ones(len(target))])

    def evaluate(self, parameters: Array) -> _Point:
        """Solve the output weights at p, by QR."""
        values = self._shape.hidden_values(parameters, self._inputs)
        regressors = np.hstack([values.T, self._fixed])
        stacked = np.vstack([regressors, np.sqrt(self._ridge) * np.eye(regressors.shape[1])])
        q, r = scipy.linalg.qr(stacked, mode="economic", check_finite=False, overwrite_a=True)
        basis = q[: len(self._target)]
        linear, _ = dtrtrs(r, basis.T @ self._target)
        residual = self._target - regressors @ linear
        cost = float(residual @ residual + self._ridge * linear @ linear + self._decay * parameters @ parameters)
        return _Point(cost if np.isfinite(cost) else np.inf, parameters, values, basis, residual, linear)

    def normal_equations(self, point: _Point) -> tuple[Array, Array]:
        """J'(I - QQ')J and J'r, with the decay of the hidden weights."""
        shape = self._shape
        into = shape.slopes(point.values) * point.linear[: shape.hidden, np.newaxis]
        jacobian = into[:, np.newaxis, :] * self._extended.T
        # in the order of the weights: all input weights, then all thresholds
        jacobian = np.vstack([jacobian[:, :-1].reshape(-1, into.shape[1]), jacobian[:, -1]])
        inside = jacobian @ point.basis
        curvature = jacobian @ jacobian.T - inside @ inside.T
        curvature.flat[:: len(curvature) + 1] += self._decay
        return curvature, jacobian @ point.residual - self._decay * point.parameters


def levenberg_marquardt(
    shape: Shape, start: Array, inputs: Array, target: Array, *, epochs: int, goal: float, decay: float
) -> Trained:
    """Walk from the hidden weights of start (p,) to a minimum; the start's output weights do not matter."""
    problem = ProjectedNetwork(shape, inputs, target, decay * len(target) / shape.size)
    limit = np.full(shape.nonlinear, _LARGEST_WEIGHT)
    walk = Walk(problem, start[: shape.nonlinear], (-limit, limit), tolerance=1e-4)
    reached = False
    while not (walk.converged or reached or walk.n_iter >= epochs):
        walk.advance(min(walk.n_iter + 5, epochs))
        reached = _mean_square(walk.here) <= goal
    weights = np.concatenate([walk.parameters, walk.here.linear])
    return Trained(weights, _mean_square(walk.here), walk.n_iter, walk.converged or reached)


def _mean_square(point: _Point) -> float:
    return float(point.residual @ point.residual) / len(point.residual)
