"""Waits that cannot end in time are refused before hour 0, with their place."""

from pathlib import Path

import pytest

from tests.bench.checking import BENCH, checked, mistakes

FREE = "procedure: x\nsteps:\n"
ACCELERATION = BENCH.replace("port: sim://table\n", "port: sim://table\n  settings: {acceleration: 10 deg/s^2}\n")


@pytest.mark.parametrize(
    ("second", "said"),
    [
        # 60 K less the band of 0.5 K, at 1 K/min
        (
            "ramp_temperature: {to: 60 degC, rate: 1 degC/min, timeout: 59 min}",
            "'ramp_temperature': from 0 to 60 degC takes at least 59 min 30 s at its rate, 1 degC/min; the timeout is "
            "59 min. Raise 'timeout', or ramp faster.",
        ),
        # at most 4 K/min, as the bench file says
        (
            "set_temperature: {to: -30 degC, timeout: 7 min}",
            "'set_temperature': from 0 to -30 degC takes at least 7 min 22 s at the chamber's limit, 4 degC/min; the "
            "timeout is 7 min. Raise 'timeout', or ramp faster.",
        ),
    ],
)
def test_a_ramp_longer_than_its_timeout(tmp_path: Path, second: str, said: str) -> None:
    steps = f"  - set_temperature: 0 degC\n  - {second}"
    assert mistakes(tmp_path, steps, FREE) == [f"p.yaml:4:5: {said}"]


def test_the_first_ramp_begins_nobody_knows_where_and_a_limit_not_stated_says_nothing(tmp_path: Path) -> None:
    checked(tmp_path, "  - ramp_temperature: {to: 60 degC, rate: 1 degC/min, timeout: 1 min}", FREE)
    unlimited = BENCH.replace(", ramp: 4 degC/min", "")
    checked(
        tmp_path, "  - set_temperature: 0 degC\n  - set_temperature: {to: 60 degC, timeout: 1 min}", FREE, unlimited
    )


def test_a_sweep_is_told_once_with_its_worst(tmp_path: Path) -> None:
    steps = """\
  - sweep:
      temperature: [0 degC, 20 degC, 60 degC, 30 degC]
      ramp: 1 degC/min
      timeout: 10 min
      steps: [dwell: 1 s]"""
    (told,) = mistakes(tmp_path, steps, FREE)
    assert "from 20 to 60 degC takes at least 39 min 30 s" in told
    assert told.endswith("So are 2 more of the values visited here.")


def test_a_rate_that_is_not_reached_in_time(tmp_path: Path) -> None:
    steps = "  - set_rate: 0 deg/s\n  - set_rate: 100 deg/s\n  - settle: {band: 1 deg/s, for: 2 s, timeout: 11 s}"
    (told,) = mistakes(tmp_path, steps, FREE, ACCELERATION)
    # 99 deg/s at 10 deg/s^2, then 2 s in the band
    assert told.startswith("p.yaml:5:5: 'settle': 100 deg/s at 10 deg/s^2 and 2 s in the band take at least 11.9 s")
    checked(tmp_path, steps.replace("11 s", "12 s"), FREE, ACCELERATION)
    checked(tmp_path, steps, FREE)


def test_a_band_that_must_hold_longer_than_the_timeout(tmp_path: Path) -> None:
    (told,) = mistakes(tmp_path, "  - set_rate: 0 deg/s\n  - settle: {band: 1 deg/s, for: 3 min}", FREE)
    assert "180 s in the band take at least 180 s; the timeout is 120 s" in told


def test_a_slope_over_more_time_than_the_soak_has(tmp_path: Path) -> None:
    soak = "  - soak: {for: 1 min, until: {slope: 0.1 degC/min, over: 30 min}, timeout: 10 min}"
    (told,) = mistakes(tmp_path, soak, FREE)
    assert "the slope is taken over 30 min, longer than the timeout, 10 min" in told


def test_a_safe_state_that_comes_too_late_or_not_at_all(tmp_path: Path) -> None:
    slow = ACCELERATION.replace(
        "limits: {rate: 400 deg/s}\n", "limits: {rate: 400 deg/s}\n  safe: {timeout: 30 s}\n", 1
    )
    (told,) = mistakes(tmp_path, "  - dwell: 1 s", FREE, slow)
    assert told.startswith("b.yaml:11:19: the safe state: from 400 deg/s at 10 deg/s^2 the table comes to rest in 40 s")
    off = BENCH.replace("ramp: 4 degC/min}\n", "ramp: 4 degC/min}\n  safe: {action: off}\n", 1)
    (told,) = mistakes(tmp_path, "  - dwell: 1 s", FREE, off)
    assert told.startswith("b.yaml:6:18: ") and "conditioning_event: 1..8" in told
    wired = off.replace("port: sim://chamber\n", "port: sim://chamber\n  settings: {conditioning_event: 2}\n")
    checked(tmp_path, "  - dwell: 1 s", FREE, wired)
