"""Files that are broken, foreign or made to do harm: the documented refusal, little memory, an end."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.benchfile import load_bench
from bench.journal import JournalDamaged, load_journal
from bench.procedure.parse import parse_procedure
from bench.report.data import read_run
from drivers.codecs.can_spec import CanSpec
from drivers.codecs.declared import FrameSpecError
from drivers.codecs.frame_spec import FrameSpec
from drivers.gyros.can_dbc import CanGyroSettings
from fitting.modelfile import ModelFileError, load_model
from tests.bench.verified import copy_of, small_run
from tests.fuzz.fuzzing import EXAMPLES, broken, fuzz, memory_below

ROOT = Path(__file__).resolve().parents[2]
GYROS = ROOT / "drivers" / "gyros" / "frames"
PROCEDURES = sorted((ROOT / "procedures").glob("*.yaml"))
BENCHES = sorted((ROOT / "benches").glob("*.yaml"))
DECLARATIONS = sorted(GYROS.glob("*.yaml"))
DBCS = sorted(GYROS.glob("*.dbc"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run(tmp_path_factory.mktemp("fuzz"))


def declaration(path: Path) -> None:
    try:
        FrameSpec.load(str(path))
    except FrameSpecError as error:
        assert len(str(error)) < 5000


def dbc(path: Path) -> None:
    for use in (lambda: CanSpec.from_settings({"dbc": str(path)}), lambda: CanGyroSettings(dbc=str(path))):
        with contextlib.suppress(FrameSpecError):
            use()


def procedure(path: Path) -> None:
    found, problems = parse_procedure(path)
    assert found is not None or problems
    assert all(len(str(problem)) < 5000 for problem in problems)


def bench(path: Path) -> None:
    found, problems = load_bench(path)
    assert (found is None) == bool(problems)
    assert all(len(str(problem)) < 5000 for problem in problems)


def journal(path: Path) -> None:
    try:
        assert load_journal(path)[0]["kind"] == "journal"
    except JournalDamaged as error:
        assert len(str(error)) < 2000


def model(path: Path) -> None:
    try:
        load_model(path).predict([20.0], [1.0])
    except ModelFileError as error:
        assert len(str(error)) < 2000


Parser = Callable[[Path], None]
TEXTS: dict[str, tuple[Parser, list[Path]]] = {
    "declaration": (declaration, DECLARATIONS),
    "dbc": (dbc, DBCS),
    "procedure": (procedure, PROCEDURES),
    "bench": (bench, BENCHES),
}


def fuzz_file(parse: Parser, whole: list[bytes], path: Path, examples: int) -> None:
    def written(data: bytes) -> None:
        path.write_bytes(data)
        parse(path)

    fuzz(broken(*whole), written, examples)


@EXAMPLES
@pytest.mark.parametrize("kind", list(TEXTS))
def test_texts_that_people_write(kind: str, examples: int, tmp_path: Path) -> None:
    parse, files = TEXTS[kind]
    assert files
    fuzz_file(parse, [path.read_bytes() for path in files], tmp_path / files[0].name, examples)


@EXAMPLES
@pytest.mark.parametrize(("name", "parse"), [("journal.jsonl", journal), ("models/FOG-A01/linear.json", model)])
def test_files_that_a_run_writes(name: str, parse: Parser, run: Path, tmp_path: Path, examples: int) -> None:
    fuzz_file(parse, [(run / name).read_bytes()], tmp_path / "file", examples)


REPORTED = ("manifest.json", "metrics.json", "points.csv", "residuals.parquet", "timeline.parquet")


@EXAMPLES
@pytest.mark.parametrize("name", REPORTED)
def test_a_run_folder_for_the_report(name: str, run: Path, tmp_path: Path, examples: int) -> None:
    copy = copy_of(run, tmp_path)

    def parse(path: Path) -> None:
        data = read_run(copy)
        assert all(len(note) < 2000 for note in data.notes)

    fuzz_file(parse, [(run / name).read_bytes()], copy / name, max(10, examples // 20))


LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{name}: &{name} [{','.join([f'*{before}'] * 9)}]\n"
    for before, name in zip("abcdefghij", "bcdefghijk", strict=True)
)
MERGES = "a: &a {x: 1}\n" + "".join(f"k{n}: &k{n} {{<<: *a, y{n}: 1}}\n" for n in range(200))
NESTED = {
    "lists": "[" * 5_000,
    "mappings": "{a: " * 3_000,
    "indents": "\n".join(" " * n + "a:" for n in range(300)),
    "dashes": "- " * 5_000,
    "laughs": LAUGHS,
    "laughs in fields": LAUGHS + "fields: *k\nname: *k\nbase: kvh_36\n",
    "itself": "a: &a [*a]\nfields: &b {x: *b}\nbase: kvh_36",
    "merges": MERGES,
    "a long number": "length: " + "9" * 20_000,
    "a long float": "base: kvh_36\nrate: {scale: 1e" + "9" * 5000 + "}",
    "a long text": "name: " + "x" * 20_000,
    "many keys": "\n".join(f"k{n}: 1" for n in range(2000)),
    "the same key": "a: 1\n" * 2000,
    "quotes": '"' * 30_001,
    "anchors": "\n".join(f"k{n}: &a{n} 1" for n in range(1000)),
    "tags": "a: !!python/object/apply:os.system [x]\nb: !!int 5\n",
}


@pytest.mark.parametrize("text", list(NESTED.values()), ids=list(NESTED))
@pytest.mark.parametrize("kind", ["declaration", "procedure", "bench"])
def test_yaml_made_to_do_harm(kind: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "it.yaml"
    path.write_text(text)
    TEXTS[kind][0](DECLARATIONS[0] if kind == "declaration" else path)  # what is imported on first use does not count
    with memory_below(60):
        TEXTS[kind][0](path)


BO = "BO_ 1 M: 8 X\n"
HARMFUL_DBCS = {
    "a long id": f"BO_ {'9' * 6000} M: 8 X\n",
    "a long length": f"BO_ 1 M: {'9' * 6000} X\n",
    "a long start": f'{BO} SG_ s : {"9" * 6000}|8@1+ (1,0) [0|0] "" X',
    "a long factor": f'{BO} SG_ s : 0|8@1+ (1e{"9" * 6000},0) [0|0] "" X',
    "a factor without end": f'{BO} SG_ rate : 0|8@1+ (1e999,0) [0|0] "" X',
    "an offset that is no number": f'{BO} SG_ rate : 0|8@1+ (1,nan) [0|0] "deg/s" X',
    "blanks": f"{BO} SG_ s{' ' * 50_000}",
    "a comment without end": f'{BO}CM_ "' + "x" * 60_000,
    "quotes": f"{BO}CM_ " + '"' * 60_001,
    "comments": f'{BO}CM_ "' + '\\"' * 30_000,
    "signals": BO + "".join(f' SG_ s{n} : 0|8@1+ (1,0) [0|0] "" X\n' for n in range(1500)),
    "messages": "".join(f"BO_ {n} M{n}: 8 X\n" for n in range(4000)),
    "a long value type": f"{BO}SIG_VALTYPE_ {'9' * 6000} s : 1;",
    "a signal far away": f'{BO} SG_ rate : 99999999|64@0+ (1,0) [0|0] "deg/s" X',
}


@pytest.mark.parametrize("text", list(HARMFUL_DBCS.values()), ids=list(HARMFUL_DBCS))
def test_dbc_made_to_do_harm(text: str, tmp_path: Path) -> None:
    path = tmp_path / "it.dbc"
    path.write_text(text)
    with memory_below(60):
        dbc(path)


def nested(depth: int) -> str:
    return '{"a":' * depth + "1" + "}" * depth


HARMFUL_JSON = {
    "nested": nested(50_000),
    "lists": "[" * 100_000,
    "a long number": '{"version": ' + "9" * 100_000 + "}",
    "a long exponent": '{"version": 1e' + "9" * 1000 + "}",
    "many keys": json.dumps({f"k{n}": n for n in range(20_000)}),
    "not finite": '{"inputs": [NaN, Infinity, -Infinity]}',
    "half a pair": '{"kind": "\\ud800"}',
    "long": '{"kind": "' + "x" * 500_000 + '"}',
}


@pytest.mark.parametrize("text", list(HARMFUL_JSON.values()), ids=list(HARMFUL_JSON))
@pytest.mark.parametrize("name", ["model", "manifest.json", "metrics.json", "journal.jsonl"])
def test_json_made_to_do_harm(name: str, text: str, run: Path, tmp_path: Path) -> None:
    from zlib import crc32

    path = copy_of(run, tmp_path) / name
    body = text.encode()
    path.write_bytes(b"%08x %s\n" % (crc32(body), body) if name == "journal.jsonl" else body)

    def report(path: Path) -> Any:
        return read_run(path.parent)

    parse = {"model": model, "journal.jsonl": journal}.get(name, report)
    with memory_below(60):
        parse(path)
