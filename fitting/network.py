"""The back-propagation network of reference experiments `ts` and `bp` as a scikit-learn regressor."""

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.blas import one_thread
from fitting.network_core import Activation, NetworkModel, Shape, random_weights
from fitting.network_training import Trained, descend, levenberg_marquardt
from fitting.scaling import Scaling, scale_target
from fitting.training import TrainingRecord

Training = Literal["gradient", "levenberg_marquardt"]

# Published for gradient descent: 1000 epochs, mean square 1e-5. A walk to a minimum is over in some hundred steps.
_DEFAULT_EPOCHS = {"gradient": 1000, "levenberg_marquardt": 300}
_DEFAULT_GOAL = {"gradient": 1e-5, "levenberg_marquardt": 0.0}


class BackPropagationNetwork(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """One hidden layer, linear output; X (n, k) and y (n,) are z-scored inside, constant columns are left out.

    Parameters
    ----------
    hidden: number of hidden units. activation: theirs, 'sigmoid' as published or 'tanh'.
    training: 'gradient' descent as published, or 'levenberg_marquardt' with the output weights solved at every step.
    learning_rate: of gradient descent on the mean squared error of the z-scored problem; the published 0.1 is too high
        for some twenty hidden units or more, which `converged_` and the training residual show.
    epochs: most passes over the rows (None: 1000 for gradient descent, 300 steps for Levenberg-Marquardt).
    goal: mean squared error, as a share of the variance of y, at which training stops (None: 1e-5 and 0).
    weight_decay: weight of the mean square of the weights in the cost.
    linear_path: whether the inputs also go straight to the output; a network that has to learn a small correction to
        one of its inputs need not build a straight line out of sigmoids then.
    n_starts: random starts; the one with the lowest training error is kept.
    random_state: of the starts.

    Attributes: model_ (weights on z-scores); n_iter_, converged_: of the start that was kept; loss_: its mean squared
    error as a share of the variance of y; scaling_, target_mean_, target_std_; training_.
    """

    def __init__(
        self,
        hidden: int = 10,
        training: Training = "gradient",
        learning_rate: float = 0.1,
        epochs: int | None = None,
        goal: float | None = None,
        n_starts: int = 1,
        activation: Activation = "sigmoid",
        weight_decay: float = 0.0,
        linear_path: bool = False,
        random_state: Any = 0,
    ) -> None:
        self.hidden = hidden
        self.training = training
        self.learning_rate = learning_rate
        self.epochs = epochs
        self.goal = goal
        self.n_starts = n_starts
        self.activation = activation
        self.weight_decay = weight_decay
        self.linear_path = linear_path
        self.random_state = random_state

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike) -> "BackPropagationNetwork":
        """Fit to X (n >= 2, k) and y (n,). ValueError for a bad parameter or for values that are not finite."""
        epochs, goal = self._check()
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        target = np.asarray(target, dtype=np.float64)
        self.scaling_ = Scaling.of(inputs)
        scaled_target, self.target_mean_, self.target_std_ = scale_target(target)
        scaled = self.scaling_.apply(inputs)
        shape = Shape(scaled.shape[1], self.hidden, self.activation, self.linear_path)
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        starts = [random_weights(shape, rng) for _ in range(self.n_starts)]
        runs = [
            train(
                self.training, shape, start, scaled, scaled_target, self.learning_rate, epochs, goal, self.weight_decay
            )
            for start in starts
        ]
        best = min(runs, key=lambda run: run.mean_square)
        self.n_iter_, self.converged_, self.loss_ = max(best.epochs, 1), best.converged, best.mean_square
        self.model_ = NetworkModel(shape, best.weights, self.scaling_, self.target_mean_, self.target_std_)
        self.training_ = TrainingRecord.of(inputs, target, self.model_.predict(inputs))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Output for X (n, k), shape (n,). ValueError for values that are not finite."""
        check_is_fitted(self, "model_")
        return self.model_.predict(validate_data(self, X, dtype=np.float64, reset=False))

    def _check(self) -> tuple[int, float]:
        """Epochs and goal, after a look at all parameters."""
        name = type(self).__name__
        one_of(name, "training", self.training, tuple(_DEFAULT_EPOCHS))
        one_of(name, "activation", self.activation, ("sigmoid", "tanh"))
        epochs = _DEFAULT_EPOCHS[self.training] if self.epochs is None else self.epochs
        goal = _DEFAULT_GOAL[self.training] if self.goal is None else self.goal
        whole_from_one(name, hidden=self.hidden, n_starts=self.n_starts, epochs=epochs)
        from_zero(name, learning_rate=self.learning_rate, goal=goal, weight_decay=self.weight_decay)
        return epochs, goal


def train(
    training: Training,
    shape: Shape,
    start: NDArray[np.float64],
    inputs: NDArray[np.float64],
    target: NDArray[np.float64],
    learning_rate: float,
    epochs: int,
    goal: float,
    decay: float,
) -> Trained:
    """Train from given weights on z-scores, either way."""
    if training == "gradient":
        return descend(shape, start, inputs, target, rate=learning_rate, epochs=epochs, goal=goal, decay=decay)
    return levenberg_marquardt(shape, start, inputs, target, epochs=epochs, goal=goal, decay=decay)


def one_of(estimator: str, name: str, value: object, allowed: tuple[str, ...]) -> None:
    """ValueError unless value is one of the allowed words."""
    if value not in allowed:
        raise ValueError(f"{estimator}: {name} is {value!r}; allowed: {', '.join(map(repr, allowed))}.")


def whole_from_one(estimator: str, **values: object) -> None:
    """ValueError unless all values are whole numbers of at least 1."""
    for name, value in values.items():
        if not isinstance(value, int | np.integer) or value < 1:
            raise ValueError(f"{estimator}: {name} is {value!r}; allowed: a whole number of at least 1.")


def from_zero(estimator: str, **values: float) -> None:
    """ValueError unless all values are finite and not negative."""
    for name, value in values.items():
        if not 0.0 <= value < np.inf:
            raise ValueError(f"{estimator}: {name} is {value!r}; allowed: a finite number of 0 or more.")


def published() -> BackPropagationNetwork:
    """The papers' network: sigmoid units, gradient descent with rate 0.1, 1000 epochs, goal 1e-5."""
    return BackPropagationNetwork()


def second_order() -> BackPropagationNetwork:
    """Twenty tanh units beside a linear path, three starts of Levenberg-Marquardt."""
    return BackPropagationNetwork(20, "levenberg_marquardt", n_starts=3, activation="tanh", linear_path=True)
