"""Smoothing radial basis interpolation: the quintic polyharmonic spline with a quadratic trend.

The same spline as scipy's RBFInterpolator(kernel="quintic"), on z-scores, with the smoothing chosen by the exact
leave-one-out error, which needs the decomposition that `fitting.kernel_system` keeps.
"""

import numpy as np
from numpy.typing import ArrayLike

from fitting.blas import one_thread
from fitting.estimator import CompensationEstimator, checked_groups, require, require_rows
from fitting.kernel_system import KernelSystem
from fitting.kernels import KernelModel, monomial_powers, monomials, quintic, squared_distances
from fitting.scaling import Scaling, scale_target

_DEGREE = 2
_TRIED = 10.0 ** np.linspace(-14.0, 2.0, 49)


class RadialBasisSpline(CompensationEstimator):
    """Quintic spline through or near the training rows.

    Parameters: smoothing, in the z-scored problem, 0 interpolates; None chooses it by leave-one-out, or with groups
    given to `fit` by leaving whole groups out.

    Attributes: smoothing_, as used; left_out_std_, root mean square of the left-out errors in the unit of y, NaN when
    nothing was chosen; n_parameters_, effective degrees of freedom. model_, training_: see `CompensationEstimator`.
    """

    def __init__(self, smoothing: float | None = None) -> None:
        self.smoothing = smoothing

    @one_thread()
    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> "RadialBasisSpline":
        """Fit to X (n >= 2, k) and y (n,); groups: label of each row, (n,), to leave out whole groups."""
        smoothing = self.smoothing
        require(smoothing is None or smoothing >= 0.0, self, "smoothing", smoothing, "0 or more, or None to choose it")
        inputs, target = self._checked(X, y)
        require_rows(self, len(target))
        numbers = checked_groups(groups, len(target))
        scaling = Scaling.of(inputs)
        scaled, (scaled_target, mean, std) = scaling.apply(inputs), scale_target(target)
        powers = monomial_powers(scaled.shape[1], _DEGREE)
        system = KernelSystem(quintic(squared_distances(scaled, scaled)), monomials(scaled, powers))
        self.left_out_std_ = float("nan")
        if smoothing is None:
            # Largest eigenvalue as the scale: the kernel grows with the fifth power of distances.
            scale = float(system.values.max(initial=np.finfo(np.float64).tiny))
            found = system.tune(scaled_target, scale * _TRIED, numbers)
            smoothing, self.left_out_std_ = found.ridge, std * float(np.sqrt(found.error))
        self.smoothing_ = smoothing
        self.n_parameters_ = system.freedom(smoothing)
        weights, coefficients = system.solve(scaled_target, smoothing)
        model = KernelModel(
            scaling.columns, scaling.mean, scaling.std, "quintic", scaled, weights, powers, coefficients, mean, std
        )
        self._keep(model, inputs, target)
        return self
