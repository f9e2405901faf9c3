"""A stream damaged at will, against a decoder that reads byte by byte; garbage, outages, pieces of any size."""

from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import crccheck.crc as oracle
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.codecs import frames
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses
from drivers.codecs.frame_spec import FrameSpec
from drivers.codecs.frames import StreamDecoder, encode

# Real frames, public test vectors of the protocol notes: X, Y, Z, status, sequence, degC, good.
BASIC = bytes.fromhex("FE81FF55 B3D0BBE7 32193EF4 30AC19A5 BA8F78D6 3A290594 3F7ECBD4 77 68 001D ADC5F651")
EARLY = bytes.fromhex("FE81FF55 3B041F78 B9B96613 BA234B38 BB7C0410 B8DEF480 3F7F4B7B 70 1F 001D F12FB6EE")
QT1750 = bytes.fromhex("FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 77 3D 0028 4BFA34D8")
BAD_CRC = bytes.fromhex("FE81FF55 B46B86C6 B44F5B83 B4106D09 BB713CB7 BBABD914 3F7E319A 77 69 001D 95BBDB4F")


def kvh(**changes: Any) -> FrameSpec:
    return FrameSpec.load({"base": "kvh_36", **changes})


SMALL: dict[str, dict[str, Any]] = {
    "kvh": {"base": "kvh_36"},
    # a header of one byte that payloads are full of, and a counter that wraps soon
    "short header": {
        "name": "short header", "length": 9, "header": "A0",
        "fields": [{"name": "rate", "at": 1, "type": "i16"}, {"name": "counter", "at": 3, "type": "u8"},
                   {"name": "status", "at": 4, "type": "u8"}],
        "checksum": {"kind": "crc32-mpeg2", "over": [0, 5], "at": 5},
        "counter": {"field": "counter", "modulo": 4},
        "rate": {"field": "rate", "kind": "rate", "unit": "deg"},
        "status": {"field": "status", "good_value": 1},
    },
    # a checksum so weak that wrong frames are taken for right ones, which then stand in the way of right ones
    "weak sum": {
        "name": "weak sum", "length": 6, "header": "A0", "byte_order": "little",
        "fields": [{"name": "rate", "at": 1, "type": "i16"}, {"name": "counter", "at": 3, "type": "u8"}],
        "checksum": {"kind": "sum-mod-255", "over": [0, 4], "at": 4}, "trailer": "A0",
        "counter": {"field": "counter", "modulo": 256},
        "rate": {"field": "rate", "kind": "rate", "unit": "deg"},
    },
}  # fmt: skip


@dataclass
class SlowDecoder:
    """The rule of `drivers.codecs.frames`, applied byte by byte to a finished stream."""

    spec: FrameSpec
    counters: list[int] = field(default_factory=list)
    kept: list[bytes] = field(default_factory=list)
    losses: dict[str, int] = field(default_factory=lambda: dict.fromkeys(Losses.__annotations__, 0))

    def valid(self, frame: bytes) -> bool:
        if not frame.startswith(self.spec.header) or not frame.endswith(self.spec.trailer):
            return False
        if self.spec.name == "weak sum":
            return sum(frame[:4]) % 255 == frame[4]
        return oracle.Crc32Mpeg2.calc(frame[:-4]) == int.from_bytes(frame[-4:], "big")

    def decode(self, data: bytes) -> None:
        at, end, bad_until, joining = 0, 0, 0, True
        length = self.spec.length
        while at + length <= len(data):
            frame = data[at : at + length]
            if self.valid(frame):
                gap = at - end
                if joining:
                    gap -= gap % length
                self.losses["skipped_bytes"] += gap
                self.losses["resyncs"] += gap % length != 0
                self.accept(frame)
                joining = False
                at = end = at + length
            else:
                if frame.startswith(self.spec.header) and at >= bad_until:
                    self.losses["bad_checksum"] += 1
                    bad_until = at + length
                at += 1
        gap = at - end
        self.losses["skipped_bytes"] += gap - gap % length if joining else gap

    def accept(self, frame: bytes) -> None:
        assert self.spec.counter is not None
        at, modulo = self.spec.counter.field.at, self.spec.counter.modulo
        if self.kept and frame == self.kept[-1]:
            self.losses["duplicates"] += 1
            return
        index = frame[at] if not self.kept else self.counters[-1] + ((frame[at] - self.counters[-1] - 1) % modulo + 1)
        self.losses["lost"] += index - self.counters[-1] - 1 if self.kept else 0
        self.losses["frames"] += 1
        self.counters.append(index)
        self.kept.append(frame)
        if self.spec.status is not None:
            wrong = (frame[self.spec.status.at] ^ self.spec.good_value) & self.spec.good_mask
            self.losses["bad_status"] += wrong != 0


