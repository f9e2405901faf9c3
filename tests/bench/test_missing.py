"""What a run lacks, and the steps that measure it: folds and filters, without a bench."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.missing import Missing, missing_of, steps_for
from bench.procedure.parse import parse_procedure
from bench.procedure.plan import PlannedStep, expand
from bench.replacement import joined, left_to_measure, ranges
from tests.bench.campaigns import write

PROCEDURE = """\
procedure: p
steps:
  - set_rate: 5 deg/s
  - sweep:
      temperature: {from: 0 degC, to: 20 degC, step: 10 K}
      steps:
        - soak: 10 min
        - note: soaked
        - sweep:
            rate: [10 deg/s, 20 deg/s]
            steps:
              - settle: {band: 0.1 deg/s}
              - acquire: {count: 5, every: 1 s}
        - dwell: 1 min
        - acquire: {count: 5, every: 1 s}
  - set_rate: 0 deg/s
"""


def row(point: int, dut: str, verdict: str = "pass", began: float = 0.0) -> dict[str, Any]:
    return {"point": point, "dut": dut, "verdict": verdict, "started_at_s": began}


def planned(tmp_path: Path, text: str = PROCEDURE) -> list[PlannedStep]:
    procedure, problems = parse_procedure(write(tmp_path, "p.yaml", text))
    assert procedure is not None, problems
    plan, problems = expand(procedure.steps)
    assert not problems
    return plan


def in_short(steps: list[PlannedStep]) -> list[str]:
    def text(step: PlannedStep) -> str:
        value = {"set_rate": step.rate_dps, "set_temperature": step.temperature_degc, "acquire": step.point}
        return f"{step.verb} {value[step.verb]:g}" if step.verb in value else step.verb

    return [text(step) for step in steps]


def test_of_a_temperature_with_one_missing_point_only_its_way_there_is_left(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    steps = steps_for(plan, Missing({5: {"A"}}))
    # second temperature, second rate: the table turns on the way as it did; the first rate there is left out
    assert in_short(steps) == [
        *("set_rate 20", "set_temperature 10", "soak", "set_rate 20", "settle", "acquire 5"),
    ]
    assert all(step is plan[step.number - 1] for step in steps)


def test_points_of_one_temperature_share_its_soak(tmp_path: Path) -> None:
    steps = steps_for(planned(tmp_path), Missing({1: {"A"}, 3: {"B"}, 9: {"A", "B"}}))
    assert in_short(steps) == [
        *("set_rate 5", "set_temperature 0", "soak", "set_rate 10", "settle", "acquire 1"),
        *("set_rate 20", "settle", "dwell", "acquire 3"),
        *("set_rate 20", "set_temperature 20", "soak", "set_rate 20", "settle", "dwell", "acquire 9"),
    ]


def test_a_missing_record_is_made_whole(tmp_path: Path) -> None:
    text = PROCEDURE + "  - record:\n      name: long\n      every: 1 s\n      steps:\n        - dwell: 5 min\n"
    plan = planned(tmp_path, text)
    begins = next(step.number for step in plan if step.verb == "record")
    steps = steps_for(plan, Missing(records={begins: {"A"}}))
    assert in_short(steps)[-3:] == ["record", "dwell", "end_record"]
    assert in_short(steps)[:2] == ["set_rate 20", "set_temperature 20"] and "acquire 9" not in in_short(steps)
    assert "record" not in in_short(steps_for(plan, Missing({9: {"A"}})))


@given(st.sets(st.integers(1, 9)))
def test_every_point_asked_for_is_measured_once_under_its_conditions(points: set[int]) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        plan = planned(Path(folder))
    temperature = rate = None
    soaked = settled = False
    measured = []
    for step in steps_for(plan, Missing({point: {"A"} for point in points})):
        if step.verb == "set_temperature":
            temperature, soaked = step.temperature_degc, False
        elif step.verb == "set_rate":
            rate, settled = step.rate_dps, False
        soaked |= step.verb == "soak"
        settled |= step.verb == "settle"
        if step.verb == "acquire":
            measured.append(step.point)
            assert (temperature, rate, soaked, settled) == (step.temperature_degc, step.rate_dps, True, True)
    assert measured == sorted(points)


def test_a_failed_row_is_replaced_and_no_other() -> None:
    rows = [row(1, "A", "fail", 1.0), row(1, "B", began=1.0), row(2, "B", "marginal", 2.0)]
    second = [row(1, "A", "fail", 7.0)]
    third = [row(1, "A", began=8.0), row(2, "A", began=9.0)]
    assert joined([rows]) == rows
    assert [(one["point"], one["dut"], one["started_at_s"]) for one in joined([rows, second, third])] == [
        *((1, "A", 8.0), (1, "B", 1.0), (2, "A", 9.0), (2, "B", 2.0)),
    ]


ROWS = st.lists(st.tuples(st.integers(1, 4), st.sampled_from("AB"), st.sampled_from(["pass", "marginal", "fail"])))


@given(ROWS, ROWS)
def test_nothing_is_left_out_but_failed_points_that_were_measured_anew(
    first: list[tuple[int, str, str]], second: list[tuple[int, str, str]]
) -> None:
    parts = [[row(*one, began=float(number)) for number, one in enumerate(part)] for part in (first, second)]
    folded = joined(parts)
    anew = {(one["point"], one["dut"]) for one in parts[1]}
    for one in parts[0]:
        replaced = one["verdict"] == "fail" and (one["point"], one["dut"]) in anew
        assert any(one is other for other in folded) is not replaced
    # twice measured without need is there twice: nobody shall be able to overlook it
    assert all(any(one is other for other in folded) for one in parts[1])
    assert [one["point"] for one in folded] == sorted(one["point"] for one in folded)


def test_what_is_left_is_listed_by_dut() -> None:
    rows = [row(1, "A"), row(1, "B"), row(2, "A", "fail"), row(2, "B"), row(3, "B"), row(4, "B")]
    left = left_to_measure(rows, ["A", "B"], 4)
    assert left == {"A": {"not_measured": [3, 4], "failed": [2]}}


@pytest.mark.parametrize(
    ("numbers", "text"), [([], ""), ([4], "4"), ([1, 2, 3, 7, 9, 10], "1-3, 7, 9-10"), ([1, 3, 5], "1, 3, 5")]
)
def test_ranges(numbers: list[int], text: str) -> None:
    assert ranges(numbers) == text


def test_records_that_failed_are_missing(tmp_path: Path) -> None:
    text = PROCEDURE + "  - record:\n      name: long\n      every: 1 s\n      steps:\n        - dwell: 5 min\n"
    plan = planned(tmp_path, text)
    begins = next(step.number for step in plan if step.verb == "record")
    entries: list[dict[str, Any]] = [{"kind": "journal", "duts": {"A": {}, "B": {}}}]
    entries += [{"kind": "point", "row": row(point, dut)} for point in range(1, 10) for dut in "AB"]
    about = {"record": begins, "label": "long", "reasons": ""}
    for dut, verdict in (("A", "fail"), ("B", "pass")):
        entries.append({"kind": "series", "about": {**about, "dut": dut, "verdict": verdict}})
    entries.append({"kind": "done", "step": len(plan)})
    missing = missing_of(entries, plan)
    assert missing == Missing({}, {begins: {"A"}})
    assert missing.duts == {"A"} and missing.text == "A: 1 records"
