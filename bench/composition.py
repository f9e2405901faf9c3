"""The composition root: puts real ports or a simulated world under the drivers. The only importer of simulated_hw."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, cast

from pydantic import BaseModel

from bench.benchfile import SIMULATED_CAN, Bench, CanPort, Instrument
from bench.clock import Clock, VirtualClock, WallClock
from bench.errors import BenchFailure, InvalidFiles, Problem, did_you_mean
from bench.fields import model_of, refused, validate, validate_dataclass
from bench.station import Station, open_station
from bench.yamlfile import Path_
from simulated_hw.world import (
    GYRO_CLASSES,
    ChamberParameters,
    GyroParameters,
    InstrumentSpec,
    SiteParameters,
    TableParameters,
    World,
    WorldError,
    WorldSpec,
    gyro_class,
)

# Frames per second of a rehearsed gyro: the engine's waits and the wire are the same, the frames a hundredth.
REHEARSED_RATE_HZ = 1.0
DEFAULT_GYRO_CLASS = "ts_a"
SIMULATORS = "fogbench.simulators"
SIMULATION_KEYS = ("seed", "chamber", "rate_table", "duts")


def seed_of(bench: Bench) -> int:
    """The seed of a bench file's simulation, 0 if it states none."""
    seed = bench.file.simulation.get("seed", 0)
    return seed if isinstance(seed, int) and not isinstance(seed, bool) else 0


def check_simulation(bench: Bench) -> list[Problem]:
    """Every mistake in the `simulation:` block."""
    problems: list[Problem] = []
    _parameters(bench, problems)
    return problems


@contextmanager
def open_bench(bench: Bench, seed: int, truth_dir: Path | None) -> Iterator[tuple[Station, Clock]]:
    """Open a bench, real or virtual, for a run. Raises BenchFailure; closes everything on the way out."""
    if bench.virtual:
        with _simulated(bench, seed, truth_dir) as opened:
            yield opened
        return
    clock = WallClock()
    station = open_station(bench, clock)
    try:
        yield station, clock
    finally:
        station.close()


@contextmanager
def open_rehearsal(bench: Bench, seed: int) -> Iterator[tuple[Station, Clock]]:
    """Open the bench with the matching simulator under every driver; real ports are not touched."""
    with _simulated(rehearsed(bench), seed, None) as opened:
        yield opened


def rehearsed(bench: Bench) -> Bench:
    """The bench with simulated ports instead of its own, and slow gyros."""
    duts = {serial: _rehearsed(item) for serial, item in bench.duts.items()}
    chamber, table = bench.chamber, bench.rate_table
    return dataclasses.replace(
        bench, chamber=chamber and _rehearsed(chamber), rate_table=table and _rehearsed(table), duts=duts
    )


def _rehearsed(item: Instrument) -> Instrument:
    if isinstance(item.port, CanPort):
        port: str | CanPort = CanPort.model_construct(interface=SIMULATED_CAN, channel=f"rehearsal-{item.name}")
    else:
        port = f"sim://rehearsal-{item.role}-{item.name}".replace(" ", "-")
    settings = item.settings
    if item.role == "dut":
        settings = dataclasses.replace(settings, data_rate_hz=REHEARSED_RATE_HZ)
    return dataclasses.replace(item, port=port, settings=settings)


@contextmanager
def _simulated(bench: Bench, seed: int, truth_dir: Path | None) -> Iterator[tuple[Station, Clock]]:
    world = World(_world_spec(bench, seed), truth_dir)
    try:
        world.open()
    except (WorldError, OSError) as error:
        raise BenchFailure(f"the virtual bench cannot be built: {error}") from error
    try:
        clock = VirtualClock(world.env)
        station = open_station(bench, clock)
        try:
            yield station, clock
        finally:
            station.close()
    finally:
        world.close()


def _world_spec(bench: Bench, seed: int) -> WorldSpec:
    problems: list[Problem] = []
    parameters = _parameters(bench, problems)
    if parameters is None:
        raise InvalidFiles(problems)
    chamber, table, gyros = parameters
    return WorldSpec(
        seed=seed,
        chamber=_spec(bench.chamber) if bench.chamber else None,
        rate_table=_spec(bench.rate_table) if bench.rate_table else None,
        duts={serial: _spec(item) for serial, item in bench.duts.items()},
        site=SiteParameters(bench.file.site.latitude_deg),
        chamber_parameters=chamber,
        table_parameters=table,
        gyro_parameters=gyros,
    )


