"""`check` of what comes after the steps: analyses that could not be made, and the simulation of a virtual bench."""

from importlib.metadata import entry_points
from pathlib import Path

import pytest

from tests.bench.checking import BENCH, checked, mistakes

MODELS = ", ".join(sorted(item.name for item in entry_points(group="fogbench.models")))
GRID = """\
  - sweep:
      temperature: [0 degC, 10 degC, 20 degC]
      steps:
        - sweep:
            rate: [1 deg/s, 2 deg/s]
            steps: [{acquire: {count: 5, every: 1 s}}]
"""


@pytest.mark.parametrize(
    ("steps", "analysis", "problems"),
    [
        (GRID, "{models: [linear]}", []),
        (GRID, "{models: [linear], splits: {random: {train: 5}}}", []),
        (
            GRID,
            "{models: [linear], splits: {random: {train: 6}}}",
            ["p.yaml:14:55: 6 rows for training, but only 6 points are measured."],
        ),
        (
            GRID,
            "{models: [linear, ts_jont]}",
            [f"p.yaml:14:29: unknown model 'ts_jont'. Allowed: {MODELS}. Did you mean ts_joint?"],
        ),
        (
            GRID,
            "{models: [linear], limits: [{model: ts_joint, split: random, std: 1 deg/s}]}",
            ["p.yaml:14:47: the limit is for 'ts_joint', which is not fitted. Allowed: linear."],
        ),
        (
            GRID,
            "{models: [linear], limits: [{model: linear, std: 1 deg/s}]}",
            [
                "p.yaml:14:11: a limit needs temperatures left out in 6 folds, but points are measured at 3 only. "
                "Ask for fewer folds.",
            ],
        ),
        (
            GRID,
            "{models: [linear], splits: {leave_temperatures_out: {folds: 3}}, limits: [{model: linear, std: 1 deg/s}]}",
            [],
        ),
        (GRID, "{models: [linear], limits: [{model: linear, split: random, std: 1 deg/s}]}", []),
        (
            "  - set_rate: 1 deg/s",
            "{models: [linear]}",
            ["p.yaml:9:11: there is nothing to analyse: the steps hold no acquire."],
        ),
        (
            "  - acquire: {count: 5, every: 1 s}\n  - set_rate: 1 deg/s\n  - acquire: {count: 5, every: 1 s}",
            "{models: [linear]}",
            [
                "p.yaml:11:11: some points have no rate setpoint, so there is no reference to fit to. "
                "Set a rate first.",
            ],
        ),
    ],
)
def test_analyses_that_could_not_be_made(tmp_path: Path, steps: str, analysis: str, problems: list[str]) -> None:
    tail = f"analysis: {analysis}"
    if problems:
        assert mistakes(tmp_path, steps.rstrip("\n"), tail=tail) == problems
    else:
        assert checked(tmp_path, steps, tail=tail).points == 6


@pytest.mark.parametrize(
    "steps",
    [
        "  - set_rate: 5 K\n  - settle: {band: 1 deg/s}\n  - acquire: {count: 5, every: 1 s}",
        "  - set_rate: 5 deg/s\n  - acquire: {cont: 5, every: 1 s}",
        "  - sweep:\n      rate: [1 K]\n      steps: [{settle: {band: 1 deg/s}}, {acquire: {count: 5, every: 1 s}}]",
        "  - sweep:\n      rate: {from: 0 deg/s, to: 5 deg/s, step: 2 deg/s}\n"
        "      steps: [{settle: {band: 1 deg/s}}, {acquire: {count: 5, every: 1 s}}]",
    ],
    ids=["rate", "acquire", "sweep", "range"],
)
def test_one_mistake_does_not_draw_others_after_it(tmp_path: Path, steps: str) -> None:
    """What is missing because of a mistake is not said to be missing."""
    problems = mistakes(tmp_path, steps, tail="analysis: {models: [linear]}")
    assert len({problem.split(": ")[0] for problem in problems}) == 1, problems


@pytest.mark.parametrize(
    ("simulation", "problem"),
    [
        (
            "{sed: 5}",
            "b.yaml:21:14: unknown key 'sed'. Allowed: chamber, duts, faults, rate_table, seed, supply. Did you mean "
            "seed?",
        ),
        ("{seed: x}", "b.yaml:21:20: 'seed': a whole number is expected."),
        ("{duts: {C1: {class: ts_a}}}", "b.yaml:21:21: there is no DUT 'C1'. Allowed: A1, B1."),
        ("{duts: {A1: {class: ts_c}}}", "b.yaml:21:33: unknown gyro class 'ts_c'. Allowed: "),
        (
            "{duts: {A1: {noise: {arw: 5 deg/h}}}}",
            "b.yaml:21:39: 'arw': '5 deg/h' has the unit 'deg/h', which is no unit",
        ),
        ("{chamber: {heating: 2 kW}}", "b.yaml:21:24: unknown key 'heating'."),
        ("{chamber: {probe_lag: 0 s}}", "b.yaml:21:35: probe_lag = 0.0: must be a finite number above 0."),
    ],
)
def test_the_simulation_block(tmp_path: Path, simulation: str, problem: str) -> None:
    found = mistakes(tmp_path, "  - dwell: 1 s", bench=f"{BENCH}simulation: {simulation}\n")
    assert len(found) == 1
    assert found[0].startswith(problem), found
