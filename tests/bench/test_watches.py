"""What guards watch, against instruments that are as they are told to be."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bench.engine import Readbacks
from bench.procedure.conditions import Guard
from bench.watches import READ_AGAIN_S, Stream, Watches
from drivers.codecs.batch import FrameBatch
from drivers.codecs.counters import Losses
from drivers.errors import DriverError, NoReply, Refused

BAND = {"from": "0 degC", "to": "50 degC"}


class Instrument:
    """Chamber and table in one: answers what it is told to, or fails."""

    def __init__(self) -> None:
        self.degc, self.rate, self.door = 25.0, 10.0, False
        self.error: DriverError | None = None
        self.asked = 0

    def _answer(self, value: Any) -> Any:
        self.asked += 1
        if self.error:
            raise self.error
        return value

    def temperature_degc(self) -> float:
        return self._answer(self.degc)

    def rate_dps(self) -> float:
        return self._answer(self.rate)

    def alarm(self) -> None:
        return self._answer(None)

    fault = alarm

    def door_open(self) -> bool:
        return self._answer(self.door)


class Bench:
    """As much of an engine as the watches look at."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.clock = SimpleNamespace(now=lambda: self.now_s)
        self.instrument = Instrument()
        self.bench = SimpleNamespace(chamber="declared", rate_table="declared")
        self.station = SimpleNamespace(chamber=self.instrument, table=self.instrument, gyros={}, absent={})
        self.readbacks = Readbacks(chamber_degc=25.0, rate_dps=10.0, chamber_s=1000.0, rate_s=1000.0)
        self.silent_s: dict[str, float] = {}
        self.newest: dict[str, FrameBatch] = {}


def watching(bench: Bench, **guard: Any) -> Any:
    """What the guard says now, None if it holds; asked again and again."""
    watches = Watches([Guard.model_validate({"name": "g", **guard})])
    return lambda: next((text for _, _, text in watches.tripped(bench)), None)  # type: ignore[arg-type]


GUARDS = [
    {"watch": "chamber_temperature", "inside": BAND},
    {"watch": "rate", "max_rate": "100 deg/s"},
    {"watch": "chamber_alarm"},
    {"watch": "table_fault"},
    {"watch": "chamber_door"},
]
NO_REPLY = NoReply("the chamber", "read", 1.0, 3)


@pytest.mark.parametrize("guard", GUARDS)
def test_a_signal_that_is_lost_trips_after_the_stated_time_and_not_before(guard: dict[str, Any]) -> None:
    bench = Bench()
    says = watching(bench, lost_after="5 min", **guard)
    assert says() is None
    bench.instrument.error = NO_REPLY
    for t_s, tripped in ((1000.0, False), (1299.0, False), (1400.0, True)):
        bench.now_s = t_s
        assert (says() is not None) is tripped
    assert "no signal for" in says() and "no reply" in says().lower()
    bench.instrument.error = None
    assert says() is None


@pytest.mark.parametrize("guard", GUARDS)
def test_an_instrument_that_is_looked_for_is_a_signal_lost_and_no_bench_without_it(guard: dict[str, Any]) -> None:
    bench = Bench()
    says = watching(bench, lost_after="5 min", **guard)
    assert says() is None
    bench.station.chamber = bench.station.table = None
    assert says() is None
    bench.now_s += 301.0
    assert "no signal for 5 min 1 s: the" in says() and "is away" in says()


@pytest.mark.parametrize("guard", GUARDS)
def test_what_the_instrument_refuses_trips_at_once(guard: dict[str, Any]) -> None:
    bench = Bench()
    bench.now_s += READ_AGAIN_S + 1.0
    bench.instrument.error = Refused("the chamber", "read register 7", "exception 2", "")
    assert "no signal: " in watching(bench, **guard)()


@pytest.mark.parametrize(("guard", "tripped"), [(guard, n in (0, 1, 4)) for n, guard in enumerate(GUARDS)])
def test_on_a_bench_without_the_instrument_only_what_needs_it_has_tripped(guard: dict[str, Any], tripped: bool) -> None:
    bench = Bench()
    bench.station.chamber = bench.station.table = None
    bench.bench.chamber = bench.bench.rate_table = None
    assert (watching(bench, **guard)() is not None) is tripped


def test_an_old_readback_is_taken_again_before_it_is_judged() -> None:
    bench = Bench()
    temperature, rate = (watching(bench, **guard) for guard in GUARDS[:2])
    bench.instrument.degc, bench.instrument.rate = 60.0, -200.0
    bench.now_s += READ_AGAIN_S
    assert temperature() is rate() is None and bench.instrument.asked == 0
    bench.now_s += 1.0
    assert temperature() == "the chamber reads 60 degC, allowed are 0 to 50 degC"
    assert rate() == "the table turns at -200 deg/s, allowed are ± 100"
    assert (bench.readbacks.chamber_s, bench.readbacks.rate_s) == (bench.now_s, bench.now_s)


