"""What instruments and wires may send: any bytes, in any pieces, give messages or the documented error."""

import random
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from drivers.codecs.acl import AclError, AnswerParser, LineParser, decode_commands
from drivers.codecs.can_frames import CanDecoder
from drivers.codecs.can_spec import CanSpec
from drivers.codecs.frame_spec import FrameSpec
from drivers.codecs.frames import StreamDecoder, encode
from drivers.codecs.modbus_rtu import (
    MAX_FRAME,
    FrameParser,
    ModbusError,
    Read,
    Registers,
    WriteMany,
    Written,
    decode_reply,
    decode_request,
    encode_reply,
    encode_request,
    reply_length,
    request_length,
)
from tests.fuzz.fuzzing import EXAMPLES, broken, fuzz, memory_below

FRAMES = ("kvh_36", "example_eb90", "stim300_rate_temperature")
MODBUS = (
    encode_request(Read(1, 100)) + encode_request(WriteMany(1, 300, (250,))),
    encode_reply(Registers(1, (25, 65511))) + encode_reply(Written(1, 6, 300, 250)),
)
ACL = (
    b":DEM:RATE 1,10.5\n:MOD? 1\n*IDN?\n:DEM:POS? 1;:SENS:RATE? 1\r\n",
    b"OK\r\n12.5;3.0\r\n\x00\x00\x00\x07\x00\x00\x00\x0612.50\n",
)


def pieces(data: bytes, seed: int) -> list[bytes]:
    """The same bytes as they may come in: in blocks of any size."""
    rng = random.Random(seed)
    cuts = sorted(rng.randrange(len(data) + 1) for _ in range(rng.randrange(5)))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


PIECES = st.integers(0, 2**32)


def stream(name: str, count: int = 40) -> bytes:
    spec = FrameSpec.load(name)
    counter = {spec.counter.field.name: np.arange(count) % spec.counter.modulo} if spec.counter else {}
    return bytes(encode(spec, counter, count).tobytes())


@EXAMPLES
@pytest.mark.parametrize("name", FRAMES)
def test_frames(name: str, examples: int) -> None:
    spec = FrameSpec.load(name)

    def parse(given: tuple[bytes, int, float | None]) -> None:
        data, seed, elapsed_s = given
        decoder = StreamDecoder(spec, 100.0)
        batches = [decoder.feed(piece, elapsed_s) for piece in pieces(data, seed)]
        frames = sum(map(len, batches))
        assert frames * spec.length <= len(data)
        assert decoder.losses.frames == frames
        assert min(vars(decoder.losses).values()) >= 0
        assert decoder.pending < spec.length
        index = np.concatenate([batch.index for batch in batches])
        assert (np.diff(index) > 0).all()

    elapsed = st.none() | st.floats(0, 1e6)
    fuzz(st.tuples(broken(*map(stream, FRAMES)), PIECES, elapsed), parse, examples)


@EXAMPLES
def test_can_messages(examples: int) -> None:
    spec = CanSpec.from_settings({"dbc": "fog_gyro"})

    def parse(given: tuple[int, int, float | None]) -> None:
        seed, count, elapsed_s = given
        rng = np.random.default_rng(seed)
        decoder = CanDecoder(spec, 100.0)
        for _ in range(3):
            ids = rng.choice(np.array([spec.can_id, spec.can_id | 1 << 31, 0, 2**32 - 1], np.uint32), count)
            lengths = rng.integers(0, 256, count).astype(np.uint8)
            payload = rng.integers(0, 256, (count, 8)).astype(np.uint8)
            with np.errstate(invalid="ignore"):  # a signalling not-a-number
                batch = decoder.feed(ids, payload, lengths, elapsed_s)
            assert (np.diff(batch.index) > 0).all()
            assert len(batch.rate_dps) == len(batch)
        assert min(vars(decoder.losses).values()) >= 0

    fuzz(st.tuples(PIECES, st.integers(0, 50), st.none() | st.floats(0, 1e6)), parse, examples)


@EXAMPLES
def test_modbus(examples: int) -> None:
    def parse(given: tuple[bytes, int]) -> None:
        data, seed = given
        for length_of, decode in ((request_length, decode_request), (reply_length, decode_reply)):
            parser = FrameParser(length_of)
            for frame in [frame for piece in pieces(data, seed) for frame in parser.feed(piece)] + [data]:
                try:
                    decode(frame)
                except ModbusError as error:
                    assert len(str(error)) < 1000
            assert len(parser._rest) <= MAX_FRAME

    fuzz(st.tuples(broken(*MODBUS), PIECES), parse, examples)


@EXAMPLES
def test_acl(examples: int) -> None:
    def parse(given: tuple[bytes, int]) -> None:
        data, seed = given
        answers, lines = AnswerParser(), LineParser()
        for piece in pieces(data, seed):
            try:
                answers.feed(piece)
            except AclError as error:
                assert len(str(error)) < 1000
            for line in lines.feed(piece):
                try:
                    decode_commands(line)
                except AclError as error:
                    assert len(str(error)) < 1000

    fuzz(st.tuples(broken(*ACL), PIECES), parse, examples)


FLOOD = 1 << 14


@pytest.mark.parametrize("name", FRAMES)
@pytest.mark.parametrize("kind", ["header", "zeros", "random", "frames"])
def test_a_flood_of_bytes_takes_memory_in_proportion(name: str, kind: str) -> None:
    spec = FrameSpec.load(name)
    header = spec.header or b"\x00"
    flood = {
        "header": header * (16 * FLOOD // len(header)),
        "zeros": bytes(16 * FLOOD),
        "random": np.random.default_rng(1).bytes(16 * FLOOD),
        "frames": stream(name, 16 * FLOOD // spec.length),
    }[kind]
    decoder = StreamDecoder(spec, 100.0)
    decoder.feed(flood[:1000])
    with memory_below(8 + 24 * len(flood) / 2**20):
        for _ in range(2):
            decoder.feed(flood)
    assert decoder.pending < spec.length


@pytest.mark.parametrize("seed", [b"\x01\x03\xff\x00", b"\x01\x03\x00", b"\x01\x06", b"\x01\x83", b"\xff", b"\x01\x2b"])
def test_a_modbus_line_that_talks_without_end_is_not_kept(seed: bytes) -> None:
    flood = (seed * FLOOD)[: FLOOD // 2]
    for length_of in (request_length, reply_length):
        parser = FrameParser(length_of)
        with memory_below(2):
            parser.feed(flood)
        assert len(parser._rest) <= MAX_FRAME


@pytest.mark.parametrize("seed", [b"\n", b"\r\n", b"x", b"\x00", b"OK\n", b"\x00\x00\x00\x01\x00\x00\x00\x00", b"\xff"])
def test_an_acl_line_that_talks_without_end_is_not_kept(seed: bytes) -> None:
    flood = (seed * FLOOD)[:FLOOD]
    answers, lines = AnswerParser(), LineParser()
    kept: list[Any] = []
    with memory_below(32):
        for parser in (answers, lines):
            try:
                kept += parser.feed(flood)
            except AclError:
                kept = []
    for parser in (answers, lines):
        assert len(parser._rest) <= FLOOD
