"""Frames per second through the stream codecs, aligned and with damage to resynchronise after, beside cantools."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cantools
import numpy as np

from drivers.codecs.can_frames import CanDecoder
from drivers.codecs.frame_spec import FrameSpec
from drivers.codecs.frames import StreamDecoder, encode
from drivers.gyros import can_dbc

FRAMES = 600_000
BLOCKS = (100, 6000)
CANTOOLS_FRAMES = 20_000
DATA_RATE_HZ = 100.0
PACKAGED_DBC = Path(can_dbc.__file__).parent / "frames" / "fog_gyro.dbc"


def main() -> None:
    """Print the table."""
    serial_frames()
    can_frames()


def serial_frames() -> None:
    """The KVH 36-byte frame: encode, decode in blocks, decode with one damaged frame in a thousand."""
    spec = FrameSpec.load("kvh_36_c100")
    rng = np.random.default_rng(1)
    columns: dict[str, Any] = {
        "x_rotation": rng.normal(0.03, 1e-6, FRAMES).astype(np.float32),
        "temperature": np.full(FRAMES, 2500, np.int16),
        "sequence": (np.arange(FRAMES) % 128).astype(np.uint8),
        "status": 0x77,
    }
    seconds, rows = _timed(lambda: [_encode(spec, columns, at) for at in range(0, FRAMES, 6000)])
    _say("KVH 36 B encode, blocks of 6000", FRAMES, seconds)
    wire = np.concatenate(rows).tobytes()
    clean = {block: _decode(spec, wire, block) for block in BLOCKS}
    for block, seconds in clean.items():
        _say(f"KVH 36 B decode, blocks of {block}", FRAMES, seconds)
    damaged = _damaged(wire, spec.length, rng)
    seconds = _decode(spec, damaged, 6000)
    _say(
        "KVH 36 B decode, 1 damage per 1000 frames", FRAMES, seconds, f"{clean[6000] / seconds:.2f} of the clean speed"
    )


def _encode(spec: FrameSpec, columns: dict[str, Any], at: int) -> Any:
    part = {name: values if np.isscalar(values) else values[at : at + 6000] for name, values in columns.items()}
    return encode(spec, part, 6000)


def _decode(spec: FrameSpec, wire: bytes, block: int) -> float:
    decoder = StreamDecoder(spec, DATA_RATE_HZ)
    size = block * spec.length
    seconds, _ = _timed(lambda: [decoder.feed(wire[at : at + size]) for at in range(0, len(wire), size)])
    return seconds


def _damaged(wire: bytes, length: int, rng: np.random.Generator) -> bytes:
    """The stream with a byte dropped or a bit flipped once per thousand frames."""
    pieces, at = [], 0
    for place in sorted(rng.integers(0, len(wire), len(wire) // length // 1000)):
        if place <= at:
            continue
        flip = bytes([wire[place] ^ 4]) if rng.random() < 0.5 else b""
        pieces += [wire[at:place], flip]
        at = int(place) + 1
    return b"".join([*pieces, wire[at:]])


def can_frames() -> None:
    """The CAN gyro by its DBC, beside cantools on the same frames."""
    can_spec = can_dbc.CanGyroSettings().spec()
    rng = np.random.default_rng(2)
    payload = np.zeros((FRAMES, 8), np.uint8)
    payload[:, 0:4] = rng.normal(10.0, 0.01, FRAMES).astype("<f4").view(np.uint8).reshape(-1, 4)
    payload[:, 6] = np.arange(FRAMES) % 256
    ids, lengths = np.full(FRAMES, can_spec.can_id, np.uint32), np.full(FRAMES, 8, np.uint8)
    speeds = {}
    for block in BLOCKS:
        decoder = CanDecoder(can_spec, DATA_RATE_HZ)
        starts = range(0, FRAMES, block)
        ours, _ = _timed(
            lambda block=block, decoder=decoder, starts=starts: [
                decoder.feed(ids[a : a + block], payload[a : a + block], lengths[a : a + block]) for a in starts
            ]
        )
        speeds[block] = FRAMES / ours
        _say(f"CAN by DBC decode, blocks of {block}", FRAMES, ours)
    message = cantools.database.load_file(PACKAGED_DBC).get_message_by_frame_id(can_spec.can_id)
    few = [row.tobytes() for row in payload[:CANTOOLS_FRAMES]]
    theirs, decoded = _timed(lambda: [message.decode(row) for row in few])
    ratio = speeds[6000] / (CANTOOLS_FRAMES / theirs)
    _say("CAN, cantools on the same frames", CANTOOLS_FRAMES, theirs, f"ours is {ratio:.0f} x as fast")
    del decoded


def _timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Best wall time of three runs, and the result."""
    best, result = float("inf"), None
    for _ in range(3):
        began = time.perf_counter()
        result = action()
        best = min(best, time.perf_counter() - began)
    return best, result


def _say(what: str, frames: int, seconds: float, note: str = "") -> None:
    print(f"{what:<44} {frames / seconds / 1e6:8.2f} M frames/s  {note}".rstrip())
