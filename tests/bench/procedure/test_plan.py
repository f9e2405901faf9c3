"""Sweeps, repeats and includes expanded to a flat plan."""

import random
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import Problem
from bench.procedure import plan as plan_module
from bench.procedure.language import GoToPosition, RampTemperature, SetRate, SetTemperature, Sweep
from bench.procedure.parse import parse_procedure
from bench.procedure.plan import MAX_STEPS, PlannedStep, expand, sweep_values

ROOT = Path(__file__).parents[3]


def plan_of(path: Path) -> tuple[list[PlannedStep], list[Problem]]:
    procedure, problems = parse_procedure(path)
    assert procedure is not None
    assert problems == []
    return expand(procedure.steps)


def planned(folder: Path, steps: str) -> list[PlannedStep]:
    path = folder / "p.yaml"
    path.write_text(f"procedure: x\nsteps:\n{steps}")
    plan, problems = plan_of(path)
    assert problems == []
    return plan


def refused(folder: Path, steps: str) -> list[str]:
    path = folder / "p.yaml"
    path.write_text(f"procedure: x\nsteps:\n{steps}")
    return [str(problem).replace(str(path), "p.yaml") for problem in plan_of(path)[1]]


def sweep(**arguments: Any) -> Sweep:
    return Sweep.model_validate({"steps": [{"dwell": "1 s"}], **arguments})


def rates(start: str, end: str, step: str, **more: Any) -> list[float]:
    units = {"from": f"{start} deg/s", "to": f"{end} deg/s", "step": f"{step} deg/s"}
    return sweep_values(sweep(rate=units | more))


DECIMALS = st.decimals(min_value=-200, max_value=200, allow_nan=False, places=3)


@given(DECIMALS, st.decimals(min_value="0.001", max_value=50, places=3), st.integers(0, 400))
def test_the_values_of_a_range_are_those_of_decimal_arithmetic(start: Decimal, step: Decimal, count: int) -> None:
    values = rates(str(start), str(start + count * step), str(step))
    assert values == [float(start + k * step) for k in range(count + 1)]
    assert not any(str(value) == "-0.0" for value in values)


@given(DECIMALS, st.decimals(min_value="0.01", max_value=50, places=2), st.integers(0, 50), st.integers(1, 99))
def test_a_step_that_does_not_end_on_the_end_is_refused(start: Decimal, step: Decimal, count: int, part: int) -> None:
    last = start + count * step
    end = last + step * part / 100
    with pytest.raises(ValueError, match="do not end on") as caught:
        rates(str(start), str(end), str(step))
    message = str(caught.value)
    assert f"they reach {float(last):.9g}, then {float(last + step):.9g}." in message
    # The advice is good.
    advised = message.rpartition("to: ")[2].removesuffix(" deg/s")
    assert rates(str(start), advised, str(step))[-1] == float(last)


@pytest.mark.parametrize(
    ("arguments", "values"),
    [
        ({"temperature": {"from": "-30 degC", "to": "60 degC", "step": "5 K"}}, [-30.0 + 5 * k for k in range(19)]),
        ({"temperature": ["60 degC", "-30 degC"]}, [60.0, -30.0]),
        ({"position": {"from": "0 deg", "to": "270 deg", "step": "90 deg"}}, [0.0, 90.0, 180.0, 270.0]),
        ({"position": ["1 rad"]}, [57.29577951308232]),
        (
            {"rate": {"from": "-0.3 deg/s", "to": "0.3 deg/s", "step": "0.1 deg/s"}},
            [-0.3, -0.2, -0.1, 0, 0.1, 0.2, 0.3],
        ),
        ({"rate": {"from": "0 deg/h", "to": "36 deg/h", "step": "18 deg/h"}}, [0.0, 0.005, 0.01]),
        ({"rate": {"from": "5 deg/s", "to": "5 deg/s", "step": "1 deg/s"}}, [5.0]),
        ({"rate": ["3 deg/s", "1 deg/s", "3 deg/s"]}, [3.0, 1.0, 3.0]),
    ],
)
def test_values(arguments: dict[str, Any], values: list[float]) -> None:
    assert sweep_values(sweep(**arguments)) == values


