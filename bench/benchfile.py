"""The bench file: each instrument's driver, port, settings and limits, and the DUTs by serial number.

A virtual bench has a `simulation:` block too. A real and a virtual bench differ in their ports and in that block, in
nothing else.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Literal

from bench.bench_entries import BenchFile as BenchFile
from bench.bench_entries import CanPort as CanPort
from bench.bench_entries import Entry
from bench.errors import InvalidFiles, Problem, did_you_mean
from bench.fields import validate, validate_dataclass
from bench.yamlfile import Document, Path_, load_yaml

Role = Literal["chamber", "rate_table", "supply", "dut"]
DRIVER_GROUPS: dict[str, str] = {
    "chamber": "fogbench.chambers",
    "rate_table": "fogbench.rate_tables",
    "supply": "fogbench.power_supplies",
    "dut": "fogbench.gyros",
}
SIMULATED_CAN = "fogsim"
DECLARATION_SUFFIXES = {".yaml", ".yml", ".dbc"}


@dataclass(frozen=True)
class Instrument:
    """One instrument of a bench with its driver class found and its settings checked."""

    role: Role
    name: str
    driver: str
    port: str | CanPort
    driver_class: Any
    settings: Any
    path: Path_
    identity: str | None = None

    @property
    def simulated(self) -> bool:
        """Whether the port leads to a simulator."""
        if isinstance(self.port, CanPort):
            return self.port.interface == SIMULATED_CAN
        return self.port.startswith("sim://")

    @property
    def address(self) -> str:
        """The port as one text, also what two instruments may not share."""
        if isinstance(self.port, CanPort):
            return f"can:{self.port.channel}" if self.simulated else f"can:{self.port.interface}/{self.port.channel}"
        return self.port

    def is_it(self, found: str) -> bool:
        """Whether what an instrument says of itself is what the bench file expects; anything is if it says nothing."""
        if self.identity is None:
            return True
        pattern = ".*".join(re.escape(part) for part in self.identity.split("*"))
        return re.fullmatch(pattern, found, re.DOTALL) is not None

    @property
    def where(self) -> str:
        """What messages call it."""
        return f"{self.name} at {self.address}"

    @property
    def settings_mapping(self) -> dict[str, Any]:
        """The driver's settings as plain data, for the simulator that plays its opposite."""
        return dataclasses.asdict(self.settings)


@dataclass(frozen=True)
class Bench:
    """A bench file, checked."""

    file: BenchFile
    document: Document
    chamber: Instrument | None
    rate_table: Instrument | None
    duts: dict[str, Instrument]
    supply: Instrument | None = None

    @property
    def instruments(self) -> Iterator[Instrument]:
        """All instruments, commanded ones first."""
        yield from (item for item in (self.chamber, self.rate_table, self.supply) if item)
        yield from self.duts.values()

    @property
    def powered(self) -> tuple[str, ...]:
        """The DUTs that the supply feeds; none without one."""
        if self.file.supply is None:
            return ()
        powers = self.file.supply.powers
        return tuple(name for name in self.duts if powers is None or name in powers)

    @property
    def declaration_files(self) -> list[Path]:
        """Files that settings refer to (frame declarations, DBC): part of what was run."""
        named = {
            value for item in self.instruments for value in item.settings_mapping.values() if isinstance(value, str)
        }
        return sorted(
            Path(name) for name in named if Path(name).suffix in DECLARATION_SUFFIXES and Path(name).is_file()
        )

    @property
    def virtual(self) -> bool:
        """Whether every port leads to a simulator."""
        return all(item.simulated for item in self.instruments)


def load_bench(
    path: Path, edit: Callable[[Document], Document] = lambda document: document, beside: Path | None = None
) -> tuple[Bench | None, list[Problem]]:
    """Read and check a bench file by itself. Returns what could be read and all mistakes.

    Declarations it names are looked for in the folder `beside`, its own if none is given.
    """
    try:
        document = edit(load_yaml(path))
    except InvalidFiles as error:
        return None, error.problems
    problems: list[Problem] = []
    file = validate(BenchFile, document, (), problems)
    if file is None:
        return None, problems
    found = [_instrument(*item, document, beside or path.parent, problems) for item in _entries(file)]
    instruments = [item for item in found if item]
    _check_ports(instruments, document, problems)
    problems += _supply_problems(file, document)
    if not file.duts:
        problems.append(Problem(document.mark(()), "a bench needs at least one DUT under 'duts:', by serial number."))
    if problems:
        return None, problems
    by_role = {item.role: item for item in instruments}
    duts = {item.name: item for item in instruments if item.role == "dut"}
    return Bench(file, document, by_role.get("chamber"), by_role.get("rate_table"), duts, by_role.get("supply")), []


