"""The reference campaign, whole: wall time, virtual-to-wall ratio, memory, and where the time goes."""

import resource
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


class Shares:
    """Exclusive wall time per part of the house: what is inside a wrapped call counts for the innermost part only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._stack: list[tuple[str, float]] = []
        self._main = threading.get_ident()

    def wrap(self, owner: Any, name: str, part: str) -> None:
        """Count the time of `owner.name` for `part`; calls from other threads count for '<part> (2nd core)'."""
        inner: Callable[..., Any] = getattr(owner, name)

        def measured(*args: Any, **kwargs: Any) -> Any:
            if threading.get_ident() != self._main:
                began = time.perf_counter()
                try:
                    return inner(*args, **kwargs)
                finally:
                    self.seconds[f"{part} (2nd core)"] += time.perf_counter() - began
            self._switch(part)
            try:
                return inner(*args, **kwargs)
            finally:
                self._back()

        setattr(owner, name, measured)

    def _switch(self, part: str) -> None:
        now = time.perf_counter()
        if self._stack:
            outer, began = self._stack[-1]
            self.seconds[outer] += now - began
        self._stack.append((part, now))

    def _back(self) -> None:
        now = time.perf_counter()
        part, began = self._stack.pop()
        self.seconds[part] += now - began
        if self._stack:
            self._stack[-1] = (self._stack[-1][0], now)


def main() -> None:
    """Run it as `fogbench run` does and print the figures."""
    from bench import conclude, journal, rawstore
    from bench import run as running
    from bench.report import render
    from drivers.gyros import can_dbc as can_driver
    from drivers.gyros import serial_frames as serial_driver
    from simulated_hw.physics import chamber, gyro, rate_table
    from simulated_hw.wire import can_dbc as can_wire
    from simulated_hw.wire import serial_frames as serial_wire

    shares = Shares()
    shares.wrap(gyro.GyroUnit, "block", "simulation")
    for plant in (chamber.ChamberPlant, rate_table.TablePlant):
        for name in [n for n, f in vars(plant).items() if callable(f) and not n.startswith("_")]:
            shares.wrap(plant, name, "simulation")
    for owner, name in (
        (serial_wire.SimulatedSerialGyro, "bytes_until"),
        (can_wire.SimulatedCanGyro, "payload"),
        (serial_driver.SerialGyro, "take"),
        (can_driver.CanGyro, "take"),
    ):
        shares.wrap(owner, name, "wire")
    shares.wrap(rawstore, "write_parquet", "storage")
    shares.wrap(rawstore.RawStore, "put", "storage")
    shares.wrap(journal.Journal, "append", "storage")
    shares.wrap(journal.Journal, "commit", "storage")
    shares.wrap(conclude, "analyse", "fit")
    shares.wrap(running, "prepare", "check and rehearsal")
    shares.wrap(running, "run", "engine, reduction, files")
    with tempfile.TemporaryDirectory() as folder:
        request = running.RunRequest(
            ROOT / "procedures" / "temperature_rate_grid.yaml", ROOT / "benches" / "virtual.yaml", Path(folder), "bench"
        )
        began = time.perf_counter()
        end = running.run(running.prepare(request))
        shares._switch("report")
        render.write_report(end.folder)
        shares._back()
        wall = time.perf_counter() - began
        _print(end, wall, shares)


def _print(end: Any, wall: float, shares: Shares) -> None:
    manifest = end.manifest
    frames = sum(dut["frames"] for dut in manifest["data_quality"].values())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    raw = sum(path.stat().st_size for path in (end.folder / "raw").iterdir())
    print(f"outcome {end.outcome}; {manifest['points_measured']} points of {len(manifest['duts'])} DUTs")
    ratio, speed = manifest["duration_s"] / wall, frames / wall / 1e6
    print(f"bench time {manifest['duration_s'] / 3600:.1f} h in {wall:.1f} s of wall time (check, run, fit, report):")
    print(f"  {ratio:,.0f} times real time; peak memory {memory:.0f} MB; raw files {raw / 1e6:.0f} MB")
    print(f"  {frames / 1e6:.1f} M frames encoded, checked and decoded: {speed:.2f} M frames/s over everything")
    print("where the wall time goes (exclusive):")
    for part, seconds in sorted(shares.seconds.items(), key=lambda item: -item[1]):
        print(f"  {part:<28} {seconds:6.2f} s  {100 * seconds / wall:5.1f} %")
