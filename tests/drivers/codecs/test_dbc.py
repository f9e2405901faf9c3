"""DBC files against cantools: every kind of signal, in both byte orders, read and written."""

import struct
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.codecs.batch import Quantity
from drivers.codecs.dbc import EXTENDED, encode_messages, parse_dbc
from drivers.codecs.declared import FrameSpecError

# Bosch MM7.10 (message 174) and SBG ECAN (message 122), from the tables of the protocol notes.
BOSCH = """
BO_ 372 YawRate: 8 Sensor
 SG_ yaw_rate : 0|16@1+ (0.005,-163.84) [-163.84|163.83] "deg/s" Bench
 SG_ yaw_status : 20|4@1+ (1,0) [0|15] "" Bench
 SG_ temperature : 24|8@1+ (1,-50) [-50|205] "degC" Bench
 SG_ lateral : 32|16@1+ (0.000127465,-4.1768) [-4.1768|4.1768] "g" Bench
 SG_ counter : 48|4@1+ (1,0) [0|15] "" Bench
 SG_ lateral_status : 52|4@1+ (1,0) [0|15] "" Bench
 SG_ crc : 56|8@1+ (1,0) [0|255] "" Bench
"""
SBG = """
BO_ 290 Gyro: 6 Sensor
 SG_ x : 0|16@1- (0.001,0) [-32.768|32.767] "rad/s" Bench
 SG_ y : 16|16@1- (0.001,0) [-32.768|32.767] "rad/s" Bench
 SG_ z : 32|16@1- (0.001,0) [-32.768|32.767] "rad/s" Bench
"""
# Racelogic IMU03: two big-endian float32 in one message.
RACELOGIC = """
BO_ 1536 Imu: 8 Sensor
 SG_ yaw_rate : 7|32@0- (1,0) [0|0] "deg/s" Bench
 SG_ x_acceleration : 39|32@0- (1,0) [0|0] "g" Bench
SIG_VALTYPE_ 1536 yaw_rate : 1;
SIG_VALTYPE_ 1536 x_acceleration : 1 ;
"""


def payload(text: str) -> Any:
    return np.frombuffer(bytes.fromhex(text).ljust(8, b"\0"), np.uint8).reshape(1, 8)


def value(signal: Any, data: Any) -> float:
    return float(signal.read(data)[0] * signal.scale + signal.offset)


def test_bytes_of_the_protocol_notes() -> None:
    bosch = parse_dbc(BOSCH)["YawRate"]
    assert value(bosch.signals["yaw_rate"], payload("0080")) == pytest.approx(0.0, abs=1e-9)
    assert value(bosch.signals["yaw_rate"], payload("D087")) == pytest.approx(10.0, abs=1e-9)
    sbg = parse_dbc(SBG)["Gyro"]
    data = payload("640038FFDC05")
    assert [value(signal, data) for signal in sbg.signals.values()] == pytest.approx([0.1, -0.2, 1.5])
    columns = {"x": np.array([100]), "y": np.array([-200]), "z": np.array([1500])}
    assert encode_messages(sbg, columns, 1).tobytes().hex() == "640038ffdc050000"
    floats = parse_dbc(RACELOGIC)["Imu"].signals
    data = payload(struct.pack(">ff", -12.5, 0.75).hex())
    assert [value(signal, data) for signal in floats.values()] == [-12.5, 0.75]


