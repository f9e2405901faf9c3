"""What a procedure demands while it is carried out: limits, quality of points, guards, and when a soak still holds.

Field names carry the unit suffix, YAML keys do not (`bench.fields`); the docstrings go into the procedure reference.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from bench.fields import YamlMapping
from bench.procedure.values import Kelvin, Name, Rate, Ratio, Slope, Temperature, Time


class Band(YamlMapping):
    """A temperature range."""

    from_degc: Temperature
    to_degc: Temperature

    @model_validator(mode="after")
    def _upwards(self) -> Band:
        if self.from_degc > self.to_degc:
            raise ValueError("'from' is above 'to'; write the lower temperature first")
        return self


class Limits(YamlMapping):
    """What this procedure may never ask for, checked before hour 0 beside the limits of the bench."""

    temperature: Band | None = None
    rate_dps: Rate | None = Field(default=None, gt=0)
    ramp_degc_min: Slope | None = Field(default=None, gt=0)
    duration_s: Time | None = Field(default=None, gt=0)


class Quality(YamlMapping):
    """When a point passes, is marginal (up to `fail_at` times the limit) or fails.

    `lost` is the share of frames that may be missing, invalid by their status, or repeated by a frozen output (each);
    `spikes` that of frames left out for being far off, `outliers` that of samples. `slope` limits the DUT's temperature
    slope. The table's measured rate: `rate_band` for the mean of its readbacks during the acquisition, `rate_worst` for
    each of them. `noise_ratio` compares the standard deviation of the samples with the median of the DUT's own points
    before at a comparable rate, from `noise_history` such points on. A point that failed is measured again at once, up
    to `repeats` times; what stays bad is marked and never fitted. `frozen: marginal` is for a scan through a dead band,
    where an output that stands still is what is looked for.
    """

    lost_ppm: Ratio = Field(default=1000.0, ge=0)
    spikes_ppm: Ratio = Field(default=1000.0, ge=0)
    outliers_ppm: Ratio = Field(default=5000.0, ge=0)
    slope_degc_min: Slope = Field(default=0.05, gt=0)
    rate_band_dps: Rate = Field(default=0.02, gt=0)
    rate_worst_dps: Rate = Field(default=0.1, gt=0)
    noise_ratio: float = Field(default=2.0, gt=1)
    noise_history: int = Field(default=5, ge=2, le=1000)
    fail_at: float = Field(default=5.0, ge=1)
    frozen: Literal["fail", "marginal"] = "fail"
    repeats: int = Field(default=1, ge=0, le=20)


class Guard(YamlMapping):
    """A condition that must hold while the run is under way: checked before the first step, on entry to every step, at
    every readback, and every few seconds while the table moves.

    `watch` names what is watched: a temperature with its allowed range `inside`; the table's measured rate with
    `max_rate`; what chamber and table report of themselves; the chamber's door; or the samples of every DUT, of which
    the share `lost` may be missing or invalid within the time `over`, and whose output may not stay the same for that
    long. A guard that lost its signal has tripped: a DUT that is silent, a chamber or table that could not be read for
    `lost_after`, a chamber that does not tell about its door. `action`: hold (the table rests until all is clear for
    `clear_for`, at most `timeout`, then the bench is brought back, with a new soak if the DUTs did not stay as warm),
    drop (that DUT; the others go on) or abort. Of several at once, abort comes first; DUTs are dropped, then it holds.
    """

    name: Name
    watch: Literal[
        "chamber_temperature",
        "dut_temperature",
        "rate",
        "chamber_alarm",
        "table_fault",
        "chamber_door",
        "sample_quality",
    ]
    inside: Band | None = None
    max_rate_dps: Rate | None = Field(default=None, gt=0)
    lost_ppm: Ratio | None = Field(default=None, ge=0)
    over_s: Time = Field(default=60.0, gt=0)
    lost_after_s: Time = Field(default=600.0, gt=0)
    action: Literal["hold", "drop", "abort"] = "abort"
    clear_for_s: Time = Field(default=60.0, ge=0)
    timeout_s: Time = Field(default=7200.0, gt=0)

    @model_validator(mode="after")
    def _fits_what_it_watches(self) -> Guard:
        if ("temperature" in self.watch) != (self.inside is not None):
            raise ValueError(
                "a guard on a temperature, and only that, has 'inside', e.g. {from: -40 degC, to: 70 degC}"
            )
        if (self.watch == "rate") != (self.max_rate_dps is not None):
            raise ValueError("a guard on the rate, and only that, has 'max_rate', e.g. max_rate: 200 deg/s")
        if (self.watch == "sample_quality") != (self.lost_ppm is not None):
            raise ValueError("a guard on sample_quality, and only that, has 'lost', e.g. lost: 1 %")
        if "over_s" in self.model_fields_set and self.watch != "sample_quality":
            raise ValueError("'over' belongs to a guard on sample_quality")
        if self.action == "drop" and self.watch not in ("dut_temperature", "sample_quality"):
            raise ValueError("only a guard on dut_temperature or sample_quality can drop a DUT; use hold or abort")
        return self


class ResumePolicy(YamlMapping):
    """When a soak holds over an interruption: a short gap, and every DUT as warm as it was; else it starts over."""

    gap_s: Time = Field(default=900.0, ge=0)
    band_k: Kelvin = Field(default=0.5, gt=0)