@st.composite
def damaged(draw: st.DrawFn) -> tuple[FrameSpec, bytes]:
    spec = FrameSpec.load(SMALL[draw(st.sampled_from(sorted(SMALL)), "frame")])
    assert spec.counter is not None
    count, first = draw(st.integers(0, 40), "frames"), draw(st.integers(0, 1000), "first")
    numbers = np.arange(first, first + count)
    generator = np.random.default_rng(draw(st.integers(0, 99), "seed"))
    rate: Any = generator.choice([0x00, 0x01, -0x6000, 0x0AA0], count).astype(spec.rate.raw_type.dtype)
    columns: dict[str, Any] = {spec.rate.name: rate, spec.counter.field.name: numbers % spec.counter.modulo}
    if spec.status is not None:
        columns[spec.status.name] = generator.choice([spec.good_value, 0], count, p=[0.8, 0.2]).astype(np.uint8)
    parts = [row.tobytes() for row in encode(spec, columns, count)]
    for at in draw(st.lists(st.integers(0, 40), max_size=3), "repeated"):
        parts[at : at + 1] = parts[at : at + 1] * 2
    for at, several in draw(st.lists(st.tuples(st.integers(0, 40), st.integers(1, 3)), max_size=2), "lost"):
        del parts[at : at + several]
    data = bytearray(b"".join(parts))
    pieces = st.binary(max_size=12) | st.sampled_from([spec.header, spec.header * 3, spec.header[:1], bytes(40)])
    for kind, where, piece in draw(
        st.lists(st.tuples(st.sampled_from(["flip", "drop", "insert", "cut"]), st.floats(0, 1), pieces), max_size=6),
        "damage",
    ):
        at = int(where * len(data))
        if kind == "flip" and at < len(data):
            data[at] ^= 1 << len(piece) % 8
        elif kind == "drop":
            del data[at : at + len(piece)]
        elif kind == "insert":
            data[at:at] = piece
        elif kind == "cut" and where < 0.2:
            del data[:at]
    return spec, bytes(data)


def compare(spec: FrameSpec, batches: list[FrameBatch], losses: Losses, data: bytes) -> None:
    slow = SlowDecoder(spec)
    slow.decode(data)
    assert losses == Losses(**slow.losses)
    batch = FrameBatch.concat(batches)
    assert batch.index.tolist() == slow.counters
    order = ">" if spec.rate.byte_order == "big" else "<"
    rate = b"".join(frame[spec.rate.at : spec.rate.at + spec.rate.size] for frame in slow.kept)
    assert batch.columns["rate"].astype(batch.columns["rate"].dtype.newbyteorder(order)).tobytes() == rate


@settings(max_examples=250, deadline=None)
@given(damaged(), st.lists(st.floats(0, 1), max_size=6), st.booleans())
def test_damage_of_every_kind_in_pieces_of_any_size(
    stream: tuple[FrameSpec, bytes], cuts: list[float], small_windows: bool
) -> None:
    spec, data = stream
    places = sorted(int(cut * len(data)) for cut in cuts)
    decoder = StreamDecoder(spec, 100.0)
    windows = {"_WINDOW_BYTES": 1, "_CANDIDATES": 2} if small_windows else {}
    with patch.multiple(frames, **windows) if windows else patch.multiple(frames, _CANDIDATES=frames._CANDIDATES):
        pieces = [data[a:b] for a, b in zip([0, *places], [*places, len(data)], strict=True)]
        batches = [decoder.feed(piece) for piece in pieces]
    compare(spec, batches, decoder.losses, data)
    assert decoder.pending < spec.length


def test_byte_by_byte() -> None:
    data = QT1750[5:] + BASIC + b"\xfe\x81\xff" + EARLY[:20] + BAD_CRC + EARLY + EARLY
    decoder = StreamDecoder(kvh(), 1.0)
    batches = [decoder.feed(data[at : at + 1]) for at in range(len(data))]
    compare(kvh(), batches, decoder.losses, data)
    assert decoder.losses == Losses(
        frames=2, lost=54, duplicates=1, bad_checksum=1, skipped_bytes=59, resyncs=1, bad_status=1
    )


def test_nothing_valid_is_lost_to_a_header_before_it_or_inside_it() -> None:
    header = QT1750[:4]
    with_header_inside = encode(
        kvh(), {"x_rotation": np.frombuffer(header, ">f4").astype("f4"), "sequence": 5}, 1
    ).tobytes()
    assert with_header_inside.count(header) == 2
    data = header + b"\x00" * 10 + header + with_header_inside + header[:3] + QT1750
    decoder = StreamDecoder(kvh(), 1.0)
    assert decoder.feed(data).columns["counter"].tolist() == [5, 0x3D]
    # the second header overlaps the first, so it is the same damage
    assert (decoder.losses.bad_checksum, decoder.losses.resyncs) == (1, 1)