def test_values_may_be_left_out() -> None:
    assert rates("-1", "1", "0.5", without=["0 deg/s", "-1 deg/s"]) == [-0.5, 0.5, 1.0]
    assert rates("0", "0.3", "0.1", without=["0.3 deg/s"]) == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"temperature": {"from": "60 degC", "to": "-30 degC", "step": "5 K"}}, ["60 degC", "-30 degC", "order: down"]),
        (
            {"temperature": {"from": "-30 degC", "to": "60 degC", "step": "20 K"}},
            ["steps of 20 K", "from -30 degC", "60 degC", "reach 50, then 70", "divides 90 K", "to: 50 degC"],
        ),
        ({"rate": {"from": "0 deg/s", "to": "5 deg/s", "step": "10 deg/s"}}, ["reach 0, then 10"]),
        ({"rate": {"from": "0 deg/s", "to": "5 deg/s", "step": "1e-6 deg/s"}}, ["more than 500000 values"]),
        ({"rate": {"from": "0 deg/s", "to": "1 deg/s", "step": "1e-320 deg/s"}}, ["more than 500000 values"]),
        ({"rate": {"from": "-1e308 deg/s", "to": "1e308 deg/s", "step": "1 deg/s"}}, ["more than 500000 values"]),
        ({"rate": []}, ["empty"]),
        (
            {"rate": {"from": "0 deg/s", "to": "2 deg/s", "step": "1 deg/s", "without": ["0.5 deg/s"]}},
            ["'without' names 0.5", "does not visit"],
        ),
        (
            {"rate": {"from": "0 deg/s", "to": "1 deg/s", "step": "1 deg/s", "without": ["0 deg/s", "1 deg/s"]}},
            ["leaves no value"],
        ),
    ],
)
def test_malformed_ranges(arguments: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        sweep_values(sweep(**arguments))
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_long_lists_of_values_left_out_do_not_stall() -> None:
    without = [f"{k} deg/s" for k in range(1, 60_000)]
    assert rates("0", "60000", "1", without=without) == [0.0, 60000.0]


def visited(plan: list[PlannedStep]) -> list[float | None]:
    return [step.rate_dps for step in plan if step.verb == "set_rate"]


NESTED = """\
  - sweep:
      temperature: [10 degC, 20 degC, 30 degC]
      steps:
        - sweep:
            rate: [2 deg/s, -1 deg/s, 3 deg/s]
            {order}
            steps: [{{dwell: 1 s}}]
"""


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ("", [2, -1, 3] * 3),
        ("order: up", [-1, 2, 3] * 3),
        ("order: down", [3, 2, -1] * 3),
        ("order: alternate", [-1, 2, 3, 3, 2, -1, -1, 2, 3]),
    ],
)
def test_order_of_a_sweep_entered_again(tmp_path: Path, order: str, expected: list[float]) -> None:
    assert visited(planned(tmp_path, NESTED.format(order=order))) == expected


def test_two_sweeps_alternate_each_for_itself(tmp_path: Path) -> None:
    one = "{sweep: {rate: [1 deg/s, 2 deg/s], order: alternate, steps: [{dwell: 1 s}]}}"
    steps = f"  - repeat: {{times: 2, steps: [{one}, {one.replace('1 deg', '5 deg')}]}}"
    assert visited(planned(tmp_path, steps)) == [1, 2, 2, 5, 2, 1, 5, 2]


