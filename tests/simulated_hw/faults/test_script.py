"""When faults are on: by time, by place, once or as long as the place lasts."""

import math

import numpy as np
import pytest
import simpy
from numpy.typing import NDArray

from simulated_hw.faults.kinds import FAULTS
from simulated_hw.faults.script import Condition, Script, Windows, follow


class Bench:
    """A chamber at 100 - t °C, its setpoint 10 K below, on a table at -t/10 deg/s."""

    def air_degc(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return 100.0 - times_s

    def setpoint_degc(self, now_s: float) -> float:
        return 90.0 - now_s

    def true_rate_dps(self, now_s: float) -> float:
        return -now_s / 10.0


def windows(start_s: float = 0.0, **script: object) -> Windows:
    return Windows(Script(**script), Bench(), Bench(), start_s)


def test_by_time() -> None:
    assert windows().until(5.0) == [(0.0, math.inf)]
    assert windows(at_s=10.5).until(10.0) == []
    assert windows(at_s=10.5, for_s=2.0).until(10.5) == [(10.5, 12.5)]
    assert [windows(at_s=1.0, for_s=2.0).active(t) for t in (0.9, 1.0, 2.9, 3.0)] == [False, True, True, False]


@pytest.mark.parametrize(
    ("condition", "window"),
    [
        ({"chamber_below_degc": 60.0}, (41.0, math.inf)),
        ({"chamber_below_degc": 60.0, "chamber_above_degc": 49.5}, (41.0, 51.0)),
        ({"setpoint_below_degc": 60.0, "setpoint_above_degc": 50.0}, (31.0, 40.0)),
        ({"table_above_dps": 3.0, "table_below_dps": 4.0}, (31.0, 40.0)),
    ],
)
def test_by_place(condition: dict[str, float], window: tuple[float, float]) -> None:
    when = Condition(**condition)
    assert windows(when=when).until(200.0) == [window]
    by_steps = windows(when=when)
    for now in np.arange(0.0, 200.0, 0.3):
        by_steps.until(float(now))
    assert by_steps.until(200.0) == [window]


def test_by_place_for_a_time_once_and_not_before_a_time() -> None:
    place = Condition(chamber_below_degc=60.0)
    assert windows(when=place, for_s=5.0).until(200.0) == [(41.0, 46.0)]
    assert windows(when=place, for_s=5.0, at_s=70.2).until(200.0) == [(71.0, 76.0)]
    # a world that begins later does not look at what would have been before
    assert windows(50.0, when=place, for_s=5.0).until(200.0) == [(50.0, 55.0)]


def test_what_came_once_by_place_in_an_earlier_world_has_come() -> None:
    place = Condition(chamber_below_degc=60.0)
    again = Windows(Script(when=place, for_s=5.0), Bench(), Bench(), 50.0, begun_s=41.0)
    assert again.complete and again.until(200.0) == [(41.0, 46.0)]
    # by time and as long as a place lasts nothing changes
    assert Windows(Script(at_s=60.0), Bench(), Bench(), 50.0, begun_s=41.0).until(200.0) == [(60.0, math.inf)]
    assert Windows(Script(when=place), Bench(), Bench(), 50.0, begun_s=41.0).until(200.0) == [(50.0, math.inf)]


def test_what_comes_once_by_place_is_told_when_it_begins() -> None:
    told: list[float] = []
    once = windows(when=Condition(chamber_below_degc=60.0), for_s=5.0)
    once.on_begin = told.append
    once.until(40.0)
    assert told == []
    once.until(60.0)
    once.until(200.0)
    assert told == [41.0]


def run(
    begins_s: float, instant: bool, looked_s: float = math.inf, begun_s: float | None = None, **script: object
) -> list[tuple[str, float]]:
    """What a process sees until 300 s; somebody else asks for the windows at looked_s."""
    env = simpy.Environment(initial_time=begins_s)
    seen: list[tuple[str, float]] = []
    begin, end = (lambda: seen.append(("begin", env.now))), (lambda: seen.append(("end", env.now)))
    times = Windows(Script(**script), Bench(), Bench(), begins_s, begun_s)
    if looked_s < math.inf:
        env.timeout(looked_s - begins_s).callbacks.append(lambda _: times.until(env.now))
    env.process(follow(env, times, begin, end, instant))
    env.run(until=300.0)
    return seen


def test_a_process_follows_the_windows() -> None:
    assert run(0.0, False, at_s=10.5, for_s=2.0) == [("begin", 10.5), ("end", 12.5)]
    assert run(0.0, False, at_s=10.5) == [("begin", 10.5)]
    place = Condition(setpoint_below_degc=60.0, setpoint_above_degc=50.0)
    assert run(0.0, False, when=place) == [("begin", 31.0), ("end", 40.0)]
    assert run(0.0, False, when=place, for_s=3.0) == [("begin", 31.0), ("end", 34.0)]


def test_a_resumed_world_repeats_nothing_that_is_over() -> None:
    assert run(20.0, False, at_s=10.0, for_s=2.0) == []
    assert run(11.0, False, at_s=10.0, for_s=2.0) == [("begin", 11.0), ("end", 12.0)]
    assert run(11.0, True, at_s=10.0) == []
    place = Condition(setpoint_below_degc=60.0)
    assert run(45.0, False, begun_s=31.0, when=place, for_s=10.0) == []
    assert run(35.0, False, begun_s=31.0, when=place, for_s=10.0) == [("begin", 35.0), ("end", 41.0)]
    assert run(35.0, True, begun_s=31.0, when=place, for_s=10.0) == []


def test_a_world_that_begins_between_two_seconds_finds_the_same_windows() -> None:
    place = Condition(setpoint_below_degc=60.0)
    assert run(12.345, False, when=place, for_s=3.0) == [("begin", 31.0), ("end", 34.0)]
    # a reader that asks first takes nothing away
    assert run(12.345, False, looked_s=31.0, when=place, for_s=3.0) == [("begin", 31.0), ("end", 34.0)]


@pytest.mark.parametrize(
    ("name", "settings", "field"),
    [
        ("loss", {"probability": 1.5}, "probability"),
        ("burst_loss", {"mean_frames": 0.5}, "mean_frames"),
        ("spike", {"size_dps": 0.0}, "size_dps"),
        ("power_reset", {}, "at_s"),
        ("power_reset", {"at_s": 1.0, "for_s": None}, "for_s"),
        ("late", {"at_s": -1.0}, "at_s"),
        ("silence", {"for_s": 0.0}, "for_s"),
        ("late_reply", {"delay_s": -1.0}, "delay_s"),
        ("garbled_reply", {"bits": 0}, "bits"),
        ("fault", {}, "at_s"),
        ("fault", {"at_s": 0.0, "reason": "a;b"}, "reason"),
        ("over_speed", {"at_s": 0.0, "trip": 0.5}, "trip"),
        ("e_stop", {}, "at_s"),
        ("encoder_error", {"rate_offset_dps": math.nan}, "rate_offset_dps"),
        ("sensor_break", {"reading_degc": math.inf}, "reading_degc"),
        ("door_open", {"leak": 0.5}, "leak"),
        ("weak_cooling", {"remaining": 2.0}, "remaining"),
    ],
)
def test_what_cannot_be_is_refused_with_its_field(name: str, settings: dict[str, object], field: str) -> None:
    with pytest.raises(ValueError, match=rf"^\w+\.{field} = "):
        FAULTS[name](**settings)


def test_an_empty_condition_is_refused() -> None:
    with pytest.raises(ValueError, match="states no condition"):
        Condition()
