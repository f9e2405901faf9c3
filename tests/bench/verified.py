"""A small run to verify and to damage, and what may be done to it."""

import json
import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

from tests.bench import campaigns

SMALL = """\
procedure: small
raw: frames
quality: {slope: 5 degC/min}
steps:
  - set_rate: 0 deg/s
  - sweep:
      temperature: {from: 20 degC, to: 30 degC, step: 10 K}
      steps:
        - soak: 5 min
        - sweep:
            rate: {from: -50 deg/s, to: 50 deg/s, step: 50 deg/s}
            steps:
              - settle: {band: 0.02 deg/s, for: 1 s, timeout: 30 s}
              - acquire: {count: 10, every: 0.2 s}
analysis:
  models: [linear]
  splits: {random: {train: 4}, leave_temperatures_out: {folds: 2}}
  limits: [{model: linear, split: random, max_abs: 100 deg/s}]
"""


def small_run(folder: Path, **changes: Any) -> Path:
    """Run it; the run folder."""
    return campaigns.run_campaign(folder, "r", SMALL, **changes).folder


def copy_of(run: Path, folder: Path) -> Path:
    """A copy that may be damaged."""
    return Path(shutil.copytree(run, folder / "r", dirs_exist_ok=True))


def rewrite_json(path: Path, change: Callable[[Any], None]) -> None:
    """Change a JSON file as fogbench writes it, and have its hash in the manifest of its run follow."""
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    follow(path)


def follow(path: Path) -> None:
    """Give the manifest the hash of a file that was changed: a forgery that only making it again can tell."""
    run = next(folder for folder in path.parents if (folder / "manifest.json").is_file())
    manifest = json.loads((run / "manifest.json").read_text())
    name = path.relative_to(run).as_posix()
    if name in manifest["files"]:
        manifest["files"][name] = sha256(path.read_bytes()).hexdigest()
        (run / "manifest.json").write_text(json.dumps(manifest, indent=1, ensure_ascii=False) + "\n")
