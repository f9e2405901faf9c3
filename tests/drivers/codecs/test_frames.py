"""Frames to bytes and back: real frames, and a stream damaged at will against a decoder that reads byte by byte."""

import struct
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
CORRECT_CRC = bytes.fromhex("14DC0D3A")

STIM300_AF: dict[str, Any] = {
    "name": "STIM300 datagram AF",
    "length": 63,
    "header": "AF",
    "fields": [
        {"name": "x", "at": 1, "type": "i24"},
        {"name": "y", "at": 4, "type": "i24"},
        {"name": "z", "at": 7, "type": "i24"},
        {"name": "status", "at": 10, "type": "u8"},
        {"name": "gyro_x_temperature", "at": 31, "type": "i16"},
        {"name": "gyro_y_temperature", "at": 33, "type": "i16"},
        {"name": "counter", "at": 56, "type": "u8"},
        {"name": "latency", "at": 57, "type": "u16"},
    ],
    "checksum": {"kind": "crc32-mpeg2", "over": [0, 59], "at": 59, "pad_to": 4},
    "counter": {"field": "counter"},
    "rate": {"field": "x", "kind": "rate", "unit": "deg", "scale": 2.0**-14},
    "temperature": {"field": "gyro_x_temperature", "scale": 2.0**-8},
    "status": {"field": "status", "good_value": 0},
}
STIM300_DATAGRAM = bytes.fromhex(
    "AF 000124 FFFAD6 00035B 00 FFE7A6 FFDD36 081C52 00 FF7E70 FEBA0C 3FFA1D 00 23A0 23C0 23A0 00 2319 230A 231C 00"
    "2395 23B6 2395 00 FFEF02 00 E1 01FA C64942C6"
)


def kvh(**changes: Any) -> FrameSpec:
    return FrameSpec.load({"base": "kvh_36", **changes})


def test_real_kvh_frames() -> None:
    decoder = StreamDecoder(kvh(), 1000.0)
    batch = decoder.feed(QT1750)
    assert batch.index.tolist() == [0x3D]
    assert batch.columns["rate"].dtype == np.float32
    assert batch.columns["rate"][0] == np.float32(2.0196e-5) or batch.columns["rate"][0] == pytest.approx(
        2.0196e-5, rel=1e-4
    )
    assert batch.columns["rate"].astype(">f4").tobytes() == QT1750[4:8]
    assert batch.rate_dps[0] == pytest.approx(np.degrees(2.0196e-5 * 1000.0), rel=1e-4)
    assert (batch.temperature_degc.tolist(), batch.good.tolist()) == ([40.0], [True])
    batch = decoder.feed(BASIC + EARLY)
    assert batch.columns["status"].tolist() == [0x77, 0x70]
    assert batch.columns["counter"].tolist() == [104, 31]
    assert batch.temperature_degc.tolist() == [29.0, 29.0]
    assert batch.good.tolist() == [True, False]
    assert batch.index.tolist() == [104, 128 + 31]
    assert decoder.losses == Losses(frames=3, lost=42 + 54, bad_status=1)


def test_other_axes_of_the_same_frame() -> None:
    expected = {"x_rotation": 2.0196e-5, "y_rotation": 5.1599e-5, "z_rotation": -1.3111e-5}
    for name, value in expected.items():
        batch = StreamDecoder(kvh(rate={"field": name}), 1.0).feed(QT1750)
        assert batch.columns["rate"][0] == pytest.approx(value, rel=1e-4)


def test_a_bad_frame_is_counted_once_and_leaves_a_hole() -> None:
    decoder = StreamDecoder(kvh(), 1000.0)
    following = encode(kvh(), {"sequence": 0x6A, "status": 0x77}, 1).tobytes()
    batch = decoder.feed(BASIC + BAD_CRC + following)
    assert batch.index.tolist() == [0x68, 0x6A]
    assert decoder.losses == Losses(frames=2, lost=1, bad_checksum=1, skipped_bytes=36)
    assert len(StreamDecoder(kvh(), 1000.0).feed(BAD_CRC[:32] + CORRECT_CRC)) == 1


@pytest.mark.parametrize("frame", [BASIC, EARLY, QT1750, BAD_CRC[:32] + CORRECT_CRC])
def test_encoding_makes_the_real_frames(frame: bytes) -> None:
    spec = kvh()
    single = dict(zip(spec.fields, struct.unpack(">6fBBh", frame[4:32]), strict=True))
    columns = {name: np.array([value] * 3, spec.fields[name].raw_type.dtype) for name, value in single.items()}
    assert encode(spec, columns, 3).tobytes() == frame * 3
    assert encode(spec, single, 2).tobytes() == frame * 2
    assert encode(spec, {**single, "sequence": columns["sequence"]}, 3).tobytes() == frame * 3


