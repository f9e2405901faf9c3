"""What exported C weighs once it is compiled, where there is a compiler."""

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Os", "-DFOGBENCH_NO_SELFTEST")
_TIMEOUT_S = 60


def compiler() -> str | None:
    """The C compiler of this computer."""
    return next((found for name in ("gcc", "cc", "clang") if (found := shutil.which(name))), None)


def object_bytes(files: Mapping[str, str], source: str) -> int | None:
    """Code and constant data compiled for this computer, without the self-test; None if it cannot be known."""
    tool, measure = compiler(), shutil.which("size")
    if tool is None or measure is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="ascii")
        try:
            _output(folder, tool, *FLAGS, "-c", source, "-o", "object")
            code, data = _output(folder, measure, "object").splitlines()[1].split()[:2]
            return int(code) + int(data)
        except (OSError, subprocess.SubprocessError, ValueError, IndexError):
            return None


def _output(folder: str, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=_TIMEOUT_S)
    return done.stdout
