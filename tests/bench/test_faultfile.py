"""Faults in a bench file: what is read, and every mistake with its place."""

from pathlib import Path

import pytest

from bench.benchfile import Bench, load_bench
from bench.composition import check_simulation
from bench.faultfile import read_faults, without_faults
from simulated_hw.faults.kinds import FAULTS, faults_of
from simulated_hw.faults.script import Condition
from tests.bench.campaigns import write

FAULTY_BENCH = """\
bench: faulty
chamber:
  driver: watlow_f4
  port: sim://chamber
  limits: {temperature: {from: -60 degC, to: 90 degC}, ramp: 4 degC/min}
duts:
  FOG-A01:
    driver: serial_frames
    port: sim://a
    limits: {rate: 200 deg/s}
  FOG-B01:
    driver: can_dbc
    port: {interface: fogsim, channel: b}
    limits: {rate: 200 deg/s}
simulation:
  faults:
"""


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("- {name: los, on: FOG-A01}", ":17:14: 'name': 'los' is no fault. Allowed: "),
        (
            "- {name: loss, on: FOG-A1}",
            ":17:24: 'on': 'FOG-A1' is no instrument of this bench. Allowed: FOG-A01, FOG-B01, chamber.",
        ),
        ("- {name: loss, on: rate_table}", ":17:24: 'on': 'rate_table' is no instrument"),
        ("- {on: FOG-A01}", ":17:7: the key 'name' is missing here. Example: {name: loss"),
        ("- {name: loss}", ":17:7: the key 'on' is missing here."),
        (
            "- {name: bit_error, on: FOG-B01}",
            ":17:14: 'bit_error' is no fault of a DUT on a CAN bus (FOG-B01). Allowed:",
        ),
        ("- {name: loss, on: chamber}", ":17:14: 'loss' is no fault of the chamber (chamber). Allowed: no_reply,"),
        ("- {name: alarm, on: FOG-A01}", ":17:14: 'alarm' is no fault of a DUT (FOG-A01). Allowed: loss,"),
        ("- {name: loss, on: FOG-A01, leak: 3}", ":17:33: unknown key 'leak'."),
        ("- {name: loss, on: FOG-A01, probability: 2}", ":17:46: probability = 2"),
        ("- {name: late, on: FOG-A01, for: 3}", ":17:38: 'for': 3 has no unit."),
        ("- {name: e_stop, on: chamber, at: 1 h}", "'e_stop' is no fault of the chamber"),
        ("- {name: late, on: FOG-A01}", ":17:7: at = None: must be given, or a 'when'"),
        ("- {name: loss, on: FOG-A01, when: {}}", ":17:39: "),
        ("- {name: loss, on: FOG-A01, when: {chamber: 3 degC}}", ":17:40: unknown key 'chamber'."),
        ("- loss", ":17:7: a fault is expected here, such as {name: loss"),
    ],
)
def test_mistakes_are_shown_with_their_place(tmp_path: Path, line: str, said: str) -> None:
    bench, problems = load_bench(write(tmp_path, "b.yaml", f"{FAULTY_BENCH}    {line}\n"))
    assert bench and not problems
    (problem,) = check_simulation(bench)
    assert said in str(problem)


def test_faults_are_a_list(tmp_path: Path) -> None:
    text = FAULTY_BENCH.replace("  faults:\n", "  faults: {name: loss}\n")
    bench, _ = load_bench(write(tmp_path, "b.yaml", text))
    assert bench
    (problem,) = check_simulation(bench)
    assert "'faults': expected a list of faults" in str(problem) and ":16:11" in str(problem)


def bench_with(folder: Path, *lines: str) -> Bench:
    text = FAULTY_BENCH + "".join(f"    {line}\n" for line in lines)
    bench, problems = load_bench(write(folder, "b.yaml", text))
    assert bench and not problems
    return bench


def test_faults_are_read_in_order_with_their_units(tmp_path: Path) -> None:
    spike = "- {name: spike, on: FOG-B01, size: 36 deg/h, at: 3 h, for: 10 min}"
    door = "- {name: door_open, on: chamber, leak: 50, when: {chamber_below: -10 degC, table_above: 1 deg/s}}"
    bench = bench_with(tmp_path, spike, door)
    assert not check_simulation(bench)
    (_, on, first), (name, _, second) = read_faults(bench, FAULTS, faults_of, [])
    assert on == "FOG-B01" and name == "door_open"
    assert (first.size_dps, first.at_s, first.for_s, first.when) == (pytest.approx(0.01), 10800.0, 600.0, None)
    assert second.leak == 50.0 and second.when == Condition(chamber_below_degc=-10.0, table_above_dps=1.0)


def test_every_mistake_is_shown_at_once(tmp_path: Path) -> None:
    bench = bench_with(tmp_path, "- {name: los, on: FOG-A1}", "- {name: spike, on: FOG-A01, size: 3, leak: 4}")
    assert [problem.mark.line for problem in sorted(check_simulation(bench))] == [17, 17, 18, 18]


def test_a_bench_without_its_faults_is_otherwise_the_same(tmp_path: Path) -> None:
    bench = bench_with(tmp_path, "- {name: loss, on: FOG-A01}")
    healthy = without_faults(bench)
    assert "faults" not in healthy.file.simulation and healthy.duts == bench.duts
    assert read_faults(healthy, FAULTS, faults_of, []) == []
