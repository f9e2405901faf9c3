"""One hidden layer with a linear output, as functions of one vector of weights; vectorised over many such vectors.

Weights of a network with d inputs and h hidden units, p = h (d + 2) + 1 (+ d with a linear path):
[input weights (h, d) | thresholds (h,) | output weights (h,) | constant | linear path (d,)].
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from fitting.scaling import Scaling

Array = NDArray[np.float64]
Activation = Literal["sigmoid", "tanh"]

# value and slope (from the value) of the hidden units
_ACTIVATIONS: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "sigmoid": (expit, lambda value: value * (1.0 - value)),
    "tanh": (np.tanh, lambda value: 1.0 - value * value),
}


@dataclass(frozen=True)
class Shape:
    """d inputs, h hidden units, their activation, and whether the inputs also go straight to the output."""

    inputs: int
    hidden: int
    activation: Activation
    linear_path: bool = False

    @property
    def size(self) -> int:
        """Number of weights."""
        return self.hidden * (self.inputs + 2) + 1 + (self.inputs if self.linear_path else 0)

    @property
    def nonlinear(self) -> int:
        """Number of weights, first in the vector, that the output is not linear in."""
        return self.hidden * (self.inputs + 1)

    def hidden_weights(self, weights: Array) -> tuple[Array, Array]:
        """Input weights (..., h, d) and thresholds (..., h) of vectors (..., nonlinear or more)."""
        edge = self.hidden * self.inputs
        return weights[..., :edge].reshape(*weights.shape[:-1], self.hidden, self.inputs), weights[
            ..., edge : self.nonlinear
        ]

    def hidden_values(self, weights: Array, inputs: Array) -> Array:
        """Output of the hidden units for inputs (n, d): (..., h, n)."""
        into, thresholds = self.hidden_weights(weights)
        return _ACTIVATIONS[self.activation][0](into @ inputs.T + thresholds[..., np.newaxis])

    def slopes(self, values: Array) -> Array:
        """Derivative of the hidden units, from their output."""
        return _ACTIVATIONS[self.activation][1](values)

    def output(self, weights: Array, inputs: Array) -> Array:
        """Network output for weights (..., p) and inputs (n, d): (..., n)."""
        linear = weights[..., self.nonlinear :]
        values = self.hidden_values(weights, inputs)
        output: Array = (linear[..., np.newaxis, : self.hidden] @ values)[..., 0, :]
        output += linear[..., self.hidden, np.newaxis]
        if self.linear_path:
            output += linear[..., self.hidden + 1 :] @ inputs.T
        return output

    def gradient(self, weights: Array, inputs: Array, target: Array) -> tuple[float, Array]:
        """Mean squared error of one network (p,) against target (n,), and its gradient (p,): back-propagation."""
        values = self.hidden_values(weights, inputs)
        linear = weights[self.nonlinear :]
        error = linear[: self.hidden] @ values + linear[self.hidden] - target
        if self.linear_path:
            error += inputs @ linear[self.hidden + 1 :]
        delta = self.slopes(values) * linear[: self.hidden, np.newaxis] * error
        parts = [(delta @ inputs).ravel(), delta.sum(axis=1), values @ error, [error.sum()]]
        if self.linear_path:
            parts.append(inputs.T @ error)
        return float(error @ error) / len(target), np.concatenate(parts) * (2.0 / len(target))


def random_weights(shape: Shape, rng: np.random.Generator) -> Array:
    """A start for z-scored inputs: hidden units spread over the data (Nguyen and Widrow, 1990)."""
    directions = rng.standard_normal((shape.hidden, shape.inputs))
    lengths = np.sqrt(np.sum(directions**2, axis=1, keepdims=True))
    # their 0.7 h^(1/d) is for inputs in [-1, 1] and tanh; z-scores reach about twice as far, a sigmoid is half as steep
    size = 0.7 * shape.hidden ** (1.0 / max(shape.inputs, 1)) * (1.0 if shape.activation == "sigmoid" else 0.5)
    into = size * directions / np.maximum(lengths, np.finfo(np.float64).tiny)
    thresholds = rng.uniform(-2.0 * size, 2.0 * size, shape.hidden)
    rest = rng.uniform(-0.5, 0.5, shape.size - shape.nonlinear)
    return np.concatenate([into.ravel(), thresholds, rest])


@dataclass(frozen=True)
class NetworkModel:
    """A trained network on the z-scores of the inputs that vary; target_mean, target_std take its output to units."""

    shape: Shape
    weights: Array
    scaling: Scaling
    target_mean: float
    target_std: float

    def predict(self, inputs: Array) -> Array:
        """Output for inputs (n, k): (n,)."""
        return self.target_mean + self.target_std * self.shape.output(self.weights, self.scaling.apply(inputs))
