"""What stands in a bench file, as data: instruments with their limits and safe states, the site, links and clock.

The docstrings here are the reference of the bench file: docs/reference/bench.md is generated from them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from bench.fields import Quantity, YamlMapping
from bench.procedure.conditions import Band, Guard
from bench.procedure.values import Name, Rate, Slope, Temperature

# What an instrument must say that it is, in full or with '*' for any text: 'Watlow F4, model 5270', 'Acutronic*'.
Identity = Annotated[str, Field(min_length=1, max_length=200)]


class CanPort(YamlMapping):
    """A python-can bus."""

    interface: str
    channel: str
    bitrate: int = Field(default=1_000_000, gt=0)


class ChamberLimits(YamlMapping):
    """What the chamber may be asked for."""

    temperature: Band
    ramp_degc_min: Slope = Field(default=5.0, gt=0)


class ChamberSafe(YamlMapping):
    """How the chamber is left on every exit: hold where it is, go to a temperature at a rate, or off.

    Instruments are made safe by `order`; those of one order are commanded at once, the table first. `timeout`: by when
    the chamber must read back what it was asked for.
    """

    action: Literal["hold", "go_to", "off"] = "hold"
    temperature_degc: Temperature = 25.0
    rate_degc_min: Slope = Field(default=1.0, gt=0)
    timeout_s: Annotated[float, Quantity("s")] = Field(default=30.0, gt=0)
    order: int = Field(default=1, ge=1, le=9)


class TableLimits(YamlMapping):
    """What the table may be asked for."""

    rate_dps: Rate = Field(gt=0)


class TableSafe(YamlMapping):
    """How the table is left on every exit: at rest by its own deceleration, the drive released or kept.

    `timeout`: by when it must read at rest. `order`: as for the chamber.
    """

    release: bool = True
    timeout_s: Annotated[float, Quantity("s")] = Field(default=120.0, gt=0)
    order: int = Field(default=1, ge=1, le=9)


class SupplyLimits(YamlMapping):
    """What the DUTs can bear: the settings of the supply's driver may ask for no more."""

    voltage_v: Annotated[float, Quantity("v")] | None = Field(default=None, gt=0)
    current_a: Annotated[float, Quantity("a")] | None = Field(default=None, gt=0)


class SupplySafe(YamlMapping):
    """How the supply is left on every exit: as it is (nothing is sent to it), or its output off.

    `timeout`: by when it must read off. `order`: as for the chamber. A run begins with the output on: it is switched on
    if it is off.
    """

    action: Literal["keep", "off"] = "keep"
    timeout_s: Annotated[float, Quantity("s")] = Field(default=30.0, gt=0)
    order: int = Field(default=1, ge=1, le=9)


class DutLimits(YamlMapping):
    """The DUT's full scale and the temperatures it may see."""

    rate_dps: Rate = Field(gt=0)
    temperature: Band | None = None


class ChamberEntry(YamlMapping):
    """The temperature chamber.

    `identity`: what it must say that it is, in full or with '*' for any text (in quotes, if the '*' comes first).
    """

    driver: str
    port: str
    identity: Identity | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    limits: ChamberLimits
    safe: ChamberSafe = Field(default_factory=ChamberSafe)


class TableEntry(YamlMapping):
    """The rate table. `identity`: as for the chamber."""

    driver: str
    port: str
    identity: Identity | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    limits: TableLimits
    safe: TableSafe = Field(default_factory=TableSafe)


class SupplyEntry(YamlMapping):
    """The power supply of the DUTs, switched by the verb power. `powers`: the DUTs at its output, all if left out.

    `identity`: as for the chamber.
    """

    driver: str
    port: str
    identity: Identity | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    powers: list[Name] | None = Field(default=None, min_length=1)
    limits: SupplyLimits = Field(default_factory=SupplyLimits)
    safe: SupplySafe = Field(default_factory=SupplySafe)


class DutEntry(YamlMapping):
    """A gyro under test, keyed by its serial number.

    A gyro cannot be asked who it is: its `identity` is held against what it sends (see a run's manifest, identities).
    """

    driver: str
    port: str | CanPort
    identity: Identity | None = None
    settings: dict[str, Any] = Field(default_factory=dict)
    limits: DutLimits


Entry = ChamberEntry | TableEntry | SupplyEntry | DutEntry


class Site(YamlMapping):
    """Where the bench stands; with a latitude, the vertical earth rate is part of the reference rate.

    `azimuth` is where the DUT's x axis points when the table reads 0, clockwise from north, as surveyed: the truth that
    a north seeker is judged by.
    """

    latitude_deg: Annotated[float, Quantity("deg")] | None = Field(default=None, ge=-90, le=90)
    azimuth_deg: Annotated[float, Quantity("deg")] | None = Field(default=None, ge=-360, le=360)


class ClockPace(YamlMapping):
    """How fast bench time passes: `speed` bench seconds per second of the wall.

    Only for ports that lead to live simulators (`fogbench simulate --speed`, which writes this block). Instruments of
    metal and glass have speed 1; a virtual bench has no wall at all.
    """

    speed: float = Field(default=1.0, gt=0, allow_inf_nan=False)


class Links(YamlMapping):
    """How long an instrument that does not answer is tried again before the run ends, and at what intervals.

    Chamber or table: the step is broken off, the table rests, and the link is tried after `first_wait`, then after
    twice that, up to `longest_wait`; when the same instrument answers again the bench is brought back and the step is
    done again. A DUT whose port is gone, or that was silent for `silent_after`, is left out and tried again beside the
    measurement of the others; the run ends if none is left for `patience`.
    """

    patience_s: Annotated[float, Quantity("s")] = Field(default=300.0, ge=0)
    first_wait_s: Annotated[float, Quantity("s")] = Field(default=0.5, gt=0)
    longest_wait_s: Annotated[float, Quantity("s")] = Field(default=10.0, gt=0)
    silent_after_s: Annotated[float, Quantity("s")] = Field(default=60.0, gt=0)


class BenchFile(YamlMapping):
    """A bench: instruments, DUTs, site, and the simulation of a virtual one."""

    bench: Name
    description: str = ""
    site: Site = Field(default_factory=Site)
    chamber: ChamberEntry | None = None
    rate_table: TableEntry | None = None
    supply: SupplyEntry | None = None
    duts: dict[Name, DutEntry] = Field(default_factory=dict)
    guards: list[Guard] = Field(default_factory=list)
    links: Links = Field(default_factory=Links)
    clock: ClockPace = Field(default_factory=ClockPace)
    simulation: dict[str, Any] = Field(default_factory=dict)
