"""Environments of their own for peers that the project does not install: .venv-peers, made on request only."""

import hashlib
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

from benchmarks.peer_runs import last_line

FOLDER = Path(__file__).resolve().parent.parent / ".venv-peers"
INSTALL_LIMIT_S = 1800.0

# One for each peer, because their pins contradict one another (pyFUME wants numpy 1.24.4 and scipy 1.10.1 exactly,
# xanfis numpy up to 1.26.0). The releases are named so that the figures can be repeated.
REQUIREMENTS: dict[str, tuple[str, ...]] = {
    "pyfume": ("pyFUME==0.3.4",),
    "xanfis": ("xanfis==1.1.0", "torch==2.13.0"),
    "anfis-toolbox": ("anfis-toolbox==0.2.2",),
    "neo-ls-svm": ("neo-ls-svm==0.3.0",),
}


def python_of(name: str) -> Path:
    """Its interpreter."""
    return FOLDER / name / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _stamp(name: str) -> tuple[Path, str]:
    """File written when an installation is complete, and what is in it then."""
    wanted = " ".join((*REQUIREMENTS[name], sys.version))
    return FOLDER / name / "peer.stamp", hashlib.sha256(wanted.encode()).hexdigest()


def is_ready(name: str) -> bool:
    """Whether it was installed completely, by this Python and with today's requirements."""
    path, wanted = _stamp(name)
    return path.exists() and path.read_text() == wanted


def install(name: str) -> str | None:
    """Make an environment anew unless it is ready; why that failed, in one line."""
    if is_ready(name):
        return None
    log = FOLDER / f"{name}.log"
    shutil.rmtree(FOLDER / name, ignore_errors=True)
    command = [str(python_of(name)), "-m", "pip", "install", "--disable-pip-version-check", *REQUIREMENTS[name]]
    try:
        venv.create(FOLDER / name, with_pip=True)
        with log.open("wb") as output:
            finished = subprocess.run(
                command, stdout=output, stderr=subprocess.STDOUT, timeout=INSTALL_LIMIT_S, check=False
            )
    except subprocess.TimeoutExpired:
        return f"pip was not done after {INSTALL_LIMIT_S:g} s"
    except (OSError, subprocess.CalledProcessError) as problem:
        return f"the environment could not be made: {problem}"
    if finished.returncode:
        return f"pip: {last_line(log, 'ERROR')}"
    path, wanted = _stamp(name)
    path.write_text(wanted)  # last, so that an interrupted installation is done again
    return None