def motorola_start(top: int) -> int:
    """DBC's number of the bit that is `top` bits behind the most significant one of byte 0."""
    return 8 * (top // 8) + 7 - top % 8


@st.composite
def signals(draw: st.DrawFn) -> tuple[str, bool]:
    """One signal in DBC text, and whether it is a float."""
    is_float = draw(st.booleans()) and draw(st.booleans())
    length = draw(st.sampled_from([32, 64])) if is_float else draw(st.integers(1, 64) | st.sampled_from([8, 16, 32]))
    place = draw(st.integers(0, 64 - length) | st.integers(0, (64 - length) // 8).map(lambda byte: 8 * byte))
    big = draw(st.booleans())
    start = motorola_start(place) if big else place
    sign = draw(st.sampled_from("+-"))
    scale = draw(st.sampled_from(["1", "0.5", "-0.01", "1e-05", "0.000127465"]))
    offset = draw(st.sampled_from(["0", "-40", "163.84"]))
    return f'SG_ s : {start}|{length}@{0 if big else 1}{sign} ({scale},{offset}) [0|0] "u" X', is_float


@settings(max_examples=300, deadline=None)
@given(signals(), st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=4))
def test_reads_and_writes_as_cantools_does(signal: tuple[str, bool], frames: list[bytes]) -> None:
    line, is_float = signal
    text = f'VERSION ""\n\nBU_: X\n\nBO_ 100 M: 8 X\n {line}\n'
    if is_float:
        text += f"\nSIG_VALTYPE_ 100 s : {2 if '|64@' in line else 1};\n"
    oracle = cantools.database.load_string(text, "dbc").get_message_by_name("M")
    message = parse_dbc(text)["M"]
    ours = message.signals["s"]
    assert (ours.unit, ours.scale, ours.offset) == ("u", oracle.signals[0].scale, oracle.signals[0].offset)
    raw = ours.read(np.frombuffer(b"".join(frames), np.uint8).reshape(-1, 8))
    expected = [oracle.decode(frame, scaling=False)["s"] for frame in frames]
    assert np.array_equal(raw, np.array(expected, raw.dtype), equal_nan=is_float)
    scaled = [float(oracle.decode(frame)["s"]) for frame in frames]
    values = Quantity(ours.scale, ours.offset).value(raw)
    assert np.allclose(values, scaled, rtol=1e-12, atol=1e-9, equal_nan=True)
    written = encode_messages(message, {"s": raw}, len(frames))
    if not np.isnan(raw).any():
        assert [row.tobytes() for row in written] == [
            oracle.encode({"s": count}, scaling=False) for count in raw.tolist()
        ]


def test_a_whole_message_as_cantools_does() -> None:
    text = f'VERSION ""\n\nBU_: Sensor Bench\n{BOSCH}'
    oracle = cantools.database.load_string(text, "dbc").get_message_by_name("YawRate")
    message = parse_dbc(text)["YawRate"]
    generator = np.random.default_rng(3)
    columns: dict[str, Any] = {
        name: generator.integers(0, 1 << signal.length, 50).astype(signal.raw_type.dtype)
        for name, signal in message.signals.items()
        if name != "crc"
    }
    columns["crc"] = 0x5A
    written = encode_messages(message, columns, 50)
    for row in range(50):
        counts = {name: int(np.broadcast_to(column, 50)[row]) for name, column in columns.items()}
        assert written[row].tobytes() == oracle.encode(counts, scaling=False)


def test_the_rest_of_a_dbc_is_passed_over() -> None:
    text = """VERSION "1"
NS_ :
    CM_
    BA_DEF_
BS_:
BU_: Gyro
VAL_TABLE_ On 1 "on" 0 "off" ;
BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX
BO_ 2364549760 Extended: 8 Gyro
 SG_ page M : 0|4@1+ (1,0) [0|0] "" Vector__XXX
 SG_ first m0 : 8|8@1+ (1,0) [0|0] "" Vector__XXX
\tSG_ rate : 16|16@1- (0.005,0) [-160|160] "\xb0/s"  Bench,Other
CM_ "
BO_ this is a comment
 SG_ and so is this";
CM_ SG_ 2364549760 rate "with \\" a quote";
BA_DEF_ SG_ "x" INT 0 10;
VAL_ 2364549760 page 0 "a" 1 "b" ;
"""
    messages = parse_dbc(text)
    message = messages["Extended"]
    assert message.can_id == 0x0CF02A80 | EXTENDED
    assert {name: signal.multiplexed for name, signal in message.signals.items()} == {
        "page": False, "first": True, "rate": False,
    }  # fmt: skip
    assert (message.signals["rate"].unit, message.signals["rate"].scale) == ("\xb0/s", 0.005)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no message"),
        ("{}", "is it a DBC file"),
        ("BO_ 1 M 8 X", r"line 1: 'BO_ 1 M 8 X' is not of the form BO_ <id>"),
        ("BO_ 1 M: 8 X\n SG_ s : 0-8@1+ (1,0)", r"line 2: 'SG_ s : 0-8@1\+ \(1,0\)' is not of the form SG_ <name>"),
        ('SG_ s : 0|8@1+ (1,0) [0|0] "" X', "line 1: signal s stands before any message"),
        ('BO_ 1 M: 8 X\n SG_ s : 0|65@1+ (1,0) [0|0] "" X', "line 2: signal s has 65 bits; allowed are 1 to 64"),
        ('BO_ 1 M: 8 X\n SG_ s : 0|8@1+ (0,0) [0|0] "" X', "line 2: signal s: factor 0"),
        ('BO_ 1 M: 8 X\n SG_ s : 0|16@1+ (1,0) [0|0] "" X\nSIG_VALTYPE_ 1 s : 1;', "M.s: a float of 16 bits"),
    ],
)
def test_mistakes(text: str, message: str) -> None:
    with pytest.raises(FrameSpecError, match=message):
        parse_dbc(text)
