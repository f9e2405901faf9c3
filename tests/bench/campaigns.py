"""Small campaigns for tests: files written to a folder, run through the same functions as the command line."""

from pathlib import Path
from typing import Any

import yaml

from bench.conclude import RunEnd
from bench.overrides import parse_overrides
from bench.run import RunRequest, prepare, run

ROOT = Path(__file__).resolve().parents[2]
VIRTUAL = ROOT / "benches" / "virtual.yaml"

# 4 temperatures x 7 rates; soaks far too short for a lab and long enough for the wire.
GRID = """\
procedure: small_grid
raw: frames
quality: {slope: 5 degC/min}
steps:
  - set_rate: 0 deg/s
  - sweep:
      temperature: {from: 0 degC, to: 30 degC, step: 10 K}
      steps:
        - soak: 10 min
        - sweep:
            rate: {from: -150 deg/s, to: 150 deg/s, step: 50 deg/s}
            steps:
              - settle: {band: 0.02 deg/s, for: 1 s, timeout: 30 s}
              - acquire: {count: 20, every: 0.5 s}
  - set_rate: 0 deg/s
analysis:
  models: [linear]
  splits:
    random: {train: 20}
    leave_temperatures_out: {folds: 2}
  limits:
    - {model: linear, split: random, max_abs: 100 deg/s}
"""

# A minute or more at the wall and a moment to rehearse: for what is stopped, paused or killed while it is under way.
ENDLESS_POINTS = 400
ENDLESS = f"""\
procedure: endless
raw: none
steps:
  - set_rate: 20 deg/s
  - repeat:
      times: {ENDLESS_POINTS}
      steps:
        - acquire: {{for: 10 min, every: 1 s}}
"""


def write(folder: Path, name: str, text: str) -> Path:
    """Write a YAML file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def virtual_bench(folder: Path, **simulation: Any) -> Path:
    """The default virtual bench with another `simulation:` block."""
    bench = yaml.safe_load(VIRTUAL.read_text(encoding="utf-8"))
    bench["simulation"] = simulation
    return write(folder, "bench.yaml", yaml.safe_dump(bench, sort_keys=False))


def run_campaign(
    folder: Path,
    run_id: str,
    procedure: str = GRID,
    bench: Path = VIRTUAL,
    settings: tuple[str, ...] = (),
    seed: int | None = None,
) -> RunEnd:
    """Run a procedure text; the results are in folder/results."""
    request = RunRequest(
        write(folder, f"{run_id}.yaml", procedure), bench, folder / "results", run_id, seed, parse_overrides(settings)
    )
    return run(prepare(request))
