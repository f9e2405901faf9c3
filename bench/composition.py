"""The composition root: puts real ports or a simulated world under the drivers. The only importer of simulated_hw."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from can import CanError

from bench.benchfile import Bench, CanPort, Instrument
from bench.clock import Clock, VirtualClock, WallClock
from bench.errors import BenchFailure, InvalidFiles, Problem, did_you_mean
from bench.faultfile import read_faults
from bench.fields import changed, model_of, refused, validate, validate_dataclass
from bench.opening import open_station
from bench.rewiring import check_identifiers, rehearsed, rewired
from bench.station import Station
from bench.yamlfile import Path_
from simulated_hw.live import LiveBench
from simulated_hw.live import LiveOptions as LiveOptions
from simulated_hw.world import (
    FAULTS,
    GYRO_CLASSES,
    ChamberParameters,
    FaultSpec,
    GyroParameters,
    InstrumentSpec,
    SiteParameters,
    SupplyParameters,
    TableParameters,
    World,
    WorldError,
    WorldSpec,
    faults_of,
    gyro_class,
)

DEFAULT_GYRO_CLASS = "ts_a"
SIMULATORS = "fogbench.simulators"
# The truth of a resumed run's attempt n is in a folder attempt-n inside that of its first.
LATER_ATTEMPT = "attempt-"
SIMULATION_KEYS = ("seed", "chamber", "rate_table", "supply", "duts", "faults")


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
def open_bench(
    bench: Bench,
    seed: int,
    truth_dir: Path | None,
    start_s: float = 0.0,
    duts: Collection[str] | None = None,
    may_be_absent: Collection[str] = (),
    may_be_off: bool = False,
) -> Iterator[tuple[Station, Clock]]:
    """Open a bench, real or virtual, for a run whose clock begins at `start_s`; of the DUTs as `open_station` has it.

    Raises BenchFailure; closes everything on the way out. A virtual bench begins at rest and at room temperature.
    """
    if bench.virtual:
        with _simulated(bench, seed, truth_dir, start_s, duts, may_be_absent, may_be_off) as opened:
            yield opened
        return
    clock = WallClock(start_s, bench.file.clock.speed)
    station = open_station(bench, clock, duts, may_be_absent, may_be_off)
    try:
        yield station, clock
    finally:
        station.close()


@contextmanager
def open_rehearsal(bench: Bench, seed: int) -> Iterator[tuple[Station, Clock]]:
    """Open the bench with the matching simulator under every driver; real ports are not touched."""
    with _simulated(rehearsed(bench), seed, None) as opened:
        yield opened


LivePorts = dict[Path_, str | dict[str, Any]]


@contextmanager
def open_live(
    bench: Bench,
    seed: int,
    options: LiveOptions,
    truth_dir: Path | None,
    truth_period_s: float,
    tell: Callable[[str], None],
) -> Iterator[tuple[LiveBench, LivePorts]]:
    """Put the simulator of every instrument of a bench on a real port; time passes when it is told to serve.

    Yields it, and what stands under `port:` to connect to each instrument. Raises UserMistake and BenchFailure.
    """
    wired = rewired(bench, "live")
    rates = {item.address: item.port.bitrate for item in wired.instruments if isinstance(item.port, CanPort)}
    if options.can:
        check_identifiers(wired)
    options = dataclasses.replace(options, bitrates=rates)
    live = LiveBench(_world_spec(wired, seed), options, truth_dir, truth_period_s, tell)
    try:
        live.open()
    except (WorldError, CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise BenchFailure(f"the live simulators cannot be started: {error}") from error
    ports: LivePorts = {}
    for item in wired.instruments:
        address = live.addresses[item.address]
        if isinstance(address, str):
            ports[item.path] = address
        else:
            ports[item.path] = {"interface": address[0], "channel": address[1], "bitrate": rates[item.address]}
    try:
        yield live, ports
    finally:
        live.close()


@contextmanager
def _simulated(
    bench: Bench,
    seed: int,
    truth_dir: Path | None,
    start_s: float = 0.0,
    duts: Collection[str] | None = None,
    may_be_absent: Collection[str] = (),
    may_be_off: bool = False,
) -> Iterator[tuple[Station, Clock]]:
    world = World(_world_spec(bench, seed), truth_dir, start_s, earlier=_truth_before(truth_dir))
    try:
        world.open()
    except (WorldError, OSError) as error:
        raise BenchFailure(f"the virtual bench cannot be built: {error}") from error
    try:
        clock = VirtualClock(world.env)
        station = open_station(bench, clock, duts, may_be_absent, may_be_off)
        try:
            yield station, clock
        finally:
            station.close()
    finally:
        world.close()


def _truth_before(truth_dir: Path | None) -> list[Path]:
    """Where the truth of a run's earlier attempts is: of the first in the folder around, of the others beside it."""
    if truth_dir is None or not truth_dir.name.startswith(LATER_ATTEMPT):
        return []
    beside = sorted(truth_dir.parent.glob(f"{LATER_ATTEMPT}*"))
    return [truth_dir.parent, *(folder for folder in beside if folder != truth_dir)]