def test_every_frame_bad_is_counted_as_such() -> None:
    """What a wrong checksum in the declaration looks like. The last one may still hide a good one."""
    decoder = StreamDecoder(kvh(checksum={"kind": "crc", "width": 32, "polynomial": 0x04C11DB7}), 1.0)
    assert len(decoder.feed(BASIC * 1000)) == 0
    assert decoder.losses == Losses(bad_checksum=1000, skipped_bytes=36 * 999)


@pytest.mark.parametrize("name", ["kvh", "short header", "weak sum"])
@pytest.mark.parametrize("garbage", ["random", "header bytes", "zeros"])
def test_garbage_does_no_harm_and_is_not_kept(name: str, garbage: str) -> None:
    spec = FrameSpec.load(SMALL[name])
    data = {
        "random": np.random.default_rng(1).integers(0, 256, 300_000, dtype=np.uint8).tobytes(),
        "header bytes": spec.header[:1] * 300_000,
        "zeros": bytes(300_000),
    }[garbage]
    decoder = StreamDecoder(spec, 100.0)
    batch = decoder.feed(data)
    assert decoder.pending < spec.length
    settled = len(data) - decoder.pending
    taken = len(batch) + decoder.losses.duplicates
    assert settled - taken * spec.length - decoder.losses.skipped_bytes in range(spec.length)
    if name != "weak sum":
        assert taken == 0
        # and the stream is found again
        following = encode(spec, {spec.columns["counter"].name: np.arange(3)}, 3)
        assert decoder.feed(following.tobytes()).columns["counter"].tolist() == [0, 1, 2]


def test_a_long_piece_with_damage_in_every_window() -> None:
    spec = kvh()
    count = 30_000
    numbers = np.arange(count)
    rows = encode(spec, {"x_rotation": numbers.astype(np.float32), "sequence": numbers % 128}, count)
    data = bytearray(rows.tobytes())
    dropped = list(range(5_000, count, 9_000))
    for number in reversed(dropped):
        del data[36 * number + 7]
    decoder = StreamDecoder(spec, 100.0)
    batch = decoder.feed(bytes(data))
    assert batch.columns["rate"].tolist() == [float(number) for number in range(count) if number not in dropped]
    assert batch.index.tolist() == batch.columns["rate"].astype(int).tolist()
    assert decoder.losses.lost == decoder.losses.bad_checksum == decoder.losses.resyncs == len(dropped)


def test_reset_forgets_the_unfinished_frame_and_counts_no_loss() -> None:
    spec = kvh()
    rows = encode(spec, {"sequence": np.arange(20) % 128}, 20).tobytes()
    decoder = StreamDecoder(spec, 100.0)
    assert len(decoder.feed(rows[: 36 * 5 + 10])) == 5
    decoder.reset()
    assert decoder.pending == 0
    batch = decoder.feed(rows[36 * 9 + 20 :], elapsed_s=0.1)
    assert batch.index.tolist() == list(range(10, 20))
    assert decoder.losses == Losses(frames=15, bad_status=15)


def test_an_outage_longer_than_the_counter_is_resolved_by_time() -> None:
    spec = kvh()
    numbers = np.r_[0:300, 1000:1100]
    rows = encode(spec, {"sequence": numbers % 128}, 400).tobytes()
    decoder = StreamDecoder(spec, 100.0)
    decoder.feed(rows[: 36 * 100], elapsed_s=1.0)
    assert decoder.feed(rows[36 * 100 :], elapsed_s=10.0).index.tolist() == numbers[100:].tolist()
    assert decoder.losses.lost == 700


def test_a_frame_without_checksum_and_counter() -> None:
    declaration = {**SMALL["weak sum"], "checksum": {"kind": "none"}, "trailer": None, "counter": None}
    del declaration["trailer"], declaration["counter"]
    spec = FrameSpec.from_mapping(
        {**declaration, "header": "A0 0A"[:5], "fields": [{"name": "rate", "at": 2, "type": "i16"}]}
    )
    rows = encode(spec, {"rate": np.arange(100, 110, dtype=np.int16)}, 10).tobytes()
    decoder = StreamDecoder(spec, 1.0)
    batch = decoder.feed(rows[:30] + b"\x01\x02\x03" + rows[30:])
    assert batch.columns.keys() == {"rate"}
    assert batch.index.tolist() == list(range(10))
    assert batch.good.all() and np.isnan(batch.temperature_degc).all()
    assert decoder.losses == Losses(frames=10, skipped_bytes=3, resyncs=1)
