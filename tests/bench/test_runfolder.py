"""Run folders: which names are refused, that nothing is overwritten, and that files are whole."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import ExitCode, UserMistake
from bench.runfolder import check_run_id, copy_into, find_run, new_run_folder, write_atomic, write_json


@pytest.mark.parametrize("run_id", ["a", "ts-1", "2026.01", "A_b-c.d", "x" * 128, "0"])
def test_names_of_runs(run_id: str) -> None:
    check_run_id(run_id)


@pytest.mark.parametrize(
    "run_id",
    ["", ".", "..", "../x", "a/b", "/tmp/x", "a\\b", ".hidden", "-x", "_x", "a b", "a\n", "a\0", "ü", "x.", "x" * 129],
)
def test_names_that_could_leave_the_folder_are_refused(run_id: str, tmp_path: Path) -> None:
    with pytest.raises(UserMistake) as caught:
        new_run_folder(tmp_path, run_id)
    assert "Allowed: letters, digits" in str(caught.value)
    assert caught.value.exit_code == ExitCode.USER_MISTAKE


@given(st.text(max_size=140))
def test_a_name_that_is_taken_is_one_folder_below_the_results(run_id: str) -> None:
    try:
        check_run_id(run_id)
    except UserMistake:
        return
    folder = Path(os.path.normpath(Path("/results") / run_id))
    assert folder.parent == Path("/results")
    assert folder.name == run_id
    assert run_id.isascii()


def test_naming_a_run_creates_nothing(tmp_path: Path) -> None:
    results = tmp_path / "not" / "yet"
    assert new_run_folder(results, "r1") == results / "r1"
    assert list(tmp_path.iterdir()) == []


def refusal(results: Path, run_id: str = "r1") -> str:
    with pytest.raises(UserMistake) as caught:
        new_run_folder(results, run_id)
    return str(caught.value)


def test_a_run_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "r1").mkdir()
    (tmp_path / "r2").write_text("a file in the way")
    for run_id in ("r1", "r2"):
        message = refusal(tmp_path, run_id)
        assert "already exists" in message
        assert "choose another --run-id" in message


def test_results_that_are_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for results in (tmp_path / "file", tmp_path / "file" / "below"):
        message = refusal(results)
        assert "cannot be written" in message
        assert "--results" in message


def test_results_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The superuser may write anywhere, so the question to the system is answered here."""
    (tmp_path / "locked").mkdir()
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: "locked" not in str(path) and access(path, mode))
    message = refusal(tmp_path / "locked" / "results")
    assert str(tmp_path / "locked") in message
    assert "Nothing was started" in message


def test_a_folder_that_may_not_even_be_looked_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "secret").mkdir()
    lstat, stat = Path.lstat, Path.stat
    below = str(tmp_path / "secret") + os.sep

    def guarded(look: object) -> object:
        def inner(self: Path, **options: object) -> object:
            if str(self).startswith(below):
                raise PermissionError(13, "Permission denied")
            return look(self, **options)  # type: ignore[operator]

        return inner

    monkeypatch.setattr(Path, "lstat", guarded(lstat))
    monkeypatch.setattr(Path, "stat", guarded(stat))
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path / "secret")
    assert "cannot be written" in refusal(tmp_path / "secret" / "results")
    with pytest.raises(UserMistake):
        find_run(str(tmp_path / "secret" / "results" / "r1"), tmp_path)


def runs(results: Path, *names: str) -> None:
    for name in names:
        (results / name).mkdir(parents=True)
        (results / name / "journal.jsonl").write_text("")


def test_a_run_is_found_by_id_and_by_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = tmp_path / "results"
    runs(results, "r1", "r2")
    assert find_run("r1", results) == results / "r1"
    assert find_run(str(results / "r2"), tmp_path / "elsewhere") == results / "r2"
    assert find_run(f"{results}/r2/", results) == results / "r2"
    monkeypatch.chdir(results / "r1")
    assert find_run(".", results).resolve() == results / "r1"
    assert find_run("../r2", Path("elsewhere")).resolve() == results / "r2"


def test_a_folder_beside_wins_over_a_run_of_the_same_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs(tmp_path / "results", "r1")
    runs(tmp_path / "here", "r1")
    monkeypatch.chdir(tmp_path / "here")
    assert find_run("r1", tmp_path / "results").resolve() == tmp_path / "here" / "r1"


@pytest.mark.parametrize("run", ["nowhere", "", "../outside", "r", "a\0b", "x" * 300, "r3", "results"])
def test_what_is_no_run_is_refused_with_the_runs_there_are(tmp_path: Path, run: str) -> None:
    results = tmp_path / "results"
    runs(results, *(f"r{k}1" for k in range(10)))
    (results / "r3").mkdir()  # a folder without a journal
    runs(tmp_path, "outside")
    with pytest.raises(UserMistake) as caught:
        find_run(run, results)
    message = str(caught.value)
    assert "neither a run folder nor a run id" in message
    assert "r21, r31, r41, r51, r61, r71, r81, r91" in message
    assert "fogbench list" in message


def test_no_runs_at_all(tmp_path: Path) -> None:
    with pytest.raises(UserMistake, match="There are no runs in"):
        find_run("r1", tmp_path / "nowhere")


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "f"
    write_atomic(path, b"first")
    write_atomic(path, b"second, longer")
    assert path.read_bytes() == b"second, longer"
    assert [entry.name for entry in tmp_path.iterdir()] == ["f"]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "f"
    write_atomic(path, b"old")

    def fails(_: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(OSError, match="Input/output"):
        write_atomic(path, b"new")
    assert path.read_bytes() == b"old"


def test_json_has_null_for_what_is_no_number(tmp_path: Path) -> None:
    value = {
        "a": math.nan,
        "b": [math.inf, (1.5, -math.inf)],
        "c": {"d": np.float64("nan"), "e": np.float64(0.1)},
        "ü": "µ",
        "n": None,
        "t": True,
    }
    write_json(tmp_path / "f.json", value)
    text = (tmp_path / "f.json").read_text(encoding="utf-8")
    assert json.loads(text) == {
        "a": None,
        "b": [None, [1.5, None]],
        "c": {"d": None, "e": 0.1},
        "ü": "µ",
        "n": None,
        "t": True,
    }
    assert "NaN" not in text
    assert "ü" in text
    assert text.endswith("}\n")


def test_copies_are_byte_for_byte(tmp_path: Path) -> None:
    source = tmp_path / "source.yaml"
    source.write_bytes(b"a: 1\r\n\xff")
    copy_into(tmp_path / "run", "included/01-source.yaml", source)
    assert (tmp_path / "run/included/01-source.yaml").read_bytes() == b"a: 1\r\n\xff"
