"""Random streams with a name and a counter, so that any part of any stream can be drawn without drawing the rest.

Philox is a counter-based generator: the key says whose stream it is, the counter's high word which chunk of it. Adding
a device, or asking for chunks in another order, changes nobody's numbers.
"""

from hashlib import blake2b
from typing import Any

import numpy as np

_READINGS_PER_CHUNK = 64


class Stream:
    """The random stream with this name under this seed; the name may have several parts."""

    def __init__(self, seed: int, *names: str) -> None:
        text = "\0".join((str(seed), *names)).encode()
        key = np.frombuffer(blake2b(text, digest_size=16).digest(), dtype="<u8").astype(np.uint64)
        self._counter = np.zeros(4, dtype=np.uint64)
        # Setting the state of one generator is eight times faster than making one, which asks the system for entropy.
        self._bits = np.random.Philox(key=key)
        self._generator = np.random.Generator(self._bits)
        self._start: Any = {
            "bit_generator": "Philox",
            "state": {"counter": self._counter, "key": key},
            "buffer": np.zeros(4, dtype=np.uint64),
            "buffer_pos": 4,  # empty
            "has_uint32": 0,
            "uinteger": 0,
        }

    def chunk(self, number: int) -> np.random.Generator:
        """A generator at the start of one chunk; it is the stream's only one, so draw from it before the next call."""
        self._counter[3] = number
        self._bits.state = self._start
        return self._generator


class ReadingNoise:
    """Standard normal noise of an instrument's readings: a function of the time of reading, renewed every period."""

    def __init__(self, stream: Stream, period_s: float) -> None:
        self._stream, self._period_s = stream, period_s
        self._chunk, self._values = -1, [0.0]

    def at(self, now_s: float) -> float:
        """The noise of a reading taken at this instant, which must not be before 0."""
        chunk, index = divmod(int(now_s / self._period_s), _READINGS_PER_CHUNK)
        if chunk != self._chunk:
            self._values = self._stream.chunk(chunk).standard_normal(_READINGS_PER_CHUNK).tolist()
            self._chunk = chunk
        return self._values[index]