def test_a_readback_that_never_was_is_taken_at_once() -> None:
    bench = Bench()
    bench.readbacks = Readbacks()
    assert watching(bench, **GUARDS[0])() is None and bench.readbacks.chamber_degc == 25.0


def test_a_sensor_that_reads_no_number_has_tripped() -> None:
    bench = Bench()
    bench.readbacks.chamber_degc = float("nan")
    assert "reads nan degC" in watching(bench, **GUARDS[0])()


RATE_HZ = 100.0


class Gyro:
    data_rate_hz = RATE_HZ

    def __init__(self, frames: int = 0, lost: int = 0) -> None:
        self.losses = Losses(frames=frames, lost=lost)


def sent(raw: Any) -> FrameBatch:
    values = np.asarray(raw, float)
    n = len(values)
    return FrameBatch({"rate": values} if n else {}, np.arange(n), values, np.zeros(n), np.ones(n, bool))


def feed(stream: Stream, gyro: Gyro, t_s: float, raw: Any, **lost: int) -> None:
    gyro.losses += Losses(frames=len(raw), **lost)
    stream.take(t_s, gyro, sent(raw))


def test_losses_are_judged_over_the_window_and_forgotten_behind_it() -> None:
    stream, gyro = Stream(60.0), Gyro()
    for k in range(10):
        feed(stream, gyro, 10.0 * k, np.arange(1000.0) + k, lost=20 if 4 <= k <= 5 else 0)
        complaint = stream.complaint(10.0 * k, 5000.0)
        # 20 of 1020 frames in ten seconds, 40 in the minute before 50 ... 90 s: 40 of 5040 to 6040 are over 5000 ppm
        assert (complaint is not None) is (k >= 5), (k, complaint)
    for k in range(10, 14):
        feed(stream, gyro, 10.0 * k, np.arange(1000.0) + k)
    assert stream.complaint(130.0, 5000.0) is None


@pytest.mark.parametrize(
    "lost", [{"lost": 30}, {"bad_status": 30}, {"lost": 30, "bad_checksum": 30}, {"bad_checksum": 30}]
)
def test_every_kind_of_bad_frame_counts_once(lost: dict[str, int]) -> None:
    stream, gyro = Stream(60.0), Gyro()
    feed(stream, gyro, 0.0, [1.0, 2.0])
    feed(stream, gyro, 60.0, np.arange(970.0 + (30 if "bad_status" in lost else 0)), **lost)
    assert stream.complaint(60.0, 29_999.0) is not None and stream.complaint(60.0, 30_001.0) is None


def test_a_window_that_has_just_begun_says_nothing() -> None:
    stream, gyro = Stream(60.0), Gyro()
    feed(stream, gyro, 0.0, [1.0])
    feed(stream, gyro, 29.0, [1.0, 2.0], lost=998)
    assert stream.complaint(29.0, 100.0) is None and stream.complaint(30.0, 100.0) is not None


def test_a_reader_that_was_opened_anew_counts_from_zero() -> None:
    stream, gyro = Stream(60.0), Gyro(frames=100_000, lost=5)
    stream.take(0.0, gyro, sent([1.0]))
    gyro.losses = Losses(frames=10)
    stream.take(60.0, gyro, sent([2.0]))
    assert stream.complaint(60.0, 0.0) is None


@given(st.lists(st.integers(1, 400), min_size=2, max_size=30), st.integers(0, 11_000))
@example([1, 1, 1, 1, 1, 1, 1, 393, 400, 400, 400, 400], 0)
def test_since_when_an_output_is_frozen_however_it_is_cut_into_batches(sizes: list[int], freezes: int) -> None:
    """Frame k is sent at k/100 s; its output repeats from `freezes` on."""
    total = sum(sizes)
    raw = np.minimum(np.arange(total, dtype=float), freezes)
    stream, gyro, at = Stream(20.0), Gyro(), 0
    for size in sizes:
        batch = raw[at : at + size]
        at += size
        feed(stream, gyro, at / RATE_HZ, batch)
        same_s = (at - 1 - min(freezes, at - 1)) / RATE_HZ
        assert (stream.complaint(at / RATE_HZ, 1e6) is not None) is (same_s >= 20.0 - 1e-9)


def test_the_same_batch_again_changes_nothing() -> None:
    stream, gyro = Stream(60.0), Gyro()
    batch = sent([1.0, 2.0])
    for t_s in (0.0, 30.0, 90.0):
        stream.take(t_s, gyro, batch)
    assert len(stream.counts) == 1


def test_a_dut_that_is_looked_for_is_watched_on() -> None:
    bench = Bench()
    bench.station.absent["A"] = Gyro()
    bench.silent_s["A"] = 30.0
    says = watching(bench, watch="sample_quality", lost="1 %")
    assert says() == "A: nothing valid was received for 30 s"