def test_the_real_stim300_datagram() -> None:
    """24-bit fields, and a CRC over zero padding that is not sent."""
    spec = FrameSpec.from_mapping(STIM300_AF)
    batch = StreamDecoder(spec, 1000.0).feed(STIM300_DATAGRAM)
    assert batch.rate_dps == pytest.approx([0.017822], abs=1e-6)
    assert (batch.temperature_degc.tolist(), batch.index.tolist()) == ([35.625], [225])
    spec = FrameSpec.from_mapping({**STIM300_AF, "rate": {**STIM300_AF["rate"], "field": "y"}})
    assert StreamDecoder(spec, 1000.0).feed(STIM300_DATAGRAM).rate_dps == pytest.approx([-0.080688], abs=1e-6)
    zeros = encode(FrameSpec.from_mapping(STIM300_AF), {}, 2)
    assert zeros.tobytes() == (b"\xaf" + bytes(58) + bytes.fromhex("FDFEE62C")) * 2


def test_the_packaged_stim300_frame_with_and_without_cr_lf() -> None:
    spec = FrameSpec.load("stim300_rate_temperature")
    body = struct.pack(
        ">B3s3s3sB3hBBH", 0x94, b"\x02\x80\x00", b"\xfd\x80\x00", b"\x00\x00\x01", 0, 6528, 6400, 6400, 0, 200, 506
    )
    frame = body + oracle.Crc32Mpeg2.calcbytes(body + bytes(3))
    batch = StreamDecoder(spec, 1000.0).feed(frame * 2)
    assert (batch.rate_dps.tolist(), batch.temperature_degc.tolist()) == ([10.0], [25.5])
    crlf = FrameSpec.load({"base": "stim300_rate_temperature", "length": 27, "trailer": "0D 0A"})
    assert len(StreamDecoder(crlf, 1000.0).feed(frame + b"\r\n")) == 1
    columns = {"counter": 200, "latency": 506, "x_rate": 0x28000, "y_rate": -0x28000, "z_rate": 1}
    columns |= {"x_temperature": 6528, "y_temperature": 6400, "z_temperature": 6400}
    assert encode(crlf, columns, 1).tobytes() == frame + b"\r\n"
    for part in (frame, frame[:-1] + bytes([frame[-1] ^ 1])):
        assert len(StreamDecoder(crlf, 1000.0).feed(part + b"\r\r" + bytes(30))) == 0


def test_the_example_frame() -> None:
    spec = FrameSpec.load("example_eb90")
    body = struct.pack("<2sihhh4xBB", b"\xeb\x90", -12_345_678, 2512, -1, 7, 1, 9)
    frame = body + bytes([sum(body) % 255])
    batch = StreamDecoder(spec, 100.0).feed(frame)
    assert batch.rate_dps == pytest.approx([-12.345678], rel=1e-12)
    assert (batch.temperature_degc.tolist(), batch.index.tolist(), batch.good.tolist()) == ([25.12], [9], [True])
    columns = {
        "rate": -12_345_678,
        "coil_temperature": 2512,
        "source_temperature": -1,
        "board_temperature": 7,
        "status": 1,
        "counter": 9,
    }
    assert encode(spec, columns, 1).tobytes() == frame


def test_values_that_do_not_fit_are_refused() -> None:
    spec = kvh()
    with pytest.raises(
        ValueError, match=r"field temperature: int64 values -5 to 40000 do not fit in i16 \(-32768 to 32767\)"
    ):
        encode(spec, {"temperature": np.array([-5, 40_000])}, 2)
    with pytest.raises(ValueError, match="field sequence"):
        encode(spec, {"sequence": 256}, 1)
    with pytest.raises(ValueError, match="field status: float64"):
        encode(spec, {"status": np.array([0.5])}, 1)
    stim = FrameSpec.from_mapping(STIM300_AF)
    with pytest.raises(ValueError, match="field x: int32"):
        encode(stim, {"x": np.array([1 << 23], np.int32)}, 1)
    assert encode(stim, {"x": np.array([-(1 << 23)], np.int32)}, 1)[0, 1:4].tolist() == [0x80, 0, 0]


def test_no_frames() -> None:
    assert encode(kvh(), {"x_rotation": np.empty(0, np.float32)}, 0).shape == (0, 36)
    batch = StreamDecoder(kvh(), 1.0).feed(b"")
    assert len(batch) == 0
    assert {name: column.dtype.str for name, column in batch.columns.items()} == {
        "rate": "<f4", "temperature": "<i2", "counter": "|u1", "status": "|u1",
    }  # fmt: skip


# --- damage -----------------------------------------------------------------------------------------------------------

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
