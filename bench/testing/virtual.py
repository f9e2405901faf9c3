"""A bench file on simulated instruments, with faults and other parameters, and procedures run on it.

A real bench file serves as well: its ports are replaced, so that no test ever opens a real one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.benchfile import SIMULATED_CAN
from bench.check import Checked, check
from bench.composition import seed_of
from bench.errors import UserMistake
from bench.forecast import rehearse
from bench.overrides import Override, parse_overrides
from bench.run import RunRequest, prepare, run
from bench.testing.results import CheckedPlan, DryRun, VirtualRun, readable
from bench.timeline import phases, remarks
from bench.yamlfile import load_yaml

# benches/virtual.yaml, which is not installed.
PACKAGED = Path(__file__).with_name("virtual.yaml")
SIMULATED = "sim://"

Settings = Mapping[str, Any]


@dataclass(frozen=True)
class Desk:
    """Where a test works: where its runs go, where its files are looked for, and who is told what came of a run."""

    results: Path
    roots: Sequence[Path]
    tell: Callable[[str], None]

    def find(self, path: str | Path) -> Path:
        """A file by its path in one of the roots, the first if it is in none."""
        candidates = [root / path for root in self.roots]
        return next((candidate for candidate in candidates if candidate.is_file()), candidates[0])

    def next_run_id(self) -> str:
        """run-1, run-2 … in the order of the test."""
        taken = len(list(self.results.glob("run-*"))) if self.results.is_dir() else 0
        return f"run-{taken + 1}"


@dataclass(frozen=True)
class VirtualBench:
    """A virtual bench; every change gives a new one and leaves this one as it is."""

    desk: Desk
    file: Path
    changes: Sequence[Override] = ()
    faults: Sequence[Settings] = ()

    def fault(self, name: str, on: str, **about: Any) -> VirtualBench:
        """The bench with one more fault, by name, on 'chamber', 'rate_table', 'supply' or a DUT's serial number.

        `about` are the keys of the fault as the bench file has them: at="30 min", probability=1e-3,
        when={"chamber_below": "-10 degC"}; Python's keyword is written with an underscore, for_="10 min".
        """
        fault = {"name": name, "on": on} | {key.rstrip("_"): value for key, value in about.items()}
        return replace(self, faults=(*self.faults, fault))

    def simulation(self, **parameters: Any) -> VirtualBench:
        """The bench with other parameters of its simulation, as its `simulation:` block names them; others stay.

        Example: simulation(seed=7, chamber={"cooling_power": "300 W"}, duts={"FOG-A01": {"noise": {"arw": 0.1}}})
        """
        leaves = _leaves(("simulation",), parameters)
        return replace(self, changes=(*self.changes, *(_override("bench", path, value) for path, value in leaves)))

    @readable
    def set(self, path: str, value: Any) -> VirtualBench:
        """The bench with one value changed for every run, as by --set: set("bench.site.latitude", "48 deg")."""
        return replace(self, changes=(*self.changes, *_parsed({path: value})))

    @readable
    def run(self, procedure: str | Path, set: Settings | None = None, seed: int | None = None) -> VirtualRun:
        """Run a procedure file; `set` changes single values of it, {"procedure.raw": "none"}.

        Any outcome is a result. Raises UserMistake or InvalidFiles for what `fogbench check` refuses, and BenchFailure
        if an instrument does not answer before the run begins.
        """
        desk = self.desk
        overrides = self._overrides(set or {})
        request = RunRequest(desk.find(procedure), self.file, desk.results, desk.next_run_id(), seed, overrides)
        prepared = prepare(request)
        _require_virtual(prepared.checked)
        ended = VirtualRun(run(prepared))
        desk.tell(repr(ended))
        return ended

    @readable
    def check(self, procedure: str | Path, set: Settings | None = None) -> CheckedPlan:
        """Check a procedure on this bench. Raises InvalidFiles with every mistake."""
        checked = check(self.desk.find(procedure), self.file, self._overrides(set or {}))
        duts = list(checked.bench.duts)
        return CheckedPlan(len(checked.plan), checked.points, duts, checked.duration_s, checked.disk_bytes)

    @readable
    def dry_run(self, procedure: str | Path, set: Settings | None = None, seed: int | None = None) -> DryRun:
        """Rehearse a procedure as `fogbench dry-run` does: at its real pace, without frames, files and faults."""
        checked = check(self.desk.find(procedure), self.file, self._overrides(set or {}))
        forecast = rehearse(checked, seed if seed is not None else seed_of(checked.bench))
        warnings = [*forecast.warnings, *remarks(checked.plan, forecast.ends_s)]
        listed = [phase.as_dict() for phase in phases(checked.plan, forecast.ends_s)]
        steps, points = len(checked.plan), checked.points
        return DryRun(forecast.duration_s, steps, points, warnings, forecast.failure, listed)

    def _overrides(self, more: Settings) -> list[Override]:
        """Everything that makes the bench file this bench, in the form of --set, so that a run can be resumed."""
        data = load_yaml(self.file).data
        bench: dict[str, Any] = data if isinstance(data, dict) else {}
        simulation = bench.get("simulation")
        overrides = list(_rewired(bench))
        if self.faults or any(change.path[0] == "simulation" for change in self.changes):
            overrides += [] if "simulation" in bench else [_override("bench", ("simulation",), {})]
        if self.faults:
            written = simulation.get("faults") if isinstance(simulation, dict) else None
            faults = [*(written if isinstance(written, list) else []), *self.faults]
            overrides.append(_override("bench", ("simulation", "faults"), faults))
        return [*overrides, *self.changes, *_parsed(more)]

    def __repr__(self) -> str:
        """What pytest shows beside an assertion that failed."""
        faults = ", ".join(f"{fault['name']} on {fault['on']}" for fault in self.faults)
        return f"<virtual bench {self.file.name}{f' with {faults}' if faults else ''}>"


def _leaves(path: tuple[str, ...], value: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The single values of nested mappings, each with its path."""
    if not isinstance(value, Mapping):
        yield path, value
        return
    for key, inner in value.items():
        yield from _leaves((*path, str(key)), inner)


