"""The example repository works as it stands, with the tests that how-to/ci.md shows among its own."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.docs.test_docs import ROOT, blocks

EXAMPLE = ROOT / "docs" / "examples" / "ci"
HOW_TO = ROOT / "docs" / "how-to" / "ci.md"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(
        shutil.copytree(EXAMPLE, tmp_path / "repository", ignore=shutil.ignore_patterns("__pycache__", ".*cache"))
    )


def follow(folder: Path, *arguments: str) -> str:
    """Run a module of Python in a folder; it must succeed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1"}
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_its_tests_and_those_of_the_how_to_pass(copy: Path) -> None:
    shown = [block for block in blocks(HOW_TO) if block.language == "python"]
    for block in shown:
        assert block.name
        (copy / block.name).write_text(block.text, encoding="utf-8")
    ours = (copy / "tests" / "test_acceptance.py").read_text(encoding="utf-8")
    expected = len(re.findall(r"^def test_", "\n".join([ours, *(block.text for block in shown)]), re.MULTILINE)) + 1
    assert f"{expected} passed" in follow(copy, "pytest", "-q", "-p", "no:cacheprovider")


@pytest.mark.campaign
def test_the_commands_of_its_workflow_work(copy: Path) -> None:
    workflow = yaml.safe_load((copy / ".github" / "workflows" / "calibration.yml").read_text(encoding="utf-8"))
    (job,) = workflow["jobs"].values()
    commands = [shlex.split(step["run"]) for step in job["steps"] if step.get("run", "").startswith("fogbench ")]
    assert [command[1] for command in commands] == ["check", "run"]
    for command in commands:
        found = [str(path) for word in command[1:] for path in (sorted(copy.glob(word)) if "*" in word else [word])]
        follow(copy, "bench.cli", *found)
    made = sorted(path.name for path in (copy / "build" / "junit").iterdir())
    assert made == ["acceptance.xml", "check.xml"]
    assert list(copy.glob("build/results/*/report.html"))
