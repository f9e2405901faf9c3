"""The documents keep their word: files in them are accepted, commands run, links lead somewhere, reference is current.

Convention in the documents: the second word behind the fence is the name under which a block is to be saved
(```yaml my_grid.yaml); `refused` behind it says that the file has mistakes on purpose, `on my_bench.yaml` which bench a
procedure is for. Blocks are taken in the order in which a reader meets them.
"""

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from bench.benchfile import load_bench
from bench.check import check
from bench.composition import check_simulation
from bench.errors import InvalidFiles
from drivers.codecs.frame_spec import FrameSpec

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "results" / "README.md"])
WITH_BLOCKS = [page for page in PAGES if "```" in page.read_text(encoding="utf-8")]
TRIED = re.compile(r"fogbench (check|dry-run|list|schema)\b")
FENCE = re.compile(r"^```(.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Not of `(` and `)` inside code; images count as links.
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the words behind it, its text."""

    language: str
    words: tuple[str, ...]
    text: str

    @property
    def name(self) -> str | None:
        return self.words[0] if self.words else None


def blocks(page: Path) -> Iterator[Block]:
    for info, text in FENCE.findall(page.read_text(encoding="utf-8")):
        language, *words = info.split() or [""]
        yield Block(language, tuple(words), text)


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder like a reader's: the procedures and benches of the project, room for files of one's own."""
    for folder in ("procedures", "benches"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", WITH_BLOCKS, ids=name_of)
def test_files_and_commands(page: Path, desk: Path) -> None:
    for block in blocks(page):
        if block.name:
            save(desk / block.name, block)
        if block.language == "yaml":
            accept(desk / (block.name or "unnamed.yaml"), block)
        elif block.language in ("console", "bash"):
            for command, printed in commands(block):
                follow(command, printed, desk)


def save(path: Path, block: Block) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(block.text, encoding="utf-8")
    if path.name == "pyproject.toml":
        install(path)


def install(pyproject: Path) -> None:
    """What pip leaves of a package's entry points; the package itself is on the path already."""
    project = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"]
    folder = pyproject.parent / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = project["entry-points"].items()
    lines = [f"[{group}]\n" + "".join(f"{name} = {at}\n" for name, at in points.items()) for group, points in groups]
    (folder / "entry_points.txt").write_text("\n".join(lines))


def accept(path: Path, block: Block) -> None:
    """A whole procedure, bench file or frame passes its check, or does not if it says so; fragments are left alone."""
    path.write_text(block.text, encoding="utf-8")
    data = yaml.safe_load(block.text)
    if "procedure" in data:
        bench = Path(block.words[2] if "on" in block.words else "benches/virtual.yaml")
        if "refused" in block.words:
            with pytest.raises(InvalidFiles):
                check(path, bench)
        else:
            check(path, bench)
    elif "bench" in data:
        loaded, problems = load_bench(path)
        assert loaded and not problems, problems
        assert not check_simulation(loaded)
    elif "header" in data:
        FrameSpec.load(str(path))


def commands(block: Block) -> Iterator[tuple[str, list[str]]]:
    """The commands of a block that are tried, each with what the document says it prints."""
    prompt = "$ " if block.language == "console" else ""
    lines = block.text.splitlines()
    starts = [number for number, line in enumerate(lines) if line.startswith(prompt)]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        command = lines[start].removeprefix(prompt)
        if TRIED.match(command):
            yield command, [line for line in lines[start + 1 : end] if line != "…"]


def follow(command: str, printed: list[str], desk: Path) -> None:
    """Run a command. It succeeds unless an error is shown; what `check` is said to print it prints."""
    arguments = shlex.split(command)[1:]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(desk)]), "NO_COLOR": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "bench.cli", *arguments],
        cwd=desk, env=environment, capture_output=True, text=True, encoding="utf-8", timeout=60, check=False,
    )  # fmt: skip
    failing = any(line.startswith("error: ") for line in printed)
    assert (done.returncode != 0) == failing, f"{command}\n{done.stdout}{done.stderr}"
    if arguments[0] == "check":
        said = (done.stdout + done.stderr).splitlines()
        assert not [line for line in printed if line not in said], f"{command}\n{done.stdout}{done.stderr}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for target in LINK.findall(text):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        assert there.exists(), f"{name_of(page)}: {target}"
        assert not anchor or anchor in anchors(there), f"{name_of(page)}: {target}"


def anchors(page: Path) -> set[str]:
    """The anchors that a Markdown page gets from its headings."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_document_is_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    listed = {(ROOT / "docs" / target).resolve() for target in LINK.findall(index)}
    missing = [name_of(page) for page in ROOT.glob("docs/**/*.md") if page.name != "README.md" and page not in listed]
    assert not missing


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate_reference", ROOT / "docs" / "generate_reference.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["procedure.md", "bench.md"])
def test_reference_pages_are_up_to_date(page: str) -> None:
    written = (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8")
    assert written == generator().PAGES[page](), "run: python docs/generate_reference.py"
