"""The page about one's own data, followed to the letter: commands, notebook cells, the C program."""

import importlib.util
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fitting.export.compiled import compiler
from tests.docs.test_docs import ROOT, Block, blocks

PAGE = ROOT / "docs" / "tutorial-your-data.md"
DATA = ROOT / "docs" / "examples" / "your-data"
# A page says 0.000312; another BLAS or compiler may say 0.00033.
NEAR = 0.3
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?$")


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    return Path(shutil.copytree(DATA, tmp_path / "desk"))


def test_everything_on_the_page_works_and_prints_what_it_says(desk: Path) -> None:
    page = list(blocks(PAGE))
    tried = 0
    for block, following in zip(page, [*page[1:], Block("", (), "")], strict=True):
        if block.name:
            (desk / block.name).write_text(block.text, encoding="utf-8")
        if block.language == "python":
            tried += same(run(desk, sys.executable, "-c", block.text), following.text.splitlines())
        elif block.language == "console":
            for command in block.text.split("$ ")[1:]:
                first, *printed = command.splitlines()
                tried += same(typed(desk, first), printed)
    assert tried >= 10


def typed(desk: Path, command: str) -> str | None:
    """A command of the page; None for one that needs a compiler where there is none."""
    words = shlex.split(command)
    if words[0] == "fogbench":
        return run(desk, sys.executable, "-m", "bench.cli", *words[1:])
    assert words[0] in ("gcc", "./main")
    tool = compiler()
    if tool is None:
        return None
    return run(desk, *([tool, *words[1:]] if words[0] == "gcc" else [str(desk / "main")]))


def run(desk: Path, *arguments: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        arguments, cwd=desk, env=environment, capture_output=True, text=True, encoding="utf-8", timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def same(output: str | None, printed: list[str]) -> bool:
    """Compare what was printed with the page, line by line; … stands for any lines, numbers may differ a little."""
    if output is None:
        return False
    lines = [line.split() for line in output.splitlines()]
    for expected in (line.split() for line in printed if line.strip() not in ("…", "")):
        assert any(alike(expected, line) for line in lines), f"{' '.join(expected)}\nis not in\n{output}"
    return True


def alike(expected: list[str], line: list[str]) -> bool:
    return len(expected) == len(line) and all(map(alike_words, expected, line))


def alike_words(expected: str, word: str) -> bool:
    if expected == word or word == "–":
        return True
    if not (NUMBER.match(expected) and NUMBER.match(word)):
        return False
    return math.isclose(float(expected), float(word), rel_tol=NEAR, abs_tol=1e-3 if "." in expected else 0.0)


def test_the_recordings_are_what_their_script_makes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make", DATA / "make.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(tmp_path)
    for made in sorted(tmp_path.iterdir()):
        ours, fresh = pd.read_csv(DATA / made.name), pd.read_csv(made)
        assert list(ours.columns) == list(fresh.columns)
        assert np.allclose(ours, fresh, atol=2e-3, equal_nan=True)
        assert made.stat().st_size < 100_000
