"""One virtual bench: a simpy environment, the plants, and a simulated instrument at every address.

A world is opened, used by unmodified drivers through their ports, and closed:

    with World(spec, truth_dir=None) as world:
        port = serial.serial_for_url("sim://chamber", baudrate=19200)
        world.env.run(until=3600.0)

Every instrument may be missing: DUTs without a chamber stand in the room, without a table they stand still. One seed
decides everything that is drawn, and adding a DUT changes nothing for the others.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import entry_points
from pathlib import Path
from types import TracebackType
from typing import Any, cast

import serial
import simpy

from simulated_hw.faults.install import Faults, Plant, Seen
from simulated_hw.faults.kinds import FAULTS, FaultSpec, faults_of
from simulated_hw.faults.unpowered import follow_power
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.gyro_classes import GYRO_CLASSES, gyro_class
from simulated_hw.physics.gyro_parameters import GyroParameters
from simulated_hw.physics.parameters import ChamberParameters, SiteParameters, TableParameters
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.seeker import gyro_unit
from simulated_hw.physics.supply import SupplyParameters, SupplyPlant
from simulated_hw.truth import TruthLog
from simulated_hw.wire import switchboard

__all__ = [
    "FAULTS",
    "GYRO_CLASSES",
    "ChamberParameters",
    "FaultSpec",
    "GyroParameters",
    "InstrumentSpec",
    "SiteParameters",
    "SupplyParameters",
    "TableParameters",
    "World",
    "WorldError",
    "WorldSpec",
    "faults_of",
    "gyro_class",
]

_SIMULATORS = "fogbench.simulators"
# pyserial looks here for modules named protocol_<scheme>.
_HANDLERS = "simulated_hw.wire"

# A simulator by its entry point: of the environment, the plant as it is to see it, and the driver's settings.
Maker = Callable[[simpy.Environment, Seen, dict[str, Any]], switchboard.Instrument]


class WorldError(Exception):
    """A virtual bench that cannot be built as described."""


@dataclass(frozen=True)
class InstrumentSpec:
    """One instrument as the bench file has it.

    Fields:
        driver: its name, under which a simulator is found too (entry points `fogbench.simulators`).
        address: 'sim://NAME' for a serial port, 'can:NAME' for a CAN channel.
        settings: the driver's settings, field names as keys.
    """

    driver: str
    address: str
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class WorldSpec:
    """A virtual bench.

    Fields:
        seed: decides every random number.
        chamber, rate_table, duts: the instruments; DUTs by serial number.
        supply: the power supply, its output on at the beginning. powered: serial numbers of the DUTs that it feeds, all
            if None; without a supply every DUT has power all the time.
        site, chamber_parameters, table_parameters, supply_parameters: the plant.
        gyro_parameters: by serial number; a DUT without an entry gets `GyroParameters()`. The data rate is the one in
            the DUT's settings (`data_rate_hz`) if it is there.
        faults: what goes wrong, numbered in this order.
    """

    seed: int
    chamber: InstrumentSpec | None = None
    rate_table: InstrumentSpec | None = None
    duts: Mapping[str, InstrumentSpec] = field(default_factory=dict)
    supply: InstrumentSpec | None = None
    powered: tuple[str, ...] | None = None
    site: SiteParameters = field(default_factory=SiteParameters)
    chamber_parameters: ChamberParameters = field(default_factory=ChamberParameters)
    table_parameters: TableParameters = field(default_factory=TableParameters)
    supply_parameters: SupplyParameters = field(default_factory=SupplyParameters)
    gyro_parameters: Mapping[str, GyroParameters] = field(default_factory=dict)
    faults: tuple[FaultSpec, ...] = ()


class World:
    """The plants and simulated instruments of one spec; `env` is their clock.

    `start_s` is the time at which it begins, everything at rest and at room temperature: a bench after a power cut.
    With a truth_dir the hidden parameters and the true course of things are written there (`simulated_hw.truth`), with
    a `live_truth_period_s` this often and at once. `earlier` are the truth_dirs of earlier worlds of the same run: a
    fault that came once in one of them does not come again.
    """

    def __init__(
        self,
        spec: WorldSpec,
        truth_dir: Path | None = None,
        start_s: float = 0.0,
        live_truth_period_s: float | None = None,
        earlier: Sequence[Path] = (),
    ) -> None:
        self.spec, self._earlier = spec, tuple(earlier)
        self.env = simpy.Environment(initial_time=start_s)
        self.chamber = ChamberPlant(spec.chamber_parameters, spec.seed)
        self.table = TablePlant(spec.table_parameters, spec.seed)
        self._powered = () if spec.supply is None else tuple(spec.duts if spec.powered is None else spec.powered)
        # A world that begins later is of a run that goes on: none of its turn-ons has been before, at one a second.
        self._power = PowerHistory(int(start_s))
        self.supply = SupplyPlant(spec.supply_parameters, spec.seed, len(self._powered), self._power)
        self.gyros = {name: self._gyro(name, instrument) for name, instrument in spec.duts.items()}
        self._truth_dir, self._live_truth_period_s = truth_dir, live_truth_period_s
        self._truth: TruthLog | None = None
        # Only on a bench with faults; see `simulated_hw.faults.log` for what its `log` says.
        self.faults: Faults | None = None
        self._attached: list[str] = []

    def _gyro(self, name: str, instrument: InstrumentSpec) -> GyroUnit:
        parameters = self.spec.gyro_parameters.get(name, GyroParameters())
        data_rate_hz = float(instrument.settings.get("data_rate_hz", parameters.data_rate_hz))
        return gyro_unit(
            replace(parameters, data_rate_hz=data_rate_hz),
            self.chamber,
            self.table,
            seed=self.spec.seed,
            serial=name,
            site=self.spec.site,
            power=self._power if name in self._powered else None,
        )

    def open(self) -> None:
        """Put every instrument at its address and start the truth log.

        Raises WorldError for a driver without a simulator, an address that is taken or a fault that a simulator cannot
        show, OSError if the truth cannot be written; nothing stays attached then.
        """
        if _HANDLERS not in serial.protocol_handler_packages:
            serial.protocol_handler_packages.append(_HANDLERS)
        try:
            if self.spec.faults:
                plants = (self.chamber, self.table)
                logs = self._truth_dir, self._earlier
                self.faults = Faults(self.spec.faults, self.spec.seed, self.env, *plants, *logs)
            for name, instrument, plant in self._instruments():
                self._attach(name, instrument, plant)
            if self._truth_dir is not None:
                seed, often_s = self.spec.seed, self._live_truth_period_s
                self._truth = TruthLog(self._truth_dir, self.env, self.chamber, self.table, self.gyros, seed, often_s)
        except BaseException:
            self.close()
            raise

    def _instruments(self) -> Iterator[tuple[str, InstrumentSpec, Plant]]:
        if self.spec.chamber is not None:
            yield "chamber", self.spec.chamber, self.chamber
        if self.spec.rate_table is not None:
            yield "rate_table", self.spec.rate_table, self.table
        if self.spec.supply is not None:
            yield "supply", self.spec.supply, self.supply
        for name, instrument in self.spec.duts.items():
            yield name, instrument, self.gyros[name]

    def _attach(self, name: str, instrument: InstrumentSpec, plant: Plant) -> None:
        make, settings = _simulator(instrument.driver), dict(instrument.settings)
        seen = self.faults.under(name, plant) if self.faults else plant
        simulator = make(self.env, seen, settings)
        try:
            if self.faults:
                simulator = self.faults.over(name, simulator, plant, seen)
            if isinstance(plant, GyroUnit) and name in self._powered:
                log = self.faults.log if self.faults else None
                follow_power(name, simulator, plant, self._power, log)
        except ValueError as error:
            raise WorldError(str(error)) from error
        self._put(instrument.address, simulator)

    def _put(self, address: str, simulator: switchboard.Instrument) -> None:
        try:
            switchboard.attach(address, simulator)
        except ValueError as error:
            raise WorldError(str(error)) from error
        self._attached.append(address)

    def close(self) -> None:
        """Detach every instrument and finish the truth log; closing twice is harmless."""
        while self._attached:
            switchboard.detach(self._attached.pop())
        if self._truth is not None:
            self._truth.close()
        if self.faults is not None:
            self.faults.close()

    def __enter__(self) -> "World":
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _simulator(driver: str) -> Maker:
    found = entry_points(group=_SIMULATORS)
    if driver not in found.names:
        names = ", ".join(sorted(found.names)) or "none: is fogbench installed?"
        raise WorldError(f"no simulator for driver {driver!r}; there are {names} (entry points {_SIMULATORS})")
    loaded = found[driver].load()
    return cast(Maker, loaded)
