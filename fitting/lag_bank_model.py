"""The lag bank's terms, and the model made of them that knows where it may be trusted."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from fitting.linear import LinearModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LagBankTerms:
    """The terms of the model, in the units of the features.

    middle, half_range: of the temperature, column 0, so that x = (T - middle) / half_range is in [-1, 1] in training;
    half_range 0 for a constant temperature. degree: of the Chebyshev polynomial in x. columns: the other features that
    vary, (d,), with their mean and std. cross: whether each of them also enters multiplied by x.
    """

    middle: float
    half_range: float
    degree: int
    columns: NDArray[np.intp]
    mean: Array
    std: Array
    cross: bool

    @property
    def count(self) -> int:
        """Number of terms, without the constant."""
        return self.degree + len(self.columns) * (2 if self.cross else 1)

    def chosen(self, degree: int, cross: bool, others: int) -> "LagBankTerms":
        """Some of these terms: of lower degree, with or without cross terms, with the first of the other features."""
        used = slice(0, others)
        columns, mean, std = self.columns[used], self.mean[used], self.std[used]
        return LagBankTerms(self.middle, self.half_range, degree, columns, mean, std, cross)

    def design(self, inputs: Array) -> Array:
        """The terms for features (n, k): T_j(x) / j^2, the other features z-scored, and those times x; (n, count).

        The Chebyshev coefficients of a smooth function fall; a ridge on terms that fall says so, where a cycle that
        dwells at two temperatures only says little about what is between.
        """
        x = (inputs[:, 0] - self.middle) / (self.half_range or 1.0)
        others = (inputs[:, self.columns] - self.mean) / self.std
        polynomial = chebyshev.chebvander(x, self.degree)[:, 1:] / np.arange(1.0, self.degree + 1.0) ** 2
        parts = [polynomial, others]
        return np.hstack([*parts, others * x[:, np.newaxis]] if self.cross else parts)


@dataclass(frozen=True)
class Guard:
    """Where the training rows were: the box low..high of the features, (k,), and an ellipsoid of the terms.

    A row is outside the ellipsoid if |whitening (terms - centre)|^2 > 1; centre (p,) and whitening (p, p) make this its
    leverage (the variance of its prediction for unit noise) in units of the largest allowed. The box alone
    does not see combinations that never occurred: trained on cooling only, products of temperature and slope were 14
    white floors off inside the box of the warming half.
    """

    low: Array
    high: Array
    centre: Array
    whitening: Array

    def inside(self, inputs: Array, design: Array) -> NDArray[np.bool_]:
        """Which rows of features (n, k) with terms (n, p) lie in both; a NaN lies outside."""
        with np.errstate(over="ignore", invalid="ignore"):  # far outside
            leverage = np.sum(((design - self.centre) @ self.whitening.T) ** 2, axis=1)
        return np.asarray(((inputs >= self.low) & (inputs <= self.high)).all(axis=1) & (leverage <= 1.0))


@dataclass(frozen=True)
class LagBankModel:
    """constant + terms x coefficients inside the guard; outside, `fallback`, which is linear in the features.

    fitting_notes.md, section 6: outside its data everything flexible was worse than linear.
    """

    terms: LagBankTerms
    constant: float
    coefficients: Array
    guard: Guard
    fallback: LinearModel

    def inside(self, inputs: Array) -> NDArray[np.bool_]:
        """Which rows of features (n, k) the model may be trusted at; a NaN lies outside."""
        with np.errstate(over="ignore", invalid="ignore"):
            design = self.terms.design(inputs)
        return self.guard.inside(inputs, design)

    def predict(self, inputs: Array) -> Array:
        """Bias for features (n, k), (n,); summed term by term, so a row's result does not depend on its batch."""
        with np.errstate(over="ignore", invalid="ignore"):  # far outside, where the fallback answers
            design = self.terms.design(inputs)
            output = np.full(len(inputs), self.constant)
            for coefficient, term in zip(self.coefficients, design.T, strict=True):
                output += coefficient * term
        return np.where(self.guard.inside(inputs, design), output, self.fallback.predict(inputs))