class TestRandomOrder:
    STEPS = """\
  - repeat:
      times: 3
      steps:
        - sweep:
            rate: {{from: -180 deg/s, to: 180 deg/s, step: 10 deg/s}}
            order: random
            seed: {seed}
            steps: [{{dwell: 1 s}}]
"""

    def visits(self, folder: Path, seed: int) -> list[list[float | None]]:
        values = visited(planned(folder, self.STEPS.format(seed=seed)))
        return [values[start : start + 37] for start in range(0, 111, 37)]

    def test_every_visit_is_a_permutation_of_its_own(self, tmp_path: Path) -> None:
        visits = self.visits(tmp_path, 7)
        everything = [-180.0 + 10 * k for k in range(37)]
        assert all(sorted(filter(lambda v: v is not None, visit)) == everything for visit in visits)  # type: ignore[type-var]
        assert len({tuple(visit) for visit in visits}) == 3

    def test_the_same_seed_is_the_same_order_on_every_machine(self, tmp_path: Path) -> None:
        assert self.visits(tmp_path, 7) == self.visits(tmp_path, 7)
        assert self.visits(tmp_path, 7) != self.visits(tmp_path, 8)
        # Python promises that random() of a text seed never changes; shuffle is built on it.
        expected = [-180.0 + 10 * k for k in range(37)]
        random.Random("7/0").shuffle(expected)
        assert self.visits(tmp_path, 7)[0] == expected


def test_conditions_dwells_and_points(tmp_path: Path) -> None:
    plan = planned(
        tmp_path,
        """\
  - acquire: {count: 1, every: 1 s}
  - set_rate: 5 deg/s
  - sweep:
      temperature: [10 degC, 20 degC]
      ramp: 1 degC/min
      band: 0.2 K
      timeout: 2 h
      steps:
        - repeat:
            times: 2
            steps:
              - acquire: {count: 1, every: 1 s}
        - go_to_position: 90 deg
        - acquire: {count: 1, every: 1 s}
  - set_temperature: {to: 25 degC, band: 1 K}
  - note: end
""",
    )
    summary = [(s.number, s.verb, s.dwell, s.temperature_degc, s.rate_dps, s.point) for s in plan]
    assert summary == [
        (1, "acquire", 0, None, None, 1),
        (2, "set_rate", 0, None, 5.0, None),
        (3, "ramp_temperature", 1, 10.0, 5.0, None),
        (4, "acquire", 1, 10.0, 5.0, 2),
        (5, "acquire", 1, 10.0, 5.0, 3),
        (6, "go_to_position", 1, 10.0, 0.0, None),
        (7, "acquire", 1, 10.0, 0.0, 4),
        (8, "ramp_temperature", 2, 20.0, 0.0, None),
        (9, "acquire", 2, 20.0, 0.0, 5),
        (10, "acquire", 2, 20.0, 0.0, 6),
        (11, "go_to_position", 2, 20.0, 0.0, None),
        (12, "acquire", 2, 20.0, 0.0, 7),
        (13, "set_temperature", 3, 25.0, 0.0, None),
        (14, "note", 3, 25.0, 0.0, None),
    ]
    ramp = plan[2].args
    assert isinstance(ramp, RampTemperature)
    assert (ramp.to_degc, ramp.rate_degc_min, ramp.band_k, ramp.timeout_s) == (10.0, 1.0, 0.2, 7200.0)
    assert plan[2].mark.line == 5
    last = plan[12].args
    assert isinstance(last, SetTemperature)
    assert last.band_k == 1.0


def test_a_temperature_sweep_without_a_ramp_moves_at_once(tmp_path: Path) -> None:
    plan = planned(tmp_path, "  - sweep: {temperature: [5 degC], band: 0.3 K, steps: [{dwell: 1 s}]}")
    assert plan[0].verb == "set_temperature"
    assert isinstance(plan[0].args, SetTemperature)
    assert plan[0].args.model_dump() == {"to_degc": 5.0, "band_k": 0.3, "timeout_s": 21600.0}


