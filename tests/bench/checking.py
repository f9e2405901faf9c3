"""A small procedure and bench to be checked against each other, with one thing changed at a time."""

from pathlib import Path

import pytest

from bench.check import Checked, check
from bench.errors import ExitCode, InvalidFiles

# Limits all different, so that a message tells which of them spoke.
BENCH = """\
bench: b
chamber:
  driver: watlow_f4
  port: sim://chamber
  limits: {temperature: {from: -60 degC, to: 90 degC}, ramp: 4 degC/min}
rate_table:
  driver: acutronic_acl
  port: sim://table
  limits: {rate: 400 deg/s}
duts:
  A1:
    driver: serial_frames
    port: sim://a1
    settings: {data_rate: 100 Hz}
    limits: {rate: 200 deg/s, temperature: {from: -40 degC, to: 70 degC}}
  B1:
    driver: can_dbc
    port: {interface: fogsim, channel: b1}
    settings: {data_rate: 50 Hz}
    limits: {rate: 300 deg/s}
"""
PROCEDURE = """\
procedure: x
limits:
  temperature: {from: -30 degC, to: 60 degC}
  rate: 180 deg/s
  ramp: 1 degC/min
  duration: 10 h
steps:
"""


def checked(folder: Path, steps: str, head: str = PROCEDURE, bench: str = BENCH, tail: str = "") -> Checked:
    (folder / "p.yaml").write_text(f"{head}{steps}\n{tail}")
    (folder / "b.yaml").write_text(bench)
    return check(folder / "p.yaml", folder / "b.yaml")


def mistakes(folder: Path, steps: str, head: str = PROCEDURE, bench: str = BENCH, tail: str = "") -> list[str]:
    with pytest.raises(InvalidFiles) as caught:
        checked(folder, steps, head, bench, tail)
    assert caught.value.exit_code == ExitCode.USER_MISTAKE
    return [str(problem).replace(f"{folder}/", "") for problem in caught.value.problems]
