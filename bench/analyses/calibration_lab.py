"""What the parts of a calibration share: the record of one DUT, its scale factor, the earth's rotation, the budget."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import hypot, radians, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.analyses.calibration_points import RateSetAt, nearest, rate_sets
from bench.analyses.calibration_records import NotRecorded, RestRecord, abouts_of, rest_record
from bench.procedure.calibration import CalibrationAnalysis
from fitting.earth import horizontal_dph, vertical_dph
from fitting.metrics.bias import InputRate, ScaleFactor, to_dph
from fitting.metrics.figure import Figure, with_u
from fitting.random_errors.mean import NoiseOfMean, noise_of_mean
from fitting.uncertainty import BudgetRow, combine

if TYPE_CHECKING:
    import pandas as pd

_NO_LATITUDE = (
    "the bench file states no latitude under 'site:', so the earth's rotation cannot be taken off and the bias is not "
    "known"
)
_LEVEL = (
    "the bench file states an azimuth under 'site:', so the input axis lies level and what it feels of the earth's "
    "rotation depends on the heading; a bias then comes from opposite positions, not from one record"
)


@dataclass(frozen=True)
class Stated:
    """One figure, the part of the calibration it comes from, where it holds, and what must stand beside it."""

    part: str
    figure: Figure
    conditions: Mapping[str, Any]
    at: str = ""

    def record(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        return {"part": self.part, "at": self.at, **self.figure.record(), "conditions": dict(self.conditions)}


@dataclass
class Found:
    """What a calibration of one DUT has found so far; notes: what it could not, and why."""

    stated: list[Stated] = field(default_factory=list)
    tables: dict[str, Any] = field(default_factory=dict)
    budgets: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def attempt(self, what: str, make: Callable[[], Sequence[Stated]]) -> None:
        """Keep what `make` states, or why it cannot."""
        try:
            self.stated += make()
        except ValueError as error:
            self.notes.append(f"{what}: {error}")


@dataclass(frozen=True)
class Lab:
    """One DUT of a run, and how to look at it."""

    folder: Path
    dut: str
    spec: CalibrationAnalysis
    points: pd.DataFrame
    series: Sequence[Mapping[str, Any]]
    latitude_deg: float | None
    azimuth_deg: float | None = None

    @property
    def table_u_ppm(self) -> float:
        """Standard uncertainty of the table's mean rate."""
        return self.spec.bench.table_ppm / sqrt(3.0)

    @cached_property
    def sets(self) -> list[RateSetAt]:
        """The rate sets of this DUT."""
        span = self.spec.threshold.span_dps if self.spec.threshold else None
        return rate_sets(self.points, self.dut, self.table_u_ppm, span, self._repeats_s())

    def _repeats_s(self) -> list[float]:
        """When the repeats of `power_cycles` begin: with their records."""
        spec = self.spec.power_cycles
        if spec is None:
            return []
        try:
            return [float(about["started_at_s"]) for about in abouts_of(self.series, self.dut, spec.record)]
        except NotRecorded:
            return []

    def records(self, name: str, warm_up_s: float) -> list[RestRecord]:
        """The records called `name`, `name-2` …. Raises NotRecorded, or what reading them raises."""
        return [rest_record(self.folder, about, warm_up_s) for about in abouts_of(self.series, self.dut, name)]

    def scale_at(self, temperature_degc: float) -> tuple[ScaleFactor, dict[str, Any]]:
        """K to divide by at a temperature of the DUT, and where it comes from."""
        if self.sets:
            one = nearest(self.sets, temperature_degc)
            k = one.rates.scale_factor
            scale, source = ScaleFactor(k.value, k.u), f"rate set of this run at {one.temperature_degc:.1f} degC"
        else:
            given = self.spec.k
            scale, source = ScaleFactor(given.value, given.value * given.u_ppm * 1e-6), "stated in the procedure"
        return scale, {"k": scale.value, "k_u_ppm": 1e6 * scale.u / scale.value, "k_from": source}

    def earth(self) -> InputRate:
        """Earth rate along an upright input axis, from the latitude, with its uncertainty.

        NotRecorded without a latitude, and on a bench whose DUTs lie level.
        """
        if self.latitude_deg is None:
            raise NotRecorded(_NO_LATITUDE)
        if self.azimuth_deg is not None:
            raise NotRecorded(_LEVEL)
        by_latitude, by_tilt = self._earth_half_widths()
        return InputRate(vertical_dph(self.latitude_deg), hypot(by_latitude, by_tilt) / sqrt(3.0))

    def _earth_half_widths(self) -> tuple[float, float]:
        """What latitude and tilt leave uncertain, in deg/h; a tilt towards north is the one that matters."""
        assert self.latitude_deg is not None
        horizontal = horizontal_dph(self.latitude_deg)
        bench = self.spec.bench
        return horizontal * radians(bench.latitude_deg), horizontal * radians(bench.tilt_deg)

    def bias_budget(self, value: Figure, mean_dph: float, scale: ScaleFactor, noise: NoiseOfMean) -> dict[str, Any]:
        """Where the uncertainty of a bias comes from."""
        assert self.latitude_deg is not None
        horizontal, bench = horizontal_dph(self.latitude_deg), self.spec.bench
        rows = [
            BudgetRow("gyro noise, correlated", "A", "normal", noise.u, "deg/h", 1.0, noise.dof),
            BudgetRow("scale factor", "B", "normal", 1e6 * scale.u / scale.value, "ppm", mean_dph * 1e-6),
            BudgetRow("earth rate: latitude", "B", "rectangular", bench.latitude_deg, "deg", horizontal * radians(1.0)),
            BudgetRow(
                "earth rate: tilt", "B", "rectangular", 60.0 * bench.tilt_deg, "arcmin", horizontal * radians(1 / 60)
            ),
        ]
        return budget_record(value, rows)

    def scale_budget(self, one: RateSetAt) -> dict[str, Any]:
        """Where the uncertainty of K comes from, in ppm."""
        k = one.rates.scale_factor
        scatter = 1e6 * one.u_noise / abs(k.value)
        rows = [
            BudgetRow("scatter about the line", "A", "normal", scatter, "ppm", 1.0, max(k.n - 2, 1)),
            BudgetRow("table rate", "B", "rectangular", self.spec.bench.table_ppm, "ppm", 1.0),
        ]
        return budget_record(k, rows, "ppm")


