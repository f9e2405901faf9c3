"""Linear compensation: true rate = c0 + c1 temperature + c2 output, the baseline of reference experiment `ts`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.blas import one_thread
from fitting.consequents import batch
from fitting.scaling import Scaling, scale_target
from fitting.training import TrainingRecord, unit_variance


@dataclass(frozen=True)
class LinearModel:
    """y = coefficients[0] + sum_k coefficients[k + 1] x_k, in the units of x and y; coefficients: (k + 1,)."""

    coefficients: NDArray[np.float64]

    def predict(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output for inputs (n, k): shape (n,). Elementwise only, so a row's result does not depend on its batch."""
        output = np.full(len(inputs), self.coefficients[0])
        for k, column in enumerate(inputs.T):
            output += self.coefficients[k + 1] * column
        return output


class LinearCompensation(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Least squares on [1, X]; X (n, k), in the campaign [temperature_degc, rate_dps as given], y the true rate.

    Attributes, in the units of X and y: coefficients_ (k + 1,), zero for a constant column; coefficients_u_ (k + 1,),
    standard uncertainties for white residuals, NaN if there are no more rows than coefficients; scaling_,
    target_mean_, target_std_; n_parameters_, of columns that vary; training_ (hash, ranges, residuals).
    """

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike) -> "LinearCompensation":
        """Fit to X (n, k) and y (n,). ValueError for values that are not finite."""
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True)
        target = np.asarray(target, dtype=np.float64)
        self.scaling_ = Scaling.of(inputs)
        scaled_target, self.target_mean_, self.target_std_ = scale_target(target)
        scaled = self.scaling_.apply(inputs)
        solution = batch(np.column_stack([np.ones(len(target)), scaled]), scaled_target, 0.0)
        self._set_coefficients(solution.theta, solution.unit_covariance, inputs.shape[1])
        self.n_parameters_ = len(solution.theta)
        self.model_ = LinearModel(self.coefficients_)
        prediction = self.model_.predict(inputs)
        self.training_ = TrainingRecord.of(inputs, target, prediction)
        self.coefficients_u_ *= np.sqrt(unit_variance(prediction - target, len(solution.theta)))
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Compensated rate of X (n, k), shape (n,). ValueError for values that are not finite."""
        check_is_fitted(self, "model_")
        inputs = validate_data(self, X, dtype=np.float64, reset=False)
        return self.model_.predict(inputs)

    def _set_coefficients(self, theta: NDArray[np.float64], covariance: NDArray[np.float64], n_inputs: int) -> None:
        """From z-scores to the units of X and y, with zeros for the columns left out."""
        used = self.scaling_.columns + 1
        to_units = np.zeros((n_inputs + 1, len(theta)))
        to_units[0, 0] = self.target_std_
        to_units[0, 1:] = -self.target_std_ * self.scaling_.mean / self.scaling_.std
        to_units[used, np.arange(1, len(theta))] = self.target_std_ / self.scaling_.std
        self.coefficients_ = to_units @ theta
        self.coefficients_[0] += self.target_mean_
        variances = np.einsum("ab,bc,ac->a", to_units, covariance, to_units) / self.target_std_**2
        self.coefficients_u_ = np.sqrt(np.maximum(variances, 0.0))
