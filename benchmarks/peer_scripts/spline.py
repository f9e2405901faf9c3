"""scipy's radial basis functions."""

from typing import Any

from handover import Correction, main
from scipy.interpolate import RBFInterpolator


class Spline:
    """RBFInterpolator behind fit and predict."""

    def fit(self, X: Any, y: Any) -> None:
        self.spline = RBFInterpolator(X, y, kernel="quintic")

    def predict(self, X: Any) -> Any:
        return self.spline(X)


if __name__ == "__main__":
    main("scipy", {"quintic": lambda: Correction(Spline())})
