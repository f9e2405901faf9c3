"""What the estimators of this package have in common: checked data in, a pure model and a record of the fit out."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from fitting.training import TrainingRecord

# A kernel matrix of so many rows is 200 MB and takes minutes to decompose.
MOST_KERNEL_ROWS = 5000


class PureModel(Protocol):
    """A fitted model in the units of its inputs and output."""

    def predict(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output for inputs (n, k): shape (n,)."""


class CompensationEstimator(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """A scikit-learn regressor around a pure model.

    X (n, k) is what the compensation knows, in the campaign [temperature_degc, rate_dps as the gyro gave it]; y (n,) is
    what it should give, there the true rate. Attributes: model_, the pure model; training_, hash, range and residuals.
    """

    model_: PureModel
    training_: TrainingRecord

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Output for X (n, k), shape (n,). ValueError for values that are not finite."""
        check_is_fitted(self, "model_")
        return self.model_.predict(validate_data(self, X, dtype=np.float64, reset=False))

    def _checked(self, X: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """X (n >= 2, k) and y (n,) as float64. ValueError for values that are not finite."""
        inputs, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        return inputs, np.asarray(target, dtype=np.float64)

    def _keep(self, model: PureModel, inputs: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the model, record the fit, and give its residuals, prediction - y."""
        self.model_ = model
        prediction = model.predict(inputs)
        self.training_ = TrainingRecord.of(inputs, target, prediction)
        return prediction - target


def checked_groups(groups: ArrayLike | None, n_rows: int) -> NDArray[np.intp] | None:
    """Group number of every row, counted from 0, shape (n,); ValueError for another length or a single group."""
    if groups is None:
        return None
    labels = np.asarray(groups)
    if labels.shape != (n_rows,):
        raise ValueError(f"groups has shape {labels.shape}; expected one label per row of X, ({n_rows},).")
    names, numbers = np.unique(labels, return_inverse=True)
    if len(names) < 2:
        raise ValueError("groups names a single group; it takes at least 2 to leave one out.")
    return np.asarray(numbers, dtype=np.intp)


def require(condition: bool, estimator: object, name: str, value: object, allowed: str) -> None:
    """ValueError naming a parameter, its value and what is allowed, unless the condition holds."""
    if not condition:
        raise ValueError(f"{type(estimator).__name__}: {name} is {value!r}; allowed: {allowed}.")


def require_rows(estimator: object, n_rows: int) -> None:
    """ValueError if a method that works on all pairs of rows gets too many of them."""
    if n_rows > MOST_KERNEL_ROWS:
        raise ValueError(
            f"{type(estimator).__name__}: {n_rows} rows; allowed: up to {MOST_KERNEL_ROWS}, because it works on all "
            "pairs of rows. Average the record first (100 s a row is usual)."
        )
