"""What a procedure may say: the step verbs and the blocks around them, as data.

Field names carry the unit suffix, YAML keys do not (`bench.fields`). The docstrings here are the procedure reference:
`fogbench schema procedure` and docs/reference/procedure.md are generated from them.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from bench.fields import YamlMapping
from bench.procedure.analyses import Analysis, CycleAnalysis, NorthAnalysis
from bench.procedure.calibration import CalibrationAnalysis
from bench.procedure.conditions import Guard, Limits, Quality, ResumePolicy
from bench.procedure.values import Angle, Kelvin, Name, Order, Rate, Slope, Temperature, Time

# The engine keeps the DUT temperatures of this long (engine.HISTORY_S); a slope over more would never be known.
MAX_SLOPE_WINDOW_S = 4 * 3600.0
MAX_SAMPLES = 10_000_000


class SetTemperature(YamlMapping):
    """Move the chamber's setpoint at once and wait until its readback is in the band."""

    to_degc: Temperature
    band_k: Kelvin = Field(default=0.5, gt=0)
    timeout_s: Time = Field(default=6 * 3600.0, gt=0)


class RampTemperature(YamlMapping):
    """Move the chamber's setpoint at a stated rate and wait until its readback is in the band."""

    to_degc: Temperature
    rate_degc_min: Slope = Field(gt=0)
    band_k: Kelvin = Field(default=0.5, gt=0)
    timeout_s: Time = Field(default=6 * 3600.0, gt=0)


class SlopeCondition(YamlMapping):
    """The DUT's own temperature slope, by least squares over a window, is inside ± slope."""

    slope_degc_min: Slope = Field(gt=0)
    over_s: Time = Field(default=600.0, gt=0, le=MAX_SLOPE_WINDOW_S)


class Soak(YamlMapping):
    """Hold until the DUTs are thermally stable: a minimum time and, if `until` is given, a slope condition."""

    for_s: Time = Field(gt=0)
    until: SlopeCondition | None = None
    timeout_s: Time | None = Field(default=None, gt=0)
    on_timeout: Literal["fail", "continue"] = "fail"

    @model_validator(mode="after")
    def _timeout_goes_with_until(self) -> Soak:
        if self.until and self.timeout_s is None:
            raise ValueError("a soak with 'until' needs a 'timeout', e.g. timeout: 6 h")
        if self.timeout_s is not None and self.timeout_s <= self.for_s:
            raise ValueError("the timeout of a soak must be longer than its minimum time 'for'")
        return self


class SetRate(YamlMapping):
    """Command the table to a rate; it is not waited for (use settle)."""

    to_dps: Rate


class Settle(YamlMapping):
    """Wait until the table's measured rate has stayed within ± band of the setpoint for a time."""

    band_dps: Rate = Field(gt=0)
    for_s: Time = Field(default=1.0, ge=0)
    timeout_s: Time = Field(default=120.0, gt=0)


class GoToPosition(YamlMapping):
    """Turn the table to a position and wait until its readback is within the band."""

    to_deg: Angle
    band_deg: Angle = Field(default=0.01, gt=0)
    timeout_s: Time = Field(default=300.0, gt=0)


class Dwell(YamlMapping):
    """Hold everything for a fixed time."""

    for_s: Time = Field(gt=0)


class Acquire(YamlMapping):
    """Record samples of every DUT and average them to one point.

    Either `count` samples or a duration `for`, one sample every `every`. A sample is the mean of the frames of its
    interval, or the newest frame of it.
    """

    count: int | None = Field(default=None, gt=0, le=MAX_SAMPLES)
    for_s: Time | None = Field(default=None, gt=0)
    every_s: Time = Field(gt=0)
    take: Literal["mean", "newest"] = "mean"

    @model_validator(mode="after")
    def _count_or_duration(self) -> Acquire:
        if (self.count is None) == (self.for_s is None):
            raise ValueError("acquire needs either 'count' or 'for', not both: count: 1000 or for: 10 min")
        if self.for_s is not None and self.for_s < self.every_s:
            raise ValueError("the duration 'for' is shorter than one interval 'every'")
        if self.for_s is not None and self.for_s / self.every_s > MAX_SAMPLES:
            raise ValueError(f"'for' holds more than {MAX_SAMPLES} intervals 'every'; split it with repeat")
        return self

    @property
    def samples(self) -> int:
        """Samples planned."""
        return self.count if self.count is not None else max(1, int((self.for_s or 0.0) / self.every_s + 1e-9))

    @property
    def duration_s(self) -> float:
        """Time the samples take."""
        return float(self.samples * self.every_s)


class Power(YamlMapping):
    """Switch the DUTs that the bench's supply feeds off or on, and wait until its output reads so.

    After switching on it is waited, up to `timeout`, until each of them sends; one that does not is left out like any
    silent DUT. A run begins with the DUTs on. While they are off they are not missed, and nothing of them can be
    acquired. To have a turn-on from its first frame, begin the record before it: its rows then begin with that frame.
    A supply has one output: `duts` are all that it feeds.
    """

    duts: Literal["all"] | list[Name] = "all"
    to: Literal["on", "off"]
    timeout_s: Time = Field(default=60.0, gt=0)


