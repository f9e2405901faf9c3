"""Damaged runs: files cut, zeroed, flipped, overwritten, grown and lost at random places. Nothing passes in silence.

Every change of a byte must be told, with one exception: manifest.json holds the hashes and nothing holds its own, so
there it is every change of what it says. A flipped blank between two keys says the same.
"""

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.rawstore import RawFileDamaged, read_parquet
from bench.verify.verify import verify
from tests.bench.verified import copy_of, small_run

RAW = "raw/p00002-FOG-B01.parquet"
FILES = (
    "journal.jsonl",
    RAW,
    "points.csv",
    "points.parquet",
    "timeline.parquet",
    "residuals.parquet",
    "metrics.json",
    "models/FOG-A01/linear.json",
    "manifest.json",
    "procedure.yaml",
    "bench.yaml",
)
# What is done to the bytes of a file.
Damage = Callable[[bytes], bytes | None]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("damage")
    return copy_of(small_run(folder), folder / "copy")


def put(data: bytes, at: float, instead: bytes, length: int) -> bytes:
    place = min(int(at * len(data)), len(data) - 1)
    return data[:place] + instead + data[place + length :]


def flip(data: bytes, at: float, bit: int) -> bytes:
    place = min(int(at * len(data)), len(data) - 1)
    return put(data, at, bytes([data[place] ^ 1 << bit]), 1)


ANYWHERE = st.floats(0, 1)
CUTS = ANYWHERE.map(lambda at: ("cut", lambda data: data[: int(at * len(data))]))
FLIPS = st.tuples(ANYWHERE, st.integers(0, 7)).map(lambda f: ("flip", lambda data: flip(data, *f)))
ZEROS = st.tuples(ANYWHERE, st.integers(1, 5000)).map(
    lambda z: ("zero", lambda data: put(data, z[0], bytes(z[1]), z[1])[: len(data)])
)
OTHERS = st.tuples(ANYWHERE, st.binary(min_size=1, max_size=40)).map(
    lambda o: ("overwrite", lambda data: put(data, o[0], o[1], len(o[1])))
)
GROWTH = st.tuples(ANYWHERE, st.binary(min_size=1, max_size=40)).map(
    lambda o: ("insert", lambda data: put(data, o[0], o[1], 0))
)
LOST = st.just(("lose", lambda data: None))
LINES = st.integers(0, 400).map(
    lambda keep: ("cut at a line", lambda data: b"".join(data.splitlines(keepends=True)[:keep]))
)
DAMAGES = st.one_of(FLIPS, CUTS, ZEROS, OTHERS, GROWTH, LINES, LOST)


def same_content(name: str, before: bytes, after: bytes | None) -> bool:
    """Whether the damage changes nothing that can be read."""
    if after is None or name != "manifest.json":
        return after == before
    try:
        return bool(json.loads(before) == json.loads(after))
    except ValueError:
        return False


def damage_and_verify(run: Path, examples: int) -> Counter[str]:
    """How many damages of each kind changed something and were told; fails with those that were not."""
    tally: Counter[str] = Counter()
    silent: list[tuple[str, str]] = []

    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(st.sampled_from(FILES), DAMAGES)
    def one(name: str, damage: tuple[str, Damage]) -> None:
        kind, change = damage
        path = run / name
        before = path.read_bytes()
        after = change(before)
        try:
            path.unlink()
            if after is not None:
                path.write_bytes(after)
            told = bool(verify(run).wrong) if (run / "journal.jsonl").exists() else True
        finally:
            path.write_bytes(before)
        if same_content(name, before, after):
            tally["changed nothing"] += 1
            return
        tally[kind] += 1
        tally["damages"] += 1
        if not told:
            silent.append((name, kind))

    one()
    assert not silent
    assert verify(run).wrong == []
    return tally


def test_no_damage_is_accepted_in_silence(run: Path) -> None:
    assert damage_and_verify(run, 50)["damages"] >= 25


@pytest.mark.long
def test_no_damage_of_thousands_is_accepted_in_silence(run: Path) -> None:
    tally = damage_and_verify(run, 3000)
    assert tally["damages"] >= 2000, tally


def test_every_bit_of_a_raw_file_counts(run: Path, tmp_path: Path) -> None:
    data = (run / RAW).read_bytes()
    path = tmp_path / "p.parquet"
    accepted = []
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << place % 8
        path.write_bytes(damaged)
        try:
            read_parquet(path)
        except RawFileDamaged:
            continue
        accepted.append(place)
    assert accepted == []


def test_a_raw_file_cut_anywhere_is_refused(run: Path, tmp_path: Path) -> None:
    data = (run / RAW).read_bytes()
    path = tmp_path / "p.parquet"
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        with pytest.raises(RawFileDamaged):
            read_parquet(path)
