"""What a procedure may say about the analysis after the run: which models, judged on what, against which limits."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from bench.fields import YamlMapping
from bench.procedure.values import Name, Rate, Time

# Entry points of the models a `cycles` block may name.
CYCLE_MODELS = "fogbench.cycle_models"
# Where the table stands in one seeking.
SEEKING_POSITIONS_DEG = (0.0, 90.0, 180.0, 270.0)


class RandomSplit(YamlMapping):
    """Rows drawn at random for training: a number of rows, or a share of them."""

    train: int | None = Field(default=None, gt=0)
    share: float | None = Field(default=None, gt=0, lt=1)
    seed: int = 0

    @model_validator(mode="after")
    def _one_of_both(self) -> RandomSplit:
        if (self.train is None) == (self.share is None):
            raise ValueError("a random split needs either 'train' (rows) or 'share', e.g. train: 448")
        return self


class LeaveTemperaturesOut(YamlMapping):
    """Whole temperature dwells held back, in so many folds; each row is judged once."""

    folds: int = Field(default=6, ge=2)


class Splits(YamlMapping):
    """How held-back points are chosen; both are reported."""

    random: RandomSplit = Field(default_factory=lambda: RandomSplit.model_validate({"share": 0.69}))
    leave_temperatures_out: LeaveTemperaturesOut = Field(default_factory=LeaveTemperaturesOut)


class AnalysisLimit(YamlMapping):
    """A limit on the held-back error of a model; an unmeasured figure does not pass."""

    model: Name
    split: Literal["random", "leave_temperatures_out"] = "leave_temperatures_out"
    max_abs_dps: Rate | None = Field(default=None, gt=0)
    std_dps: Rate | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _something_to_judge(self) -> AnalysisLimit:
        if self.max_abs_dps is None and self.std_dps is None:
            raise ValueError("a limit needs 'max_abs' or 'std', e.g. std: 0.03 deg/s")
        return self


class Analysis(YamlMapping):
    """What is fitted to the points after the run, and what it must reach.

    `inputs` are the model's: a temperature (the DUT's own sensor, or the chamber's readback) and the DUT's output rate.
    """

    models: list[Name] = Field(min_length=1)
    inputs: list[Literal["dut_temperature", "chamber_temperature", "rate"]] = Field(
        default=["dut_temperature", "rate"], min_length=2, max_length=2
    )
    splits: Splits = Field(default_factory=Splits)
    limits: list[AnalysisLimit] = Field(default_factory=list)
    seed: int = 0

    @model_validator(mode="after")
    def _a_temperature_and_the_rate(self) -> Analysis:
        if self.inputs[0] == "rate" or self.inputs[1] != "rate":
            raise ValueError("'inputs' are a temperature and the rate, e.g. inputs: [dut_temperature, rate]")
        return self


class Reference(YamlMapping):
    """Where the true rate of a gyro at rest is taken from: its mean output in a settled part of a record."""

    record: Name
    from_s: Time = Field(ge=0)
    to_s: Time = Field(gt=0)

    @model_validator(mode="after")
    def _upwards(self) -> Reference:
        if self.from_s >= self.to_s:
            raise ValueError("'from' is not before 'to'; both are times since the record began")
        return self


class Half(YamlMapping):
    """A record cut in two: models learn from what is before `at`, and are judged on what is after it."""

    record: Name
    at_s: Time = Field(gt=0)


class CycleLimit(YamlMapping):
    """A limit on what a model leaves of the error in one test; an unmeasured figure does not pass."""

    model: Name
    test: Name
    max_abs_dps: Rate | None = Field(default=None, gt=0)
    std_dps: Rate | None = Field(default=None, gt=0)
    times_floor: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _something_to_judge(self) -> CycleLimit:
        if self.max_abs_dps is None and self.std_dps is None and self.times_floor is None:
            raise ValueError("a limit needs 'max_abs', 'std' or 'times_floor', e.g. times_floor: 1.2")
        return self


class CycleAnalysis(YamlMapping):
    """Models of the bias over thermal cycles: the error of records at rest against temperatures and their history.

    Rows are averages over `average`. The error is the output minus the reference: the mean of a settled part of a
    record, or without it that of the first record to learn from. Models learn from the records in `train`; each of
    `tests` names records they have not seen, each of `halves` cuts one record in two.
    """

    models: list[Name] = Field(min_length=1)
    temperatures: list[Name] = Field(default=["temperature"], min_length=1)
    average_s: Time = Field(default=100.0, gt=0)
    reference: Reference | None = None
    train: list[Name] = Field(min_length=1)
    tests: dict[Name, list[Name]] = Field(default_factory=dict)
    halves: dict[Name, Half] = Field(default_factory=dict)
    limits: list[CycleLimit] = Field(default_factory=list)
    seed: int = 0


class NorthAnalysis(YamlMapping):
    """North seeking: records of a seeker at rest in two and four table positions, against the bench's surveyed azimuth.

    `seek` names the records, each at a table position of 0, 90, 180 or 270 deg; `still` a long record at rest, whose
    spread over `average` is the bias stability the Kalman filter takes, and whose Allan coefficients are reported
    before and after filtering. Gyro x is the rate; gyro y and the accelerometers are the channels rate_y_dps, accel_x_g
    and accel_y_g. `mils_per_circle` is the convention of the reported error.
    """

    seek: Name
    still: Name
    average_s: Time = Field(default=10.0, gt=0)
    fit_s: Time = Field(default=30.0, gt=0)
    mils_per_circle: float = Field(default=6000.0, gt=0)
    max_error_mil: float | None = Field(default=None, gt=0)
