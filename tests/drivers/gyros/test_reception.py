"""How long since what, and whether the pace is the declared one."""

import numpy as np
import pytest

from drivers.codecs.batch import FrameBatch, Meaning, Quantity
from drivers.gyros.reception import Reception


def frames(first: int, count: int) -> FrameBatch:
    return Meaning(Quantity()).batch({"rate": np.zeros(count, np.float32)}, np.arange(first, first + count))


def test_elapsed_time_is_not_known_the_first_time() -> None:
    reception = Reception(100.0)
    assert [reception.elapsed_s(stamp) for stamp in (5.0, 5.5, 8.0)] == [None, 0.5, 2.5]
    reception.join(10.0)
    assert reception.elapsed_s(10.25) == 0.25


@pytest.mark.parametrize(("data_rate_hz", "patience_s"), [(100.0, 1.0), (2.0, 10.0)])
def test_silence(data_rate_hz: float, patience_s: float) -> None:
    reception = Reception(data_rate_hz)
    assert reception.silence() is None
    reception.join(100.0)
    reception.elapsed_s(100.5)
    reception.took(36, frames(0, 1))
    reception.elapsed_s(100.4 + patience_s)
    reception.took(0, frames(0, 0))
    assert reception.silence() is None
    reception.elapsed_s(100.5 + 2 * patience_s)
    assert reception.silence() == f"nothing received for {2 * patience_s:g} s"
    reception.took(1, frames(0, 0))
    assert reception.silence() is None


def test_bytes_since_the_last_frame() -> None:
    reception = Reception(100.0)
    for size, count, expected in ((10, 0, 10), (20, 0, 30), (36, 1, 0), (5, 0, 5)):
        reception.took(size, frames(0, count))
        assert reception.bytes_since_frame == expected
    reception.join(0.0)
    assert reception.bytes_since_frame == 0


@pytest.mark.parametrize(
    ("hz", "seconds", "complains"),
    [(100.0, 10.0, False), (97.0, 10.0, False), (10.0, 10.0, True), (1000.0, 1.0, False), (1000.0, 3.0, True)],
)
def test_pace(hz: float, seconds: float, complains: bool) -> None:
    reception = Reception(100.0)
    reception.join(50.0)
    for poll in range(10):
        reception.elapsed_s(50.0 + (poll + 1) * seconds / 10)
        count = round(hz * seconds / 10)
        reception.took(36 * count, frames(poll * count + 77, count))
    text = reception.pace()
    assert (text is not None) is complains
    if text:
        assert f"frames come at {hz:g} Hz, but data_rate says 100 Hz" in text
