"""Frames to bytes and back: real frames. Damaged streams: test_frames_damage.py."""

import struct
from typing import Any

import crccheck.crc as oracle
import numpy as np
import pytest

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