class TemperatureRange(YamlMapping):
    """Temperatures from … to by step, both ends included."""

    from_degc: Temperature
    to_degc: Temperature
    step_k: Kelvin = Field(gt=0)


class RateRange(YamlMapping):
    """Rates from … to by step, both ends included; `without` leaves values out."""

    from_dps: Rate
    to_dps: Rate
    step_dps: Rate = Field(gt=0)
    without_dps: list[Rate] = Field(default_factory=list)


class PositionRange(YamlMapping):
    """Table positions from … to by step, both ends included."""

    from_deg: Angle
    to_deg: Angle
    step_deg: Angle = Field(gt=0)


class Sweep(YamlMapping):
    """Visit each value of one quantity and run the steps there; sweeps nest.

    A temperature sweep ramps the chamber (`ramp`, `band`, `timeout` as in ramp_temperature) and waits for its readback;
    a rate sweep commands the table; a position sweep turns it. `order`: up, down, alternate (turns round each time the
    sweep is entered again) or random (seeded); without it a range goes up and a list is visited as written.
    """

    temperature: TemperatureRange | list[Temperature] | None = None
    rate: RateRange | list[Rate] | None = None
    position: PositionRange | list[Angle] | None = None
    order: Order | None = None
    seed: int = 0
    ramp_degc_min: Slope | None = Field(default=None, gt=0)
    band_k: Kelvin = Field(default=0.5, gt=0)
    timeout_s: Time = Field(default=6 * 3600.0, gt=0)
    steps: list[Any] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_quantity(self) -> Sweep:
        if sum(q is not None for q in (self.temperature, self.rate, self.position)) != 1:
            raise ValueError("a sweep needs exactly one of 'temperature', 'rate' or 'position'")
        strays = {"ramp_degc_min": "ramp", "band_k": "band", "timeout_s": "timeout"}
        stray = next((key for name, key in strays.items() if name in self.model_fields_set), None)
        if stray and self.temperature is None:
            raise ValueError(f"'{stray}' belongs to a temperature sweep; in a rate sweep put a 'settle' into its steps")
        return self


class Repeat(YamlMapping):
    """Run the steps several times."""

    times: int = Field(gt=0, le=1_000_000)
    steps: list[Any] = Field(min_length=1)


class Record(YamlMapping):
    """Keep a time series of every DUT while the steps run: one row every `every`, the means of its frames.

    For what changes while it is measured: thermal cycles, ramps, long records at rest. A record is one measurement: one
    that is broken off begins again from its first step when the run is resumed, and a pause waits for its end. The
    second record of the same name is called name-2, and so on.
    """

    name: Name
    every_s: Time = Field(gt=0)
    steps: list[Any] = Field(min_length=1)


class EndRecord(YamlMapping):
    """The end of a record's steps; part of a plan, never written in a procedure."""


class Include(YamlMapping):
    """Run the `steps` of another file; its path is relative to the including file."""

    file: str


class Note(YamlMapping):
    """Write a text into the journal."""

    text: str = Field(min_length=1, max_length=2000)


VERBS: dict[str, type[YamlMapping]] = {
    "set_temperature": SetTemperature,
    "ramp_temperature": RampTemperature,
    "soak": Soak,
    "set_rate": SetRate,
    "settle": Settle,
    "go_to_position": GoToPosition,
    "dwell": Dwell,
    "power": Power,
    "acquire": Acquire,
    "sweep": Sweep,
    "repeat": Repeat,
    "record": Record,
    "include": Include,
    "note": Note,
}

# Verbs with steps of their own.
BLOCKS = ("sweep", "repeat", "record")

# The one value a verb needs most, so that 'set_rate: 10 deg/s' may be written for 'set_rate: {to: 10 deg/s}'.
SHORT_FORM = {
    "set_temperature": "to",
    "set_rate": "to",
    "go_to_position": "to",
    "power": "to",
    "soak": "for",
    "dwell": "for",
    "include": "file",
    "note": "text",
}


class ProcedureHead(YamlMapping):
    """A procedure: what to do, in steps, and how to judge the result.

    `experiment` names a published experiment, whose figures the report sets beside ours. After the run `analysis` is
    done with the points, `cycles` with records of thermal cycles, `north` with records of a north seeker, `calibration`
    with both points and records.
    """

    procedure: Name
    title: str = ""
    description: str = ""
    experiment: Literal["ts", "rlg", "bp", "north"] | None = None
    raw: Literal["frames", "samples", "none"] = "frames"
    limits: Limits = Field(default_factory=Limits)
    quality: Quality = Field(default_factory=Quality)
    resume: ResumePolicy = Field(default_factory=ResumePolicy)
    guards: list[Guard] = Field(default_factory=list)
    steps: list[Any] = Field(min_length=1)
    analysis: Analysis | None = None
    cycles: CycleAnalysis | None = None
    north: NorthAnalysis | None = None
    calibration: CalibrationAnalysis | None = None
