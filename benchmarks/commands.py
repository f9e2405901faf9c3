"""How long the commands take that people wait for; each in a process of its own, best and median of five."""

import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GRID = ["procedures/temperature_rate_grid.yaml", "--bench", "benches/virtual.yaml"]
COMMANDS = {"--help": ["--help"], "check (703 points)": ["check", *GRID], "dry-run (703 points)": ["dry-run", *GRID]}
REPEATS = 5


def main() -> None:
    """Print wall times."""
    interpreter = _best([sys.executable, "-c", "pass"])[0]
    print(f"{'python -c pass':<24} {interpreter:6.2f} s")
    for name, arguments in COMMANDS.items():
        best, median = _best([sys.executable, "-m", "bench.cli", *arguments])
        ratio = best / interpreter
        print(f"{'fogbench ' + name:<24} {best:6.2f} s best, {median:.2f} s median, {ratio:.1f} x python itself")


def _best(command: list[str]) -> tuple[float, float]:
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - began)
    return min(times), statistics.median(times)
