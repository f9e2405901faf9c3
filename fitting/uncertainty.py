"""Uncertainty budgets in the terms of the GUM (JCGM 100), and that of a compensated rate."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, radians, sqrt
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from fitting.earth import horizontal_dph
from fitting.random_errors.mean import NoiseOfMean

# What a value is divided by to give a standard uncertainty (GUM 4.3): half-widths, but for the normal distribution.
DIVISORS = MappingProxyType({"normal": 1.0, "rectangular": sqrt(3.0), "triangular": sqrt(6.0), "arcsine": sqrt(2.0)})
_DPH_PER_DPS = 3600.0
_ARCMIN = radians(1.0 / 60.0)


@dataclass(frozen=True)
class BudgetRow:
    """One source: `value` in `unit`, with its distribution and degrees of freedom; sensitivity in deg/h per unit.

    kind: "A" by statistics of observations, "B" otherwise.
    """

    source: str
    kind: str
    distribution: str
    value: float
    unit: str
    sensitivity: float
    dof: float = inf

    def __post_init__(self) -> None:
        if self.distribution not in DIVISORS or self.kind not in ("A", "B"):
            raise ValueError(
                f"{self.source}: type {self.kind!r}, distribution {self.distribution!r}. "
                f"Allowed: types A, B; distributions {', '.join(DIVISORS)}"
            )
        if not (isfinite(self.value) and self.value >= 0.0 and isfinite(self.sensitivity) and self.dof > 0.0):
            raise ValueError(
                f"{self.source}: value {self.value}, sensitivity {self.sensitivity}, dof {self.dof}. "
                "Allowed: finite, value at least 0, dof above 0"
            )

    @property
    def divisor(self) -> float:
        """From value to standard uncertainty."""
        return DIVISORS[self.distribution]

    @property
    def contribution_dph(self) -> float:
        """|sensitivity| value / divisor, in deg/h."""
        return abs(self.sensitivity) * self.value / self.divisor


@dataclass(frozen=True)
class Budget:
    """Rows, their root sum of squares u, effective degrees of freedom (Welch-Satterthwaite), k and U = k u; deg/h."""

    rows: tuple[BudgetRow, ...]
    coverage: float
    u_dph: float
    dof: float
    k: float
    expanded_dph: float


def combine(rows: Sequence[BudgetRow], coverage: float = 0.95) -> Budget:
    """Combine independent sources (GUM 5.1, G.4); k is Student's t for the effective degrees of freedom.

    Where one rectangular source outweighs all others together, k u is up to 1.19 times the half-width that holds
    95 % (GUM G.6.5): on the safe side.
    """
    contributions = np.array([row.contribution_dph for row in rows])
    u = float(np.sqrt(np.sum(contributions**2)))
    dofs = np.array([row.dof for row in rows])
    below = float(np.sum((contributions / u) ** 4 / dofs)) if u > 0.0 else 0.0
    dof = 1.0 / below if below > 0.0 else inf
    # stdtrit wants a finite number; 1e9 degrees of freedom are the normal distribution to ten digits.
    k = float(stdtrit(min(dof, 1e9), 0.5 + 0.5 * coverage))
    return Budget(tuple(rows), coverage, u, dof, k, k * u)


@dataclass(frozen=True)
class RateConditions:
    """One compensated point and what is known of its circumstances.

    temperature_degc, output_dps: what goes into the model; reference_dps: the table's rate, counter-clockwise
    positive. noise: of the mean output over the dwell, deg/h. The rest are half-widths of rectangular distributions:
    table_ppm, sensor_degc, latitude_half_deg; tilt_arcmin: of the input axis from the vertical, taken as towards
    north, the direction that matters. residual_dps: standard deviation of the model's residuals with temperatures left
    out, residual_dof: their number less what was fitted.
    """

    temperature_degc: float
    output_dps: float
    reference_dps: float
    noise: NoiseOfMean
    table_ppm: float
    sensor_degc: float
    latitude_deg: float
    latitude_half_deg: float
    tilt_arcmin: float
    residual_dps: float
    residual_dof: float


def compensated_rate_budget(
    predict: Callable[[NDArray[np.float64]], NDArray[np.float64]], at: RateConditions, coverage: float = 0.95
) -> Budget:
    """Budget of the compensated rate minus the true one; predict: X (n, 2) [temperature_degc, output_dps] to deg/s.

    Sensitivities to temperature and output are central differences of the model over the range in question. The
    residuals with temperatures left out hold what a dwell's noise does to the model: a part of the noise is counted
    twice, which errs on the safe side.
    """
    output_step = max(1e-6 * abs(at.output_dps), 3.0 * at.noise.u / _DPH_PER_DPS, 1e-6)
    by_output = _slope(predict, at, np.array([0.0, output_step]))
    by_temperature = _slope(predict, at, np.array([max(at.sensor_degc, 1e-3), 0.0])) * _DPH_PER_DPS
    horizontal = horizontal_dph(at.latitude_deg)
    vertical_by_latitude = horizontal * radians(1.0)
    rows = (
        BudgetRow("gyro noise, correlated", "A", "normal", at.noise.u, "deg/h", by_output, at.noise.dof),
        BudgetRow("table rate", "B", "rectangular", at.table_ppm, "ppm", at.reference_dps * _DPH_PER_DPS * 1e-6),
        BudgetRow("temperature sensor", "B", "rectangular", at.sensor_degc, "degC", by_temperature),
        BudgetRow("earth rate: latitude", "B", "rectangular", at.latitude_half_deg, "deg", vertical_by_latitude),
        BudgetRow("earth rate: tilt", "B", "rectangular", at.tilt_arcmin, "arcmin", horizontal * _ARCMIN),
        BudgetRow(
            "model residual", "A", "normal", at.residual_dps * _DPH_PER_DPS, "deg/h", 1.0, max(at.residual_dof, 1.0)
        ),
    )
    return combine(rows, coverage)


def _slope(
    predict: Callable[[NDArray[np.float64]], NDArray[np.float64]], at: RateConditions, step: NDArray[np.float64]
) -> float:
    """Central difference of the model along one input, in deg/s per unit."""
    point = np.array([at.temperature_degc, at.output_dps])
    above, below = predict(np.array([point + step, point - step]))
    return float(above - below) / (2.0 * float(step.sum()))
