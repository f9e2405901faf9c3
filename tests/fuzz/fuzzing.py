"""What the fuzzers share: valid files broken in small ways, how often, and how much memory an answer may take."""

import random
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

# Quick by default; `pytest -m long tests/fuzz` for minutes.
EXAMPLES = pytest.mark.parametrize("examples", [60, pytest.param(5_000, marks=pytest.mark.long)])


def broken(*whole: bytes) -> st.SearchStrategy[bytes]:
    """A valid text with one to four pieces flipped, cut out, repeated, exchanged for another's, or grown; or any bytes.

    Where is drawn from one seed: hypothesis has little to shrink, and examples are cheap.
    """
    return st.one_of(
        st.builds(
            _broken, st.sampled_from(whole), st.sampled_from(whole), st.integers(0, 2**32), st.binary(max_size=30)
        ),
        st.binary(max_size=300),
    )


def _broken(data: bytes, other: bytes, seed: int, grown: bytes) -> bytes:
    rng = random.Random(seed)
    for _ in range(rng.randint(1, 4)):
        start = rng.randrange(len(data) + 1)
        end = min(len(data), start + rng.choice((1, 1, 4, 30, 200)))
        piece = data[start:end]
        from_other = rng.randrange(len(other))
        pieces: Sequence[bytes] = (
            bytes(byte ^ 1 << rng.randrange(8) for byte in piece),
            b"",
            piece * rng.choice((2, 3, 50)),
            other[from_other : from_other + len(piece) + 20],
            grown,
            bytes(len(piece)),
        )
        data = data[:start] + rng.choice(pieces) + data[end:]
    return data


def fuzz(inputs: st.SearchStrategy[Any], parse: Callable[[Any], None], examples: int) -> None:
    """Parse many inputs; any exception that `parse` does not expect fails."""

    @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(inputs)
    def once(data: Any) -> None:
        parse(data)

    once()


@contextmanager
def memory_below(mebibytes: float) -> Iterator[None]:
    """Fails if Python and numpy take more than so much memory at once inside."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < mebibytes * 2**20, f"{peak / 2**20:.1f} MiB"
