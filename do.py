#!/usr/bin/env python3
"""python3 do.py campaign · test · bench: sets up .venv with what the project needs, then runs.

Standard library only, so that a machine needs nothing but Python.
"""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")
LOG = VENV / "setup.log"

# Published experiment -> procedure and bench (docs/reference/experiments.md).
EXPERIMENTS = {
    "ts": ("temperature_rate_grid", "virtual"),
    "ts648": ("temperature_rate_grid_648", "virtual"),
    "rlg": ("rlg_thermal_cycle", "virtual_rlg"),
    "bp": ("bp_stepped_cycle", "virtual_bp"),
    "north": ("north_seeking", "virtual_north"),
}

# A file's tests share what they run, so a file stays in one process.
PARALLEL = ("-n", "auto", "--dist", "loadfile")

USAGE = """usage: python3 do.py COMMAND

  campaign     run the reference campaign (155 hours and more) on the virtual bench, fit it, write the report
  experiments  the four published experiments (ts, rlg, bp, north) on their virtual benches, and one page of results
  test         style, types, import contracts, the fast tests and a whole campaign
  fast         style, types, import contracts and the fast tests only
  bench        the benchmarks; bench peers --install also fits other packages, in environments of their own
  crash        kill -9 a small campaign 200 times, virtual and on live simulators, resume it each time, print the tally
  setup        only set up .venv
"""


def set_up(extra: str) -> None:
    """Create .venv and install the project with its `extra`; done once, redone if interrupted or if needs changed."""
    wanted = hashlib.sha256((ROOT / "pyproject.toml").read_bytes() + sys.version.encode()).hexdigest()
    stamps = {name: VENV / f"fogbench-{name}.stamp" for name in ("run", "dev")}
    accepted = [stamps["dev"]] if extra == "dev" else list(stamps.values())
    if any(path.exists() and path.read_text() == wanted for path in accepted):
        return
    if sys.version_info < (3, 11):
        sys.exit(f"fogbench needs Python 3.11 or newer; this is {sys.version.split()[0]}. Try: python3.12 do.py …")
    print(f"setting up {VENV.name} (once; a few minutes on a slow network) …", file=sys.stderr, flush=True)
    began = time.monotonic()
    if not PYTHON.exists():
        try:
            venv.create(VENV, with_pip=True)
        except (OSError, subprocess.CalledProcessError) as error:
            shutil.rmtree(VENV, ignore_errors=True)
            sys.exit(f"error: {VENV.name} could not be made: {error}\nOn Debian and Ubuntu: apt install python3-venv")
    target = f"{ROOT}[dev]" if extra == "dev" else str(ROOT)
    command = [str(PYTHON), "-m", "pip", "install", "--disable-pip-version-check", "--editable", target]
    with LOG.open("wb") as log:
        status = subprocess.run(command, stdout=log, stderr=subprocess.STDOUT, cwd=ROOT, check=False).returncode
    if status:
        tail = LOG.read_text(errors="replace").splitlines()[-15:]
        sys.exit("\n".join([*tail, f"error: pip could not install fogbench; all of its output is in {LOG}"]))
    # Written last, so that a set-up that was interrupted is done again.
    stamps["dev" if extra == "dev" else "run"].write_text(wanted)
    print(f"set up in {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)


def run(*command: str) -> int:
    """Run a program of the environment from the project's folder; its exit status."""
    process = subprocess.Popen([str(BIN / command[0]), *command[1:]], cwd=ROOT)
    # Ctrl-C reaches the program too; it must have the time to leave the bench safe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return process.wait()
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def campaign(arguments: list[str]) -> int:
    """The reference campaign on the virtual bench."""
    set_up("run")
    procedure, bench = "procedures/temperature_rate_grid.yaml", "benches/virtual.yaml"
    return run("fogbench", "run", procedure, "--bench", bench, *arguments)


def experiments(arguments: list[str]) -> int:
    """The four published experiments, one after the other, and their page; the worst exit status of them."""
    set_up("run")
    began = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    runs, statuses = [], []
    for name, (procedure, bench) in EXPERIMENTS.items():
        runs.append(f"{name}-{began}")
        files = f"procedures/{procedure}.yaml", "--bench", f"benches/{bench}.yaml"
        statuses.append(run("fogbench", "run", *files, "--run-id", runs[-1], *arguments))
    title = "The four published experiments on the virtual bench"
    page = ROOT / "results" / f"experiments-{began}.html"
    statuses.append(run("fogbench", "overview", *runs, "--title", title, "-o", str(page)))
    return max(statuses)


def checks() -> int:
    """Style, types and import contracts; the first that fails."""
    steps = (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",), ("lint-imports",))
    return next((status for status in (run(*step) for step in steps) if status), 0)


def fast(arguments: list[str]) -> int:
    """Checks and the fast tests."""
    set_up("dev")
    return checks() or run("pytest", "-q", *PARALLEL, *arguments)


def test(arguments: list[str]) -> int:
    """Checks, the fast tests, then whole campaigns."""
    set_up("dev")
    return checks() or run("pytest", "-q", *PARALLEL, "-m", "not long", *arguments)


def bench(arguments: list[str]) -> int:
    """The benchmarks."""
    set_up("dev")
    return run("python", "-m", "benchmarks", *arguments)


def crash(arguments: list[str]) -> int:
    """The kill -9 trial."""
    set_up("dev")
    return run("python", "-m", "tests.crash", *arguments)


def setup(arguments: list[str]) -> int:
    """Only the environment, with the tools for development."""
    set_up("dev")
    return 0


COMMANDS = {
    "campaign": campaign,
    "experiments": experiments,
    "test": test,
    "fast": fast,
    "bench": bench,
    "crash": crash,
    "setup": setup,
}


def main() -> int:
    """Dispatch; unknown commands get the usage."""
    if len(sys.argv) < 2 or sys.argv[1] not in COMMANDS:
        print(USAGE, file=sys.stderr)
        return 2
    try:
        return COMMANDS[sys.argv[1]](sys.argv[2:])
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
