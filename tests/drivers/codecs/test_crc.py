"""Checksums against the published check values, crccheck, and real frames; batches against single messages."""

import crccheck.crc as oracle
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.codecs.crc import CHECKSUMS, CRCS, Crc, varying_columns

CHECK = b"123456789"
ORACLES = {
    "crc32-mpeg2": oracle.Crc32Mpeg2,
    "crc16-modbus": oracle.Crc16Modbus,
    "crc16-ccitt": oracle.Crc16CcittFalse,
    "crc8": oracle.Crc8Smbus,
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("crc32-mpeg2", 0x0376E6E7),
        ("crc16-modbus", 0x4B37),
        ("crc16-ccitt", 0x29B1),
        ("crc8", 0xF4),
        ("crc8-ff", 0xFB),
        ("sum8", sum(CHECK) % 256),
        ("sum16", sum(CHECK)),
        ("sum16-words", sum(int.from_bytes(CHECK[at : at + 2], "little") for at in range(0, 9, 2)) % 65536),
        ("sum-mod-255", sum(CHECK) % 255),
        ("xor8", 0x31),
        ("none", 0),
    ],
)
def test_check_value_of_the_catalogue(name: str, value: int) -> None:
    assert CHECKSUMS[name].of(CHECK) == value


@pytest.mark.parametrize("name", ORACLES)
@given(data=st.binary(max_size=70))
def test_agrees_with_crccheck(name: str, data: bytes) -> None:
    assert CRCS[name].of(data) == ORACLES[name].calc(data)


@given(
    width=st.sampled_from([8, 16, 24, 32]),
    data=st.binary(max_size=40),
    reflected=st.booleans(),
    parameters=st.tuples(*[st.integers(0, 2**32 - 1)] * 3),
)
def test_own_parameters_agree_with_crccheck(
    width: int, data: bytes, reflected: bool, parameters: tuple[int, int, int]
) -> None:
    polynomial, start, final = (value % 2**width for value in parameters)
    expected = oracle.Crc(width, polynomial | 1, start, reflected, reflected, final)
    expected.process(data)
    assert Crc(width, polynomial | 1, start, reflected, final).of(data) == expected.final()


def test_impossible_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="allowed are 8, 16, 24 and 32"):
        Crc(12, 0x80F)
    with pytest.raises(ValueError, match="polynomial 0x11021 does not fit in 16 bits"):
        Crc(16, 0x11021)


@pytest.mark.parametrize(
    ("frame", "good"),
    [
        ("FE81FF55B3D0BBE732193EF430AC19A5BA8F78D63A2905943F7ECBD47768001DADC5F651", True),
        ("FE81FF553B041F78B9B96613BA234B38BB7C0410B8DEF4803F7F4B7B701F001DF12FB6EE", True),
        ("FE81FF5537A96A6E38586C1FB75BF862BF803E78BB650D283B0A37AC773D00284BFA34D8", True),
        ("FE81FF55B46B86C6B44F5B83B4106D09BB713CB7BBABD9143F7E319A7769001D95BBDB4F", False),
    ],
)
def test_real_kvh_frames_leave_zero_when_the_crc_is_included(frame: str, good: bool) -> None:
    assert (CRCS["crc32-mpeg2"].of(bytes.fromhex(frame)) == 0) is good


@pytest.mark.parametrize(
    "frame",
    [
        "900000000000000000000099",
        "90028000FD800000000100" + "79",
        "A8028000FD80000000010019801980" + "1980C801FAC9",
    ],
)
def test_stim210_frames(frame: str) -> None:
    data = bytes.fromhex(frame)
    assert CRCS["crc8-ff"].of(data[:-1]) == data[-1]


@settings(max_examples=60)
@given(data=st.data(), name=st.sampled_from(sorted(CHECKSUMS)))
def test_rows_are_the_same_as_single_messages(data: st.DataObject, name: str) -> None:
    count = data.draw(st.integers(0, 6), "rows")
    length = data.draw(st.integers(1, 41), "length")
    padding = data.draw(st.integers(0, 3), "padding") if not name.startswith("sum16") else 0
    seed = data.draw(st.integers(0, 2**32 - 1), "seed")
    generator = np.random.default_rng(seed)
    rows = generator.integers(0, 256, (count, length + 3), dtype=np.uint8)
    constant = generator.random(length) < 0.6
    rows[:, :length][:, constant] = rows[:1, :length][:, constant]
    part = rows[:, :length]
    expected = [CHECKSUMS[name].of(row.tobytes() + bytes(padding)) for row in part]
    assert CHECKSUMS[name].of_rows(part, None, padding).tolist() == expected
    assert CHECKSUMS[name].of_rows(part, np.flatnonzero(~constant).tolist(), padding).tolist() == expected
    assert CHECKSUMS[name].of_rows(part, range(length), padding).tolist() == expected


def test_padding_stim300() -> None:
    """Datagram AF + 58 zero bytes, padded by one: FDFEE62C; 90 + 13 zero bytes, padded by two: 2E5DFC73 (notes, 4)."""
    crc = CRCS["crc32-mpeg2"]
    for first, zeros, padding, expected in ((0xAF, 58, 1, 0xFDFEE62C), (0x90, 13, 2, 0x2E5DFC73)):
        rows = np.zeros((3, 1 + zeros), np.uint8)
        rows[:, 0] = first
        assert crc.of_rows(rows, None, padding).tolist() == [expected] * 3


@given(st.integers(0, 300), st.integers(1, 20), st.integers(0, 2**32 - 1))
def test_varying_columns(count: int, length: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    rows = np.repeat(generator.integers(0, 256, (1, length), dtype=np.uint8), count, axis=0)
    for _ in range(generator.integers(0, 4)):
        if count:
            rows[generator.integers(count), generator.integers(length)] ^= 1 << generator.integers(8)
    expected = [at for at in range(length) if len(set(rows[:, at].tolist())) > 1]
    assert varying_columns(rows) == expected