def _spec(item: Instrument) -> InstrumentSpec:
    return InstrumentSpec(driver=item.driver, address=item.address, settings=item.settings_mapping)


Parameters = tuple[ChamberParameters, TableParameters, dict[str, GyroParameters]]


def _parameters(bench: Bench, problems: list[Problem]) -> Parameters | None:
    simulation = bench.file.simulation
    document = bench.document
    problems += _without_simulator(bench)
    for key in simulation:
        if key not in SIMULATION_KEYS:
            message = f"unknown key '{key}'.{did_you_mean(key, SIMULATION_KEYS)}"
            problems.append(Problem(document.mark(("simulation", key), key=True), message))
    if seed_of(bench) != simulation.get("seed", 0):
        problems.append(Problem(document.mark(("simulation", "seed")), "'seed': a whole number is expected."))
    chamber = _section(bench, ("simulation", "chamber"), ChamberParameters, problems)
    table = _section(bench, ("simulation", "rate_table"), TableParameters, problems)
    given = simulation.get("duts") or {}
    for serial in given if isinstance(given, dict) else ():
        if serial not in bench.duts:
            mark = document.mark(("simulation", "duts", serial), key=True)
            problems.append(Problem(mark, f"there is no DUT '{serial}'.{did_you_mean(serial, bench.duts)}"))
    gyros = {
        serial: _gyro(bench, serial, isinstance(given, dict) and serial in given, problems) for serial in bench.duts
    }
    return None if problems else (chamber, table, {serial: gyro for serial, gyro in gyros.items() if gyro})


def _without_simulator(bench: Bench) -> list[Problem]:
    known = [item.name for item in entry_points(group=SIMULATORS)]
    return [
        Problem(
            bench.document.mark((*item.path, "driver")),
            f"no simulator for driver '{item.driver}'.{did_you_mean(item.driver, known)} (entry points {SIMULATORS})",
        )
        for item in bench.instruments
        if bench.virtual and item.driver not in known
    ]


def _section(bench: Bench, path: Path_, declared: Callable[[], Any], problems: list[Problem]) -> Any:
    if bench.file.simulation.get(str(path[-1])) is None:
        return declared()
    return validate_dataclass(declared, bench.document, path, problems)  # type: ignore[arg-type]


def _gyro(bench: Bench, serial: str, given: bool, problems: list[Problem]) -> GyroParameters | None:
    """Parameters of one simulated gyro: those of its class, changed where the bench file says so."""
    if not given:
        return gyro_class(DEFAULT_GYRO_CLASS)
    path: Path_ = ("simulation", "duts", serial)
    document = bench.document
    written = document.data["simulation"]["duts"][serial]
    name = written.get("class", DEFAULT_GYRO_CLASS) if isinstance(written, dict) else DEFAULT_GYRO_CLASS
    if name not in GYRO_CLASSES:
        hint = did_you_mean(str(name), GYRO_CLASSES)
        problems.append(Problem(document.mark((*path, "class")), f"unknown gyro class '{name}'.{hint}"))
        return None
    if isinstance(written, dict):
        document = _without_class(document, serial)
    values = validate(model_of(GyroParameters), document, path, problems)
    if values is None:
        return None
    if "data_rate_hz" in values.model_fields_set:
        message = f"the data rate of {serial} is that of its settings: set it there, under duts, and leave it out here."
        problems.append(Problem(document.mark((*path, "data_rate")), message))
        return None
    try:
        return _changed(gyro_class(name), values)
    except ValueError as error:
        problems.append(refused(document, path, str(error)))
        return None


def _without_class(document: Any, serial: str) -> Any:
    duts = document.data["simulation"]["duts"]
    kept = {key: value for key, value in duts[serial].items() if key != "class"}
    return dataclasses.replace(document, data={"simulation": {"duts": {serial: kept}}})


def _changed(preset: GyroParameters, values: BaseModel) -> GyroParameters:
    return cast(GyroParameters, _replaced(preset, values))


def _replaced(preset: Any, values: BaseModel) -> Any:
    """The preset with the fields that were written replaced, nested ones field by field."""
    changes: dict[str, Any] = {}
    for name in values.model_fields_set:
        value = getattr(values, name)
        old = getattr(preset, name)
        if isinstance(value, BaseModel):
            changes[name] = _replaced(old, value)
        else:
            changes[name] = tuple(value) if isinstance(value, list) else value
    return dataclasses.replace(preset, **changes)
