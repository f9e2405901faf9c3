"""The two clocks, with simpy itself as the witness of the virtual one."""

import re
import threading

import pytest
import simpy

from bench.clock import Clock, StopRequest, VirtualClock, WallClock, stopwatch, utc_now
from bench.errors import ExitCode, Interrupted


def test_virtual_time_moves_by_what_is_waited_and_by_nothing_else() -> None:
    env = simpy.Environment()
    clock: Clock = VirtualClock(env)
    assert clock.virtual
    assert clock.now() == 0.0
    clock.wait(3600.0)
    assert clock.now() == env.now == 3600.0
    for nothing in (0.0, -1.0, float("nan"), 1e-300):
        clock.wait(nothing)
        assert clock.now() == 3600.0


def test_what_happens_in_the_world_happens_while_somebody_waits() -> None:
    env = simpy.Environment()
    clock, seen = VirtualClock(env), list[float]()

    def ticking() -> simpy.events.ProcessGenerator:
        while True:
            yield env.timeout(10.0)
            seen.append(env.now)

    env.process(ticking())
    clock.wait(35.0)
    assert seen == [10.0, 20.0, 30.0]
    clock.wait(5.0)
    clock.wait(1e-9)
    assert seen == [10.0, 20.0, 30.0, 40.0]


def test_a_week_of_small_waits_adds_up() -> None:
    """Float seconds lose less than a microsecond over a campaign polled every 20 s."""
    clock = VirtualClock(simpy.Environment())
    for _ in range(30_000):
        clock.wait(20.1)
    assert clock.now() == pytest.approx(603_000.0, abs=1e-6)


def test_a_stop_is_noticed_at_the_wait_and_can_be_forgotten() -> None:
    clock = VirtualClock(simpy.Environment())
    clock.stop.ask()
    assert clock.now() == 0.0
    with pytest.raises(Interrupted) as caught:
        clock.wait(5.0)
    assert caught.value.exit_code == ExitCode.INTERRUPTED
    with pytest.raises(Interrupted):
        clock.wait(0.0)
    clock.stop.forget()
    clock.wait(5.0)


def test_a_wall_wait_ends_at_once_when_a_stop_is_asked_from_another_thread() -> None:
    clock = WallClock()
    assert not clock.virtual
    asker = threading.Thread(target=clock.stop.ask)
    asker.start()
    with pytest.raises(Interrupted):
        clock.wait(600.0)
    asker.join()


def test_the_wall_clock_runs_forward_and_waits_at_least_as_long_as_asked() -> None:
    clock = WallClock()
    before = clock.now()
    clock.wait(0.02)
    assert clock.now() - before >= 0.02
    clock.wait(-1.0)
    clock.wait(0.0)


def test_bench_time_at_a_multiple_of_the_wall() -> None:
    clock, wall = WallClock(start_s=1000.0, speed=50.0), WallClock()
    clock.wait(5.0)
    assert 0.1 <= wall.now() < 5.0
    assert clock.now() >= 1005.0
    assert (clock.now() - 1000.0) / 50.0 == pytest.approx(wall.now(), abs=0.05)


def test_a_stop_request_alone() -> None:
    stop = StopRequest()
    stop.wait(0.0)
    stop.ask()
    stop.ask()
    with pytest.raises(Interrupted):
        stop.wait(0.0)


def test_calendar_time_is_utc_to_the_second_and_the_stopwatch_runs_forward() -> None:
    assert re.fullmatch(r"20\d\d-[01]\d-[0-3]\dT[0-2]\d:[0-5]\d:[0-5]\dZ", utc_now())
    assert stopwatch() <= stopwatch()
