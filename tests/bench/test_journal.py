"""The journal under every cut and every flipped byte: whole records, in order, or a refusal; never a wrong record."""

import json
import zlib
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.journal import FORMAT, Entry, Journal, JournalDamaged, MemoryLog, encode, read_journal

ENTRIES: list[Entry] = [
    {"n": 0, "t_s": 0.0, "kind": "journal", "format": FORMAT, "run_id": "r1"},
    {"n": 1, "t_s": 0.5, "kind": "note", "text": 'größer\nals 5 °C \u2028 "x" abcdef'},
    {"n": 2, "t_s": 1.25, "kind": "point", "row": {"point": 1, "rate_mean_dps": -180.0000001, "u": None}},
    {"n": 3, "t_s": 1e6, "kind": "end", "failure": None},
]


def written(folder: Path, name: str = "journal.jsonl") -> Path:
    path = folder / name
    journal = Journal.create(path, {"run_id": "r1"})
    for entry in ENTRIES[1:]:
        fields = {key: value for key, value in entry.items() if key not in ("n", "t_s", "kind")}
        journal.append(entry["kind"], entry["t_s"], **fields)
    journal.close()
    return path


def read(path: Path) -> list[Entry]:
    return list(read_journal(path))


class Stored:
    """A file that is only in memory, for thousands of damaged ones."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def read_bytes(self) -> bytes:
        return self._data


def outcome(data: bytes) -> tuple[list[Entry], bool]:
    """The records that come back, and whether damage was reported."""
    entries: list[Entry] = []
    try:
        for entry in read_journal(cast(Path, Stored(data))):
            entries.append(entry)
    except JournalDamaged:
        return entries, True
    return entries, False


CLEAN = b"".join(map(encode, ENTRIES))
LAST_LINE = CLEAN[:-1].rindex(b"\n")


def test_what_was_written_is_read(tmp_path: Path) -> None:
    assert read(written(tmp_path)) == ENTRIES


def test_a_line_is_a_checksum_of_the_json_after_it(tmp_path: Path) -> None:
    """Read without the reader: one line per record, CRC-32 as zip and Ethernet have it, compact UTF-8 JSON."""
    lines = written(tmp_path).read_bytes().splitlines(keepends=True)
    assert len(lines) == len(ENTRIES)
    for line, entry in zip(lines, ENTRIES, strict=True):
        assert line[8:9] == b" "
        assert line.endswith(b"}\n")
        assert int(line[:8], 16) == zlib.crc32(line[9:-1])
        assert json.loads(line[9:]) == entry
    assert "größer" in lines[1].decode()
    # The check value of CRC-32/ISO-HDLC, for the algorithm itself.
    assert zlib.crc32(b"123456789") == 0xCBF43926


def test_a_journal_is_never_written_over(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        Journal.create(path, {"run_id": "r2"})
    assert path.read_bytes() == before


def test_a_commit_is_on_disk_and_an_append_is_kept_by_close(tmp_path: Path) -> None:
    path = tmp_path / "j"
    journal = Journal.create(path, {})
    assert [entry["kind"] for entry in read(path)] == ["journal"]
    journal.append("note", 1.0, text="a")
    journal.commit()
    assert [entry["kind"] for entry in read(path)] == ["journal", "note"]
    journal.append("note", 2.0, text="b")
    journal.close()
    journal.close()
    assert [entry.get("text") for entry in read(path)] == [None, "a", "b"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_number_json_does_not_have_is_refused_and_leaves_no_trace(tmp_path: Path, value: float) -> None:
    journal = Journal.create(tmp_path / "j", {})
    with pytest.raises(ValueError):
        journal.append("point", 1.0, row={"x": value})
    journal.append("note", 2.0, text="after")
    journal.close()
    assert [(entry["n"], entry["kind"]) for entry in read(tmp_path / "j")] == [(0, "journal"), (1, "note")]


def test_cut_anywhere_the_whole_records_before_the_cut_come_back() -> None:
    ends = [position + 1 for position, byte in enumerate(CLEAN) if byte == ord("\n")]
    for cut in range(len(CLEAN) + 1):
        whole = sum(end <= cut for end in ends)
        assert outcome(CLEAN[:cut]) == (ENTRIES[:whole], False), cut


@pytest.mark.parametrize("flip", [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xFF])
def test_a_flipped_byte_never_gives_a_wrong_record(flip: int) -> None:
    for position in range(len(CLEAN)):
        entries, damaged = outcome(CLEAN[:position] + bytes([CLEAN[position] ^ flip]) + CLEAN[position + 1 :])
        assert entries == ENTRIES[: len(entries)], position
        assert len(entries) <= CLEAN[:position].count(b"\n"), position
        # A damaged last line looks like one torn by a crash. So do the last two, run together by a damaged line end.
        assert damaged or position >= LAST_LINE, position


def test_damage_before_a_torn_line_is_reported() -> None:
    """Only the last line may be torn; a bad one before it was damaged otherwise."""
    torn = encode(ENTRIES[3] | {"n": 4})[:20]
    flipped = CLEAN[:-5] + b"x" + CLEAN[-4:]
    assert outcome(flipped) == (ENTRIES[:3], False)
    assert outcome(CLEAN + torn) == (ENTRIES, False)
    assert outcome(flipped + torn) == (ENTRIES[:3], True)


@given(st.integers(0, LAST_LINE - 1), st.integers(1, 200), st.binary(max_size=20))
def test_any_damage_before_the_last_line_is_reported(start: int, length: int, instead: bytes) -> None:
    end = min(start + length, LAST_LINE)
    data = CLEAN[:start] + instead + CLEAN[end:]
    entries, damaged = outcome(data)
    assert entries == ENTRIES[: len(entries)]
    assert damaged or data == CLEAN


@given(st.binary(max_size=200))
def test_any_bytes_are_no_journal(data: bytes) -> None:
    assert outcome(data)[0] == []


@pytest.mark.parametrize(
    ("lines", "number"),
    [
        ([0, 2, 3], 2),
        ([0, 1, 1, 2], 3),
        ([0, 2, 1, 3], 2),
        ([1, 2, 3], 1),
        ([0, 1, 3], 3),
    ],
    ids=["one missing", "one twice", "exchanged", "no head", "one missing before the last"],
)
def test_records_out_of_order_are_refused(tmp_path: Path, lines: list[int], number: int) -> None:
    path = tmp_path / "j"
    path.write_bytes(b"".join(encode(ENTRIES[line]) for line in lines))
    with pytest.raises(JournalDamaged) as caught:
        read(path)
    message = str(caught.value)
    assert f"{path}:{number}:" in message
    assert "Restore the file from a copy" in message


@pytest.mark.parametrize("head", [{"format": FORMAT + 1}, {"format": None}, {"kind": "note"}])
def test_another_format_is_refused(tmp_path: Path, head: Entry) -> None:
    path = tmp_path / "j"
    path.write_bytes(encode(ENTRIES[0] | head) + encode(ENTRIES[1]))
    with pytest.raises(JournalDamaged, match="another version"):
        read(path)


@pytest.mark.parametrize("body", [b"[1]", b"5", b'"text"', b"{", b"", b"\xff\xfe", b"[" * 100_000])
def test_a_right_checksum_over_something_else_is_refused(tmp_path: Path, body: bytes) -> None:
    path = tmp_path / "j"
    line = b"%08x %s\n" % (zlib.crc32(body), body)
    path.write_bytes(encode(ENTRIES[0]) + line + encode(ENTRIES[1] | {"n": 2}))
    with pytest.raises(JournalDamaged):
        read(path)


JSON = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(allow_nan=False, allow_infinity=False),
        st.text(st.characters(exclude_categories=["Cs"])),
    ),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), inner),
    max_leaves=10,
)


@given(st.dictionaries(st.sampled_from(["text", "row", "x"]), JSON), st.floats(0, 1e9))
def test_any_json_comes_back_to_the_last_bit(fields: dict[str, Any], t_s: float) -> None:
    entry = {"n": 1, "t_s": t_s, "kind": "any", **fields}
    entries, damaged = outcome(encode(ENTRIES[0]) + encode(entry))
    assert not damaged
    assert repr(entries[1]) == repr(entry)


def test_the_log_of_a_rehearsal_holds_the_same_records(tmp_path: Path) -> None:
    log, journal = MemoryLog(), Journal.create(tmp_path / "j", {})
    log.append("journal", 0.0, format=FORMAT)
    for target in (log, journal):
        target.append("note", 1.5, text="x")
        target.commit()
    assert log.entries == read(tmp_path / "j")
