"""Modbus RTU codec against the protocol notes' frames, pymodbus, and arbitrary bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from drivers.codecs.modbus_rtu import (
    ExceptionReply,
    FrameParser,
    ModbusError,
    OtherRequest,
    Read,
    Registers,
    WriteMany,
    WriteOne,
    Written,
    decode_reply,
    decode_request,
    encode_reply,
    encode_request,
    reply_length,
    request_length,
    to_signed,
    to_word,
)

SETPOINT_MINUS_20 = to_word(-200)

# Protocol notes, chambers, section 3: worked frames for -20.0 °C.
REQUESTS = {
    "01 06 01 2C FF 38 09 DD": WriteOne(1, 300, SETPOINT_MINUS_20),
    "01 10 01 2C 00 01 02 FF 38 F1 1E": WriteMany(1, 300, (SETPOINT_MINUS_20,)),
    "01 03 00 64 00 01 C5 D5": Read(1, 100),
}
REPLIES = {
    "01 06 01 2C FF 38 09 DD": Written(1, 6, 300, SETPOINT_MINUS_20),
    "01 10 01 2C 00 01 C1 FC": Written(1, 16, 300, 1),
    "01 03 02 FF 38 F8 66": Registers(1, (SETPOINT_MINUS_20,)),
    "01 86 02 C3 A1": ExceptionReply(1, 6, 2),
}

words = st.integers(0, 0xFFFF)
units = st.integers(1, 247)
requests = st.one_of(
    st.builds(Read, units, words, st.integers(1, 125), st.sampled_from([3, 4])),
    st.builds(WriteOne, units, words, words),
    st.builds(WriteMany, units, words, st.lists(words, min_size=1, max_size=123).map(tuple)),
)
replies = st.one_of(
    st.builds(Registers, units, st.lists(words, min_size=1, max_size=125).map(tuple), st.sampled_from([3, 4])),
    st.builds(Written, units, st.sampled_from([6, 16]), words, words),
    st.builds(ExceptionReply, units, st.sampled_from([3, 4, 6, 16]), st.integers(1, 11)),
)


def pymodbus_request(request: Read | WriteOne | WriteMany) -> bytes:
    match request:
        case Read(unit, register, count, function):
            kind = ReadHoldingRegistersRequest if function == 3 else ReadInputRegistersRequest
            message = kind(address=register, count=count, dev_id=unit)
        case WriteOne(unit, register, value):
            message = WriteSingleRegisterRequest(address=register, registers=[value], dev_id=unit)
        case WriteMany(unit, register, values):
            message = WriteMultipleRegistersRequest(address=register, registers=list(values), dev_id=unit)
    return FramerRTU(DecodePDU(False)).buildFrame(message)


def pymodbus_reply(frame: bytes):
    used, message = FramerRTU(DecodePDU(False)).handleFrame(frame, 0, 0)
    assert used == len(frame)
    return message


@pytest.mark.parametrize(("frame", "message"), REQUESTS.items())
def test_request_frames_of_the_notes(frame, message):
    assert encode_request(message) == bytes.fromhex(frame)
    assert decode_request(bytes.fromhex(frame)) == message


@pytest.mark.parametrize(("frame", "message"), REPLIES.items())
def test_reply_frames_of_the_notes(frame, message):
    assert encode_reply(message) == bytes.fromhex(frame)
    assert decode_reply(bytes.fromhex(frame)) == message


@given(requests)
def test_requests_are_those_of_pymodbus_and_come_back(request):
    frame = encode_request(request)
    assert frame == pymodbus_request(request)
    assert decode_request(frame) == request
    assert request_length(frame) == len(frame)


@given(replies)
def test_replies_are_understood_by_pymodbus_and_come_back(reply):
    frame = encode_reply(reply)
    assert decode_reply(frame) == reply
    assert reply_length(frame) == len(frame)
    theirs = pymodbus_reply(frame)
    assert theirs.dev_id == reply.unit
    if isinstance(reply, Registers):
        assert theirs.registers == list(reply.values)
    elif isinstance(reply, ExceptionReply):
        assert theirs.isError()
        assert theirs.exception_code == reply.code
    else:
        assert theirs.address == reply.register


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        (ReadHoldingRegistersResponse(dev_id=7, registers=[1, 65535]), Registers(7, (1, 65535))),
        (WriteSingleRegisterResponse(dev_id=7, address=300, registers=[5]), Written(7, 6, 300, 5)),
        (WriteMultipleRegistersResponse(dev_id=7, address=300, count=3), Written(7, 16, 300, 3)),
    ],
)
def test_replies_made_by_pymodbus_are_understood(theirs, ours):
    assert decode_reply(FramerRTU(DecodePDU(True)).buildFrame(theirs)) == ours


@given(st.lists(requests, min_size=1, max_size=4), st.binary(max_size=6), st.data())
def test_frames_come_out_of_any_slicing(messages, junk, data):
    stream = junk + b"".join(encode_request(message) for message in messages)
    parser, frames = FrameParser(request_length), []
    at = 0
    while at < len(stream):
        step = data.draw(st.integers(1, len(stream)))
        frames += parser.feed(stream[at : at + step])
        at += step
    decoded = [decode_request(frame) for frame in frames]
    # Junk may itself pass for a frame (FF FF 00 00 does); what follows it is never lost.
    assert decoded[-len(messages) :] == messages
    assert junk or len(decoded) == len(messages)


def test_parser_forgets_a_broken_frame_after_a_silence():
    parser = FrameParser(request_length)
    frame = encode_request(Read(1, 100))
    assert parser.feed(encode_request(WriteMany(1, 300, (1, 2)))[:9]) == []
    parser.clear()
    assert parser.feed(frame) == [frame]


def test_unknown_function_is_a_frame_when_its_crc_is_right():
    frame = FramerRTU(DecodePDU(False)).encode(bytes([0x2B, 0x0E, 0x01, 0x00]), 1, 0)
    assert FrameParser(request_length).feed(frame) == [frame]
    assert decode_request(frame) == OtherRequest(1, 0x2B)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_give_a_message_or_a_clear_error(data):
    for decode in (decode_request, decode_reply):
        try:
            decode(data)
        except ModbusError as error:
            assert len(str(error)) > 15
    for length_of in (request_length, reply_length):
        for frame in FrameParser(length_of).feed(data):
            assert 4 <= len(frame) <= 256


@given(st.sampled_from(list(REPLIES)), st.integers(0, 6), st.integers(1, 255))
def test_one_damaged_byte_never_passes(frame, at, change):
    damaged = bytearray.fromhex(frame)
    damaged[min(at, len(damaged) - 1)] ^= change
    with pytest.raises(ModbusError):
        decode_reply(bytes(damaged))


@pytest.mark.parametrize(
    ("message", "names"),
    [
        (Read(300, 100), "unit 300"),
        (Read(1, 70000), "register 70000"),
        (Read(1, 100, 126), "count 126"),
        (Read(1, 100, 1, 6), "function 6"),
        (WriteOne(1, 300, -1), "value -1"),
        (WriteMany(1, 300, ()), "count 0"),
    ],
)
def test_impossible_requests_are_named(message, names):
    with pytest.raises(ModbusError, match=names):
        encode_request(message)


@given(st.integers(-0x8000, 0x7FFF))
def test_signed_words(value):
    assert to_signed(to_word(value)) == value
    assert to_word(value) == int.from_bytes(value.to_bytes(2, "big", signed=True), "big")


@pytest.mark.parametrize("value", [-0x8001, 0x8000])
def test_words_that_do_not_fit(value):
    with pytest.raises(ModbusError, match=str(value)):
        to_word(value)