def _supply_problems(file: BenchFile, document: Document) -> Iterator[Problem]:
    """DUTs named under `powers:` that are not on this bench."""
    for index, name in enumerate(file.supply.powers or ()) if file.supply else ():
        if name not in file.duts:
            mark = document.mark(("supply", "powers", index))
            yield Problem(mark, f"there is no DUT '{name}'.{did_you_mean(name, file.duts)}")


def _entries(file: BenchFile) -> Iterator[tuple[Role, str, Entry, Path_]]:
    if file.chamber:
        yield "chamber", "chamber", file.chamber, ("chamber",)
    if file.rate_table:
        yield "rate_table", "rate table", file.rate_table, ("rate_table",)
    if file.supply:
        yield "supply", "power supply", file.supply, ("supply",)
    for serial, entry in file.duts.items():
        yield "dut", serial, entry, ("duts", serial)


def find_entry_point(group: str, name: str) -> EntryPoint | None:
    """The entry point `name` of a group, or None."""
    return next(iter(entry_points(group=group, name=name)), None)


def _instrument(
    role: Role,
    name: str,
    entry: Entry,
    path: Path_,
    document: Document,
    folder: Path,
    problems: list[Problem],
) -> Instrument | None:
    group = DRIVER_GROUPS[role]
    found = find_entry_point(group, entry.driver)
    if found is None:
        hint = did_you_mean(entry.driver, [item.name for item in entry_points(group=group)])
        mark = document.mark((*path, "driver"))
        problems.append(
            Problem(mark, f"unknown driver '{entry.driver}' for a {name if role != 'dut' else 'DUT'}.{hint}")
        )
        return None
    try:
        driver_class = found.load()
    except ImportError as error:
        message = (
            f"the driver '{entry.driver}' ({found.value}) cannot be loaded: {error}. Is its package installed whole?"
        )
        problems.append(Problem(document.mark((*path, "driver")), message))
        return None
    settings = _settings(driver_class, document, (*path, "settings"), folder, problems)
    if settings is None:
        return None
    return Instrument(role, name, entry.driver, entry.port, driver_class, settings, path, entry.identity)


def _settings(driver_class: Any, document: Document, path: Path_, folder: Path, problems: list[Problem]) -> Any | None:
    data: Any = document.data
    for part in path[:-1]:
        data = data[part]
    given = {key: _beside(folder, value) for key, value in data.get("settings", {}).items()}
    seen = _nested(path, given)
    return validate_dataclass(driver_class.Settings, dataclasses.replace(document, data=seen), path, problems)


def _beside(folder: Path, value: Any) -> Any:
    """A setting that names a file beside the bench file becomes its path."""
    if isinstance(value, str) and Path(value).suffix in DECLARATION_SUFFIXES:
        found = (folder / value, folder / Path(value).name)
        return next((str(path) for path in found if path.is_file()), value)
    return value


def _nested(path: Path_, value: Any) -> Any:
    for part in reversed(path):
        value = {part: value}
    return value


def _check_ports(instruments: list[Instrument], document: Document, problems: list[Problem]) -> None:
    taken: dict[str, Instrument] = {}
    for item in instruments:
        other = taken.setdefault(item.address, item)
        if other is not item and (message := _conflict(item, other)):
            problems.append(Problem(document.mark((*item.path, "port")), message))
    real = [item for item in instruments if not item.simulated]
    if not real and document.data.get("clock"):
        message = (
            "a virtual bench has no wall to run along: leave 'clock:' out. It belongs to fogbench simulate's ports."
        )
        problems.append(Problem(document.mark(("clock",), key=True), message))
    if real and len(real) < len(instruments):
        names = ", ".join(item.where for item in real)
        mark = document.mark((*real[0].path, "port"))
        problems.append(
            Problem(mark, f"some ports are simulated and some real ({names}); a bench is all virtual or all real.")
        )


def _conflict(item: Instrument, other: Instrument) -> str | None:
    """Why two instruments cannot have the same address; on a CAN bus they can, with identifiers of their own."""
    where = f"{item.name} is on {item.address}, where {other.name} already is"
    if not isinstance(item.port, CanPort) or not isinstance(other.port, CanPort):
        return f"{where}. Each needs a port of its own."
    if item.port.bitrate != other.port.bitrate:
        return f"{where}, at {other.port.bitrate} and not {item.port.bitrate} bit/s. A bus has one bitrate."
    identifiers = [
        one.driver_class.can_id(one.settings) for one in (item, other) if hasattr(one.driver_class, "can_id")
    ]
    if len(identifiers) == 2 and identifiers[0] == identifiers[1]:
        return f"{where}, sending the same identifier {identifiers[0] & 0x1FFFFFFF:X}. Give each its own (can_id)."
    return None
