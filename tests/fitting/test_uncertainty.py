"""Budgets against the GUM's example and against Monte Carlo (GUM Supplement 1)."""

from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.earth import horizontal_dph
from fitting.random_errors.mean import NoiseOfMean
from fitting.uncertainty import Budget, BudgetRow, RateConditions, combine, compensated_rate_budget


def row(value: float, distribution: str = "normal", sensitivity: float = 1.0, dof: float = inf) -> BudgetRow:
    return BudgetRow("x", "A" if dof < inf else "B", distribution, value, "deg/h", sensitivity, dof)


def simulated_half_width(budget: Budget, seed: int = 0) -> float:
    """Half-width of the central 95 % of the sum: type A inputs are Student's t (S1, 6.4.9), type B as stated."""
    rng, n = np.random.default_rng(seed), 400_000
    total = np.zeros(n)
    for source in budget.rows:
        if source.distribution == "rectangular":
            draw = rng.uniform(-source.value, source.value, n)
        elif source.distribution == "triangular":
            draw = rng.triangular(-source.value, 0.0, source.value, n)
        elif source.distribution == "arcsine":
            draw = source.value * np.sin(rng.uniform(0.0, 2.0 * np.pi, n))
        else:
            draw = source.value * (rng.standard_t(source.dof, n) if source.dof < inf else rng.standard_normal(n))
        total += source.sensitivity * draw
    return float(np.diff(np.quantile(total, [0.025, 0.975]))[0]) / 2.0


def test_example_h1_of_the_gum() -> None:
    """End gauge: u = 32 nm, 16 effective degrees of freedom, k for 99 % = 2.92, U = 93 nm."""
    rows = [row(25.0, dof=18.0), row(9.7, dof=25.6), row(2.9, dof=50.0), row(16.6, dof=2.0)]
    budget = combine(rows, coverage=0.99)
    assert budget.u_dph == pytest.approx(31.7, abs=0.1)
    assert budget.dof == pytest.approx(16.7, abs=0.2)
    assert budget.expanded_dph == pytest.approx(93.0, abs=1.5)


@pytest.mark.parametrize(
    "rows",
    [
        [row(1.0), row(2.0, "rectangular"), row(0.5, "triangular", -3.0)],
        [row(1.0, dof=9.0), row(1.0, "rectangular"), row(1.0, "arcsine")],
        [row(1.0, dof=20.0), row(0.4, dof=6.0), row(0.3, "rectangular", 2.0)],
    ],
)
def test_expanded_uncertainty_is_that_of_monte_carlo(rows: list[BudgetRow]) -> None:
    budget = combine(rows)
    assert budget.expanded_dph == pytest.approx(simulated_half_width(budget), rel=0.05)


def test_divisors() -> None:
    assert [row(1.0, name).contribution_dph for name in ("normal", "rectangular", "triangular", "arcsine")] == (
        pytest.approx([1.0, 1.0 / sqrt(3.0), 1.0 / sqrt(6.0), 1.0 / sqrt(2.0)])
    )
    assert combine([row(1.0)]).k == pytest.approx(1.959964, abs=1e-6)
    assert combine([row(0.0)]).expanded_dph == 0.0


@pytest.mark.parametrize(
    "wrong", [{"kind": "C"}, {"distribution": "uniform"}, {"value": -1.0}, {"sensitivity": float("nan")}, {"dof": 0.0}]
)
def test_a_wrong_row_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="Allowed"):
        replace(row(1.0, dof=3.0), **wrong)  # type: ignore[arg-type]


def model(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """deg/s; 2 deg/h per degC and 1 % of scale over 50 degC."""
    temperature, output = X.T
    return np.asarray(output * (1.0 - 2e-4 * temperature) - 2.0 / 3600.0 * temperature)


POINT = RateConditions(
    temperature_degc=30.0,
    output_dps=100.0,
    reference_dps=99.4,
    noise=NoiseOfMean(0.05, 12.0, 0.03),
    table_ppm=2.0,
    sensor_degc=0.01,
    latitude_deg=39.9,
    latitude_half_deg=0.01,
    tilt_arcmin=1.0,
    residual_dps=1e-5,
    residual_dof=5.0,
)


def test_sensitivities_of_a_compensated_rate() -> None:
    rows = {source.source: source for source in compensated_rate_budget(model, POINT).rows}
    assert rows["temperature sensor"].sensitivity == pytest.approx(-(2.0 + 2e-4 * 100.0 * 3600.0), rel=1e-6)
    assert rows["gyro noise, correlated"].sensitivity == pytest.approx(1.0 - 2e-4 * 30.0, rel=1e-6)
    assert rows["table rate"].contribution_dph == pytest.approx(99.4 * 3600.0 * 2e-6 / sqrt(3.0))
    # Gyro test metrics, section 9: 0.01 deg of latitude is 0.0020 deg/h at 39.9 deg; 1 arcmin of tilt 0.0034.
    assert rows["earth rate: latitude"].contribution_dph * sqrt(3.0) == pytest.approx(0.0020, abs=1e-4)
    assert rows["earth rate: tilt"].contribution_dph * sqrt(3.0) == pytest.approx(0.0034, abs=1e-4)


def test_the_budget_of_a_compensated_rate_is_that_of_simulated_campaigns() -> None:
    """Every input varied in the physics, not in the budget: the model, the table, latitude and tilt."""
    rng, n = np.random.default_rng(1), 300_000
    uniform = rng.uniform(-1.0, 1.0, (4, n))
    output = POINT.output_dps + POINT.noise.u / 3600.0 * rng.standard_t(POINT.noise.dof, n)
    rate = model(np.column_stack([POINT.temperature_degc + POINT.sensor_degc * uniform[0], output]))
    reference = POINT.reference_dps * (1.0 + 1e-6 * POINT.table_ppm * uniform[1])
    horizontal = horizontal_dph(POINT.latitude_deg)
    earth = horizontal * np.radians(POINT.latitude_half_deg * uniform[2] + POINT.tilt_arcmin / 60.0 * uniform[3])
    error = 3600.0 * (rate - reference) + earth + 3600.0 * POINT.residual_dps * rng.standard_t(POINT.residual_dof, n)
    half = float(np.diff(np.quantile(error, [0.025, 0.975]))[0]) / 2.0
    budget = compensated_rate_budget(model, POINT)
    assert budget.u_dph == pytest.approx(error.std(), rel=0.03)
    assert budget.expanded_dph == pytest.approx(half, rel=0.06)
