"""Takagi-Sugeno rules: Gaussian antecedents, linear consequents (reference experiment `ts`).

Rule j: membership A_jk(x) = exp(-(x_k - v_jk)^2 / (2 sigma_jk^2)), firing strength w_j = prod_k A_jk,
g_j = a_j0 + sum_k a_jk x_k, output y = sum_j w_j g_j / sum_j w_j.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.scaling import Scaling

# Rows worked on at a time: rules x rows of float64 stay inside a core's level-2 cache.
_CHUNK_ROWS = 4096


def firing_strengths(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """exp(-s/2) over its sum over rules; squares (rules, n): sum_k ((x_k - v_k) / sigma_k)^2. Works in place.

    The largest log weight of a row is subtracted before exponentiating; otherwise all rules underflow far from the
    data and the quotient is 0/0 (fitting notes, section 3).
    """
    squares *= -0.5
    squares -= squares.max(axis=0)
    np.exp(squares, out=squares)
    squares /= squares.sum(axis=0)
    return squares


@dataclass(frozen=True)
class Antecedents:
    """Where each rule is at home: centres and widths, both of shape (rules, inputs), in the units of the inputs."""

    centres: NDArray[np.float64]
    widths: NDArray[np.float64]

    def firing(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normalised firing strengths of inputs (n, inputs): shape (rules, n), each column sums to 1."""
        squares = np.zeros((len(self.centres), len(inputs)))
        for k in range(inputs.shape[1]):
            scaled = (inputs[:, k] - self.centres[:, k, np.newaxis]) * (1.0 / self.widths[:, k, np.newaxis])
            scaled *= scaled
            squares += scaled
        return firing_strengths(squares)

    def regressors(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Firing strength x [1, inputs], shape (n, rules * (inputs + 1)): the matrix the consequents are fitted on."""
        extended = np.column_stack([np.ones(len(inputs)), inputs])
        products = self.firing(inputs).T[:, :, np.newaxis] * extended[:, np.newaxis, :]
        return products.reshape(len(inputs), -1)

    def ordered(self) -> "Antecedents":
        """The same rules sorted by their centres, first input first: clustering numbers its rules at random."""
        order = np.lexsort(self.centres.T[::-1]) if self.centres.shape[1] else np.arange(len(self.centres))
        return Antecedents(self.centres[order], self.widths[order])

    def in_units_of(self, scaling: Scaling) -> "Antecedents":
        """From z-scores to the units of the scaled columns."""
        return Antecedents(scaling.mean + scaling.std * self.centres, scaling.std * self.widths)


@dataclass(frozen=True)
class RuleModel:
    """A complete Takagi-Sugeno model in the units of its inputs and output.

    antecedents: of the columns used, shape (rules, d).
    consequents: a_j0, a_j1 ... a_jd of every rule, shape (rules, d + 1).
    columns: which input columns the rules look at, shape (d,); the others were constant in training.
    """

    antecedents: Antecedents
    consequents: NDArray[np.float64]
    columns: NDArray[np.intp]

    def predict(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output for inputs (n, k): shape (n,). Elementwise only, so a row's result does not depend on its batch."""
        output = np.empty(len(inputs))
        for first in range(0, len(inputs), _CHUNK_ROWS):
            rows = slice(first, first + _CHUNK_ROWS)
            output[rows] = self._predict_chunk(inputs[rows][:, self.columns])
        return output

    def _predict_chunk(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = np.ascontiguousarray(inputs.T)
        values = np.repeat(self.consequents[:, :1], len(inputs), axis=1)
        for k, column in enumerate(columns):
            values += self.consequents[:, k + 1, np.newaxis] * column
        values *= self.antecedents.firing(columns.T)
        output: NDArray[np.float64] = values[0].copy()
        for row in values[1:]:
            output += row
        return output