def _override(root: str, path: tuple[str, ...], value: Any) -> Override:
    return Override(root, path, _plain(value), f"{root}.{'.'.join(path)}={_text(value)}")


def _parsed(settings: Settings) -> list[Override]:
    return parse_overrides([f"{path}={_text(value)}" for path, value in settings.items()])


def _text(value: Any) -> str:
    """A value as YAML in one line, which JSON is."""
    return json.dumps(value, ensure_ascii=False, default=str)


def _plain(value: Any) -> Any:
    """The value as YAML would give it: no tuples, no paths."""
    return json.loads(_text(value))


def _rewired(bench: Settings) -> Iterator[Override]:
    """Simulated ports in the place of real ones. What is no bench file is left for its check to refuse."""
    duts = bench.get("duts")
    places = [(name,) for name in ("chamber", "rate_table", "supply")]
    for path in [*places, *(("duts", str(serial)) for serial in (duts if isinstance(duts, dict) else ()))]:
        entry = bench
        for part in path:
            entry = entry.get(part) or {} if isinstance(entry, dict) else {}
        port = entry.get("port") if isinstance(entry, dict) else None
        if isinstance(port, str) and not port.startswith(SIMULATED):
            yield _override("bench", (*path, "port"), f"{SIMULATED}{'-'.join(path)}")
        elif isinstance(port, dict) and port.get("interface") != SIMULATED_CAN:
            yield _override("bench", (*path, "port", "interface"), SIMULATED_CAN)


def _require_virtual(checked: Checked) -> None:
    real = [item.where for item in checked.bench.instruments if not item.simulated]
    if real:
        raise UserMistake(
            f"a test opens no real ports, and was given {', '.join(real)}. Leave 'port' as the file has it."
        )