def _world_spec(bench: Bench, seed: int) -> WorldSpec:
    problems: list[Problem] = []
    parameters = _parameters(bench, problems)
    if parameters is None:
        raise InvalidFiles(problems)
    chamber, table, supply, gyros, faults = parameters
    return WorldSpec(
        seed=seed,
        chamber=_spec(bench.chamber) if bench.chamber else None,
        rate_table=_spec(bench.rate_table) if bench.rate_table else None,
        duts={serial: _spec(item) for serial, item in bench.duts.items()},
        supply=_spec(bench.supply) if bench.supply else None,
        powered=bench.powered,
        site=SiteParameters(bench.file.site.latitude_deg, bench.file.site.azimuth_deg),
        chamber_parameters=chamber,
        table_parameters=table,
        supply_parameters=supply,
        gyro_parameters=gyros,
        faults=faults,
    )


def _spec(item: Instrument) -> InstrumentSpec:
    return InstrumentSpec(driver=item.driver, address=item.address, settings=item.settings_mapping)


Parameters = tuple[
    ChamberParameters, TableParameters, SupplyParameters, dict[str, GyroParameters], tuple[FaultSpec, ...]
]


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
    supply = _supply(bench, problems)
    given = simulation.get("duts") or {}
    for serial in given if isinstance(given, dict) else ():
        if serial not in bench.duts:
            mark = document.mark(("simulation", "duts", serial), key=True)
            problems.append(Problem(mark, f"there is no DUT '{serial}'.{did_you_mean(serial, bench.duts)}"))
    gyros = {
        serial: _gyro(bench, serial, isinstance(given, dict) and serial in given, problems) for serial in bench.duts
    }
    faults = tuple(FaultSpec(*fault) for fault in read_faults(bench, FAULTS, faults_of, problems))
    if problems or supply is None:
        return None
    return chamber, table, supply, {serial: gyro for serial, gyro in gyros.items() if gyro}, faults


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


def _supply(bench: Bench, problems: list[Problem]) -> SupplyParameters | None:
    """A supply that can do what the driver's settings ask for, changed where the bench file says so."""
    settings, usual = bench.supply.settings if bench.supply else None, SupplyParameters()
    voltage_v = getattr(settings, "voltage_v", None) or usual.voltage_v
    current_a = getattr(settings, "current_limit_a", None) or usual.current_limit_a
    preset = dataclasses.replace(
        usual,
        voltage_v=voltage_v,
        current_limit_a=current_a,
        max_voltage_v=max(usual.max_voltage_v, voltage_v),
        max_current_a=max(usual.max_current_a, current_a),
        # DUTs for which it is enough, whatever it is.
        lowest_voltage_v=min(usual.lowest_voltage_v, 0.6 * voltage_v),
        dut_current_a=min(usual.dut_current_a, current_a / (2.0 * max(1, len(bench.powered)))),
    )
    path: Path_ = ("simulation", "supply")
    if bench.file.simulation.get("supply") is None:
        return preset
    values = validate(model_of(SupplyParameters), bench.document, path, problems)
    try:
        return None if values is None else changed(preset, values)
    except ValueError as error:
        problems.append(refused(bench.document, path, str(error)))
        return None


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
        parameters = changed(gyro_class(name), values)
    except ValueError as error:
        problems.append(refused(document, path, str(error)))
        return None
    if parameters.kind == "north_seeker" and bench.file.site.latitude_deg is None:
        message = f"{serial} seeks north, for which it needs the earth's rotation: say where the bench stands."
        problems.append(Problem(document.mark(path, key=True), f"{message} Example: site: {{latitude: 40 deg}}"))
        return None
    return parameters


def _without_class(document: Any, serial: str) -> Any:
    duts = document.data["simulation"]["duts"]
    kept = {key: value for key, value in duts[serial].items() if key != "class"}
    return dataclasses.replace(document, data={"simulation": {"duts": {serial: kept}}})