def test_position_and_rate_sweeps_make_whole_steps(tmp_path: Path) -> None:
    """What a sweep makes is what the same step written by hand would be."""
    plan = planned(
        tmp_path,
        "  - sweep: {position: [90 deg], steps: [{dwell: 1 s}]}\n"
        "  - go_to_position: 90 deg\n"
        "  - sweep: {rate: [5 deg/s], steps: [{dwell: 1 s}]}\n"
        "  - set_rate: 5 deg/s\n",
    )
    assert isinstance(plan[0].args, GoToPosition)
    assert plan[0].args == plan[2].args
    assert isinstance(plan[3].args, SetRate)
    assert plan[3].args == plan[5].args


def test_the_reference_campaign_has_703_points_in_order() -> None:
    plan, problems = plan_of(ROOT / "procedures" / "temperature_rate_grid.yaml")
    assert problems == []
    points = [step for step in plan if step.point]
    assert [step.point for step in points] == list(range(1, 704))
    expected = [(-30.0 + 5 * t, -180.0 + 10 * r, t + 1) for t in range(19) for r in range(37)]
    assert [(step.temperature_degc, step.rate_dps, step.dwell) for step in points] == expected
    assert sum(step.verb == "soak" for step in plan) == 19
    assert [step.number for step in plan] == list(range(1, len(plan) + 1))


def test_the_papers_campaign_has_648_points() -> None:
    plan, _ = plan_of(ROOT / "procedures" / "temperature_rate_grid_648.yaml")
    points = [step for step in plan if step.point]
    assert len(points) == 648
    assert {step.temperature_degc for step in points} == {-30.0 + 5 * k for k in range(18)}
    assert {step.rate_dps for step in points} == {-180.0 + 10 * k for k in range(37)} - {0.0}


def test_a_malformed_sweep_is_one_mistake_however_often_it_is_entered(tmp_path: Path) -> None:
    steps = """\
  - repeat:
      times: 1000
      steps:
        - sweep:
            rate: {from: 0 deg/s, to: 5 deg/s, step: 2 deg/s}
            steps: [{dwell: 1 s}]
        - sweep:
            rate: []
            steps: [{dwell: 1 s}]
"""
    problems = refused(tmp_path, steps)
    assert [problem.split(" ")[0] for problem in problems] == ["p.yaml:6:11:", "p.yaml:9:11:"]


NOTHING = "{repeat: {times: 1000000, steps: [%s]}}"


@pytest.mark.parametrize(
    "steps",
    [
        NOTHING % (NOTHING % "{dwell: 1 s}"),
        NOTHING % (NOTHING % (NOTHING % "{sweep: {rate: [], steps: [{dwell: 1 s}]}}")),
        "{sweep: {rate: {from: 0 deg/s, to: 4000 deg/s, step: 1 deg/s}, steps: [{dwell: 1 s}]}}",
    ],
    ids=["too many steps", "repeats of nothing", "too many values"],
)
def test_a_plan_that_would_not_end_is_refused(tmp_path: Path, steps: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert MAX_STEPS == 500_000
    monkeypatch.setattr(plan_module, "MAX_STEPS", 5000)
    last = refused(tmp_path, f"  - {steps}")[-1]
    assert "p.yaml:3:6: the procedure has more than 5000 steps" in last
    assert "nested as meant?" in last


def test_a_record_marks_its_steps_and_gets_a_label_of_its_own(tmp_path: Path) -> None:
    steps = """\
  - go_to_position: 90 deg
  - repeat:
      times: 2
      steps:
        - record: {name: a, every: 1 s, steps: [{dwell: 1 s}]}
  - record: {name: a-2, every: 1 s, steps: [{note: x}]}
"""
    plan = planned(tmp_path, steps)
    records = [step for step in plan if step.verb == "record"]
    assert [step.record for step in records] == ["a", "a-2", "a-2-2"]
    assert [(step.verb, step.record_step) for step in plan[1:4]] == [("record", 2), ("dwell", 2), ("end_record", 2)]
    assert plan[0].record is None and plan[2].position_deg == 90.0