def noise_of(one: RestRecord, scale: ScaleFactor) -> NoiseOfMean:
    """How well the mean of a record is known, its noise as correlated as it is; in deg/h."""
    return noise_of_mean(to_dph(one.output_dps, scale), one.every_s)


def pooled(noises: Sequence[NoiseOfMean]) -> NoiseOfMean:
    """The noise of the mean of one of several records that are alike: mean variance, with the degrees of all of them.

    One record says little about noise as slow as itself; several say more (Welch-Satterthwaite for equal weights).
    """
    variances = np.array([one.u**2 for one in noises])
    dofs = np.array([one.dof for one in noises])
    below = float(np.sum(variances**2 / dofs))
    total = float(variances.sum())
    dof = total**2 / below if below > 0.0 else float("inf")
    return NoiseOfMean(
        float(np.sqrt(variances.mean())), dof, float(np.sqrt(np.mean([one.white_u**2 for one in noises])))
    )


def bias_of(one: RestRecord, scale: ScaleFactor, earth: InputRate, noise: NoiseOfMean, records: int) -> Figure:
    """B0 of a record with the noise of `records` that are alike."""
    mean = float(to_dph(one.output_dps, scale).mean())
    u = float(np.sqrt(noise.u**2 + (mean * scale.u / scale.value) ** 2 + earth.u_dph**2))
    shared = f"; noise of the mean pooled over {records} records" if records > 1 else ""
    return with_u(
        "bias",
        "B0",
        mean - earth.value_dph,
        "deg/h",
        u=u,
        dof=noise.dof * (u / noise.u) ** 4 if noise.u > 0.0 else float("inf"),
        n=len(one.output_dps),
        definition=f"mean output of {one.length_s:.6g} s divided by K = {scale.value:.9g} output/(deg/s), minus the "
        f"earth rate along the input axis, {earth.value_dph:.6g} deg/h{shared}",
        source="GJB 2426A bias",
    )


def budget_record(figure: Figure, rows: Sequence[BudgetRow], unit: str = "deg/h") -> dict[str, Any]:
    """A budget as plain values; contributions, u and U in `unit`."""
    budget = combine(rows)
    listed = [
        {
            "source": row.source,
            "type": row.kind,
            "distribution": row.distribution,
            "value": row.value,
            "unit": row.unit,
            "divisor": row.divisor,
            "sensitivity": row.sensitivity,
            "contribution": row.contribution_dph,
            "dof": row.dof,
        }
        for row in budget.rows
    ]
    return {
        "figure": figure.symbol,
        "value": figure.value,
        "value_unit": figure.unit,
        "unit": unit,
        "rows": listed,
        "u": budget.u_dph,
        "dof": budget.dof,
        "coverage": budget.coverage,
        "k": budget.k,
        "expanded": budget.expanded_dph,
    }
