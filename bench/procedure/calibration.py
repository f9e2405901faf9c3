"""What a procedure may say about a calibration: which figures, from which records and points, against which limits."""

from __future__ import annotations

import re
from typing import Literal

from pydantic import Field, model_validator

from bench.errors import did_you_mean
from bench.fields import YamlMapping
from bench.procedure.values import Angle, Drift, Kelvin, Name, Rate, Ratio, Slope, Temperature, Time

# Figure -> unit of every figure a limit may be on; the blocks of bias stability are as many as a procedure asks for.
FIGURE_UNITS = {
    "B0": "deg/h",
    "Br": "deg/h",
    "t_on": "s",
    "Bt": "deg/h/degC",
    "B_dT": "deg/h/(degC/min)",
    "B_hys": "deg/h",
    "K": "deg/s/(deg/s)",
    "F0": "deg/s",
    "Kn": "ppm of full scale",
    "Ka": "ppm",
    "Kr": "ppm",
    "Kt": "ppm/degC",
    "W_th": "deg/h",
    "W_res": "deg/h",
    "W_dz": "deg/h",
    "sigma_min": "deg/h",
    "Qn": "arcsec",
    "N": "deg/sqrt(h)",
    "B": "deg/h",
    "Krw": "deg/h/sqrt(h)",
    "R": "deg/h/h",
}
_BLOCK_FIGURE = re.compile(r"BsT?\([0-9.]+ s\)( detrended)?")
_FIGURE_LIMIT = re.compile(r"([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?)\s+(\S.*)")


def figure_unit(figure: str) -> str | None:
    """The unit of a figure of a calibration; None if there is no such figure.

    >>> figure_unit("Bs(100 s)"), figure_unit("Kn"), figure_unit("Bs")
    ('deg/h', 'ppm of full scale', None)
    """
    return "deg/h" if _BLOCK_FIGURE.fullmatch(figure) else FIGURE_UNITS.get(figure)


class StaticFigures(YamlMapping):
    """Bias, bias stability and Allan coefficients, from a record at rest without its first `warm_up`.

    `blocks`: averaging times of the bias stability.
    """

    record: Name
    warm_up_s: Time = Field(default=0.0, ge=0)
    blocks_s: list[Time] = Field(default=[1.0, 10.0, 100.0], min_length=1)


class ScaleFactorFigures(YamlMapping):
    """K, F0, Kn and Ka at each temperature, from the points of a rate set, the rests before and after taken off.

    From several temperatures Kt, from several visits to the one nearest `room` Kr, which are of power cycles only if
    the block `power_cycles` says so.
    """

    room_degc: Temperature = 25.0


class TemperatureFigures(YamlMapping):
    """Bias against temperature: Bt from records at rest at several temperatures (`soaks`), B_dT, hysteresis and the
    bias stability over the whole cycle from records over temperature cycles (`ramps`).

    Rows are averages over `average`; those that change more slowly than `moving` belong to no branch of the hysteresis,
    which is looked for in bins of `bin`.
    """

    soaks: Name | None = None
    ramps: Name | None = None
    warm_up_s: Time = Field(default=0.0, ge=0)
    room_degc: Temperature = 25.0
    average_s: Time = Field(default=100.0, gt=0)
    moving_degc_min: Slope = Field(default=0.1, gt=0)
    bin_k: Kelvin = Field(default=5.0, gt=0)

    @model_validator(mode="after")
    def _something_to_look_at(self) -> TemperatureFigures:
        if self.soaks is None and self.ramps is None:
            raise ValueError("'temperature' needs records: soaks: NAME, ramps: NAME, or both")
        return self


class RepeatFigures(YamlMapping):
    """Bias repeatability: the spread of the bias of records that are alike, each without its first `warm_up`.

    `between` says what is done between them; with power_off, a record begins at power-on, and with `band` the turn-on
    time is when means over `average` stay within it, on either side of the bias of that start.
    """

    record: Name
    warm_up_s: Time = Field(default=0.0, ge=0)
    between: Literal["power_off", "thermal_excursion"] = "power_off"
    average_s: Time = Field(default=10.0, gt=0)
    band_dph: Drift | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _turned_on(self) -> RepeatFigures:
        if self.band_dph is not None and self.between != "power_off":
            raise ValueError("'band' is for the turn-on time, which needs between: power_off")
        return self


class ThresholdFigures(YamlMapping):
    """Threshold and dead zone from points whose input, the earth's rotation included, is within ± `span` of none;
    resolution from points whose table rate is within ± `span` of rest."""

    span_dps: Rate = Field(gt=0)


class GivenScaleFactor(YamlMapping):
    """The scale factor to divide by where the run measures none: output over input, with its standard uncertainty."""

    value: float = Field(default=1.0, gt=0, allow_inf_nan=False)
    u_ppm: Ratio = Field(default=0.0, ge=0)


class BenchUncertainty(YamlMapping):
    """What is known of the bench: half-widths of rectangular distributions, from its certificates.

    `table`: mean rate; `latitude`; `tilt` of the input axis from the vertical; `temperature`: the DUT's own sensor.
    """

    table_ppm: Ratio = Field(default=50.0, ge=0)
    latitude_deg: Angle = Field(default=0.01, ge=0)
    tilt_deg: Angle = Field(default=1.0 / 60.0, ge=0)
    temperature_k: Kelvin = Field(default=0.5, ge=0)


class CalibrationLimit(YamlMapping):
    """A limit on the magnitude of a figure, in the unit of the figure; where there are several of it (temperatures,
    records), the largest counts, and one that was not measured does not pass."""

    figure: str
    max: str | float

    @model_validator(mode="after")
    def _of_a_figure_in_its_unit(self) -> CalibrationLimit:
        unit, match = figure_unit(self.figure), _FIGURE_LIMIT.fullmatch(str(self.max).strip())
        if unit is None:
            raise ValueError(
                f"there is no figure '{self.figure}'.{did_you_mean(self.figure, ['Bs(100 s)', *FIGURE_UNITS])}"
            )
        if match is None or match[2] != unit:
            raise ValueError(
                f"'{self.max}' is no limit on {self.figure}. Allowed: a number in {unit}, e.g. '0.1 {unit}'"
            )
        return self

    @property
    def value(self) -> float:
        """The limit in the unit of its figure."""
        match = _FIGURE_LIMIT.fullmatch(str(self.max).strip())
        assert match is not None  # validated
        return float(match[1])


class CalibrationAnalysis(YamlMapping):
    """The figures a laboratory reports of a gyro, each with its definition, its uncertainty and its limits.

    Every block says from which records or points its figures come; those without a block are not made. All outputs
    are divided by K, of the rate set of this run at the nearest temperature or else `k`, and then the earth's rotation
    at the latitude of the bench is taken off.
    """

    static: StaticFigures | None = None
    scale_factor: ScaleFactorFigures | None = None
    temperature: TemperatureFigures | None = None
    power_cycles: RepeatFigures | None = None
    threshold: ThresholdFigures | None = None
    k: GivenScaleFactor = Field(default_factory=GivenScaleFactor)
    bench: BenchUncertainty = Field(default_factory=BenchUncertainty)
    limits: list[CalibrationLimit] = Field(default_factory=list)

    @model_validator(mode="after")
    def _something_to_report(self) -> CalibrationAnalysis:
        if not any((self.static, self.scale_factor, self.temperature, self.power_cycles, self.threshold)):
            blocks = "static, scale_factor, temperature, power_cycles, threshold"
            raise ValueError(f"'calibration' reports nothing. Allowed: one or more of {blocks}")
        return self
