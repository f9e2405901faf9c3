"""One reported figure. A number without its definition is not a figure."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from fitting.random_errors.confidence import chi_square_factors

COVERAGE = 0.95


@dataclass(frozen=True)
class Figure:
    """value in `unit`, with its standard uncertainty u, the limits low and high for 95 %, and n observations.

    definition: what was computed, with its parameters, in words; source: the clause it follows. u, low and high are
    NaN where they cannot be stated.
    """

    name: str
    symbol: str
    value: float
    unit: str
    u: float
    low: float
    high: float
    n: int
    definition: str
    source: str

    def record(self) -> Mapping[str, Any]:
        """As plain values, for JSON; NaN becomes None."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()}


def with_u(
    name: str, symbol: str, value: float, unit: str, *, u: float, dof: float, n: int, definition: str, source: str
) -> Figure:
    """A figure whose limits follow from u by Student's t with `dof` degrees of freedom."""
    half = float(stdtrit(dof, 0.5 + 0.5 * COVERAGE)) * u if np.isfinite(dof) else 1.959963984540054 * u
    return Figure(
        name, symbol, float(value), unit, float(u), float(value - half), float(value + half), n, definition, source
    )


def standard_deviation(
    deviations: NDArray[np.float64],
    name: str,
    symbol: str,
    unit: str,
    *,
    fitted: int = 1,
    scale: float = 1.0,
    definition: str,
    source: str,
) -> Figure:
    """scale times the standard deviation of n values, with chi-square limits for n - fitted degrees of freedom.

    deviations (n,): from their mean, for which fitted = 1, or from whatever was fitted to them with more parameters.
    """
    n = len(deviations)
    dof = n - fitted
    if dof < 1:
        raise ValueError(f"{name}: {n} values. Allowed: {fitted + 1} or more, or there is no spread to speak of")
    value = scale * float(np.sqrt(deviations @ deviations / dof))
    low, high = chi_square_factors(dof, COVERAGE)
    u = value / float(np.sqrt(2.0 * dof))
    return Figure(name, symbol, value, unit, u, value * float(low), value * float(high), n, definition, source)
