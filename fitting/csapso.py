"""The network of reference experiment `bp` whose first weights a chaotic particle swarm finds (CSAPSO-BP)."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.blas import one_thread
from fitting.network import from_zero, one_of, train, whole_from_one
from fitting.network_core import Activation, NetworkModel, Shape
from fitting.network_training import Trained
from fitting.scaling import Scaling, scale_target
from fitting.swarm import PUBLISHED, STABLE, SwarmResult, SwarmSettings, csapso
from fitting.training import TrainingRecord

_SETTINGS = {"published": PUBLISHED, "stable": STABLE}


class CsapsoNetwork(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """One hidden layer, first weights by swarm, then `finish`; X (n, k) and y (n,) are z-scored inside.

    Parameters
    ----------
    hidden: number of hidden units; published is sqrt(inputs + outputs) + 1...10, 3 to 12 for temperature and slope.
    settings: of the swarm: 'published' (w = 0.8, c1 = c2 = 2, beyond its stability bound: `fit` warns) or 'stable'
        (w = 0.729, c1 = c2 = 1.49).
    finish: what follows: 'gradient' descent as published, 'levenberg_marquardt', or 'none' for the swarm alone.
    particles, iterations: of the swarm. start_temperature: of its acceptance of worse positions; errors here are about
        1, so that the published 1000 accepts everything for some 350 iterations.
    learning_rate, epochs, goal, activation: of the network, as in `BackPropagationNetwork`; goal is the mean squared
        error as a share of the variance of y.
    random_state: of the swarm.

    Attributes: stable_, stability_bound_: of c1 + c2; swarm_loss_: mean squared error the swarm reached, loss_ after
    the finish, both as shares of the variance of y (1 is predicting the mean); n_iter_, converged_: of the finish;
    model_; scaling_, target_mean_, target_std_; training_.
    """

    def __init__(
        self,
        hidden: int = 10,
        settings: Literal["published", "stable"] = "published",
        finish: Literal["none", "gradient", "levenberg_marquardt"] = "gradient",
        particles: int = 40,
        iterations: int = 600,
        start_temperature: float = 1000.0,
        learning_rate: float = 0.1,
        epochs: int = 1000,
        goal: float = 1e-5,
        activation: Activation = "sigmoid",
        random_state: Any = 0,
    ) -> None:
        self.hidden = hidden
        self.settings = settings
        self.finish = finish
        self.particles = particles
        self.iterations = iterations
        self.start_temperature = start_temperature
        self.learning_rate = learning_rate
        self.epochs = epochs
        self.goal = goal
        self.activation = activation
        self.random_state = random_state

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike) -> "CsapsoNetwork":
        """Fit to X (n >= 2, k) and y (n,); `UnstableSwarmWarning` for settings beyond the bound.

        ValueError for a bad parameter or for values that are not finite.
        """
        settings = self._check()
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        target = np.asarray(target, dtype=np.float64)
        settings.warn_if_unstable()
        self.stable_, self.stability_bound_ = settings.stable, settings.bound
        self.scaling_ = Scaling.of(inputs)
        scaled_target, self.target_mean_, self.target_std_ = scale_target(target)
        scaled = self.scaling_.apply(inputs)
        shape = Shape(scaled.shape[1], self.hidden, self.activation)
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        found = first_weights(shape, scaled, scaled_target, settings, rng)
        finished = self._finish(shape, found, scaled, scaled_target)
        self.swarm_loss_, self.loss_ = found.cost, finished.mean_square
        self.n_iter_, self.converged_ = max(finished.epochs, 1), finished.converged
        self.model_ = NetworkModel(shape, finished.weights, self.scaling_, self.target_mean_, self.target_std_)
        self.training_ = TrainingRecord.of(inputs, target, self.model_.predict(inputs))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Output for X (n, k), shape (n,). ValueError for values that are not finite."""
        check_is_fitted(self, "model_")
        return self.model_.predict(validate_data(self, X, dtype=np.float64, reset=False))

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        # The published swarm alone does no better than its first positions (fitting_notes.md, section 6).
        tags.regressor_tags.poor_score = self.finish == "none"
        return tags

    def _finish(
        self, shape: Shape, found: SwarmResult, inputs: NDArray[np.float64], target: NDArray[np.float64]
    ) -> Trained:
        if self.finish == "none":
            return Trained(found.best, found.cost, self.iterations, found.cost <= self.goal)
        return train(self.finish, shape, found.best, inputs, target, self.learning_rate, self.epochs, self.goal, 0.0)

    def _check(self) -> SwarmSettings:
        name = type(self).__name__
        one_of(name, "settings", self.settings, tuple(_SETTINGS))
        one_of(name, "finish", self.finish, ("none", "gradient", "levenberg_marquardt"))
        one_of(name, "activation", self.activation, ("sigmoid", "tanh"))
        whole_from_one(
            name, hidden=self.hidden, particles=self.particles, iterations=self.iterations, epochs=self.epochs
        )
        from_zero(name, learning_rate=self.learning_rate, goal=self.goal, start_temperature=self.start_temperature)
        return replace(
            _SETTINGS[self.settings],
            particles=self.particles,
            iterations=self.iterations,
            start_temperature=self.start_temperature,
        )


def first_weights(
    shape: Shape,
    inputs: NDArray[np.float64],
    target: NDArray[np.float64],
    settings: SwarmSettings,
    rng: np.random.Generator,
) -> SwarmResult:
    """Weights with the lowest mean squared error on z-scores (n, d) and (n,) that the swarm meets."""

    def mean_squares(weights: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(over="ignore", invalid="ignore"):
            error = shape.output(weights, inputs) - target
            squares: NDArray[np.float64] = np.mean(error * error, axis=-1)
        return squares

    return csapso(mean_squares, shape.size, settings, rng)
