"""A plan and its times as phases."""

from bench.errors import Mark
from bench.procedure.language import Note
from bench.procedure.plan import PlannedStep
from bench.timeline import Phase, phases


def plan(*steps: tuple[str, float | None, int | None]) -> list[PlannedStep]:
    return [
        PlannedStep(number, verb, Note(text="x"), Mark("p", number, 1), 0, degc, None, point)
        for number, (verb, degc, point) in enumerate(steps, 1)
    ]


STEPS = plan(
    ("set_rate", None, None),
    ("ramp_temperature", -30.0, None),
    ("soak", -30.0, None),
    ("set_rate", -30.0, None),
    ("settle", -30.0, None),
    ("acquire", -30.0, 1),
    ("set_rate", -30.0, None),
    ("acquire", -30.0, 2),
    ("set_temperature", -25.0, None),
    ("soak", -25.0, None),
    ("dwell", -25.0, None),
    ("dwell", -25.0, None),
    ("note", -25.0, None),
)
ENDS = [1.0, 101.0, 7301.0, 7302.0, 7310.0, 7910.0, 7911.0, 8511.0, 8600.0, 15800.0, 15900.0, 16000.0, 16000.0]


def test_consecutive_steps_of_a_kind_are_one_phase() -> None:
    assert phases(STEPS, ENDS) == [
        Phase(0.0, 1.0, None, "measure", 0),
        Phase(1.0, 101.0, -30.0, "ramp", 0),
        Phase(101.0, 7301.0, -30.0, "soak", 0),
        Phase(7301.0, 8511.0, -30.0, "measure", 2),
        Phase(8511.0, 8600.0, -25.0, "ramp", 0),
        Phase(8600.0, 15800.0, -25.0, "soak", 0),
        Phase(15800.0, 16000.0, -25.0, "dwell", 0),
        Phase(16000.0, 16000.0, -25.0, "note", 0),
    ]


def test_phases_follow_each_other_without_a_gap_and_keep_every_point() -> None:
    for count in range(len(STEPS) + 1):
        found = phases(STEPS, ENDS[:count])
        assert [phase.began_s for phase in found] == [0.0, *(phase.ended_s for phase in found)][: len(found)]
        assert sum(phase.points for phase in found) == sum(step.point is not None for step in STEPS[:count])
        assert not found or found[-1].ended_s == ENDS[count - 1]


def test_the_same_kind_at_another_temperature_is_another_phase() -> None:
    steps = plan(("set_temperature", 5.0, None), ("set_temperature", 6.0, None))
    assert [phase.temperature_degc for phase in phases(steps, [1.0, 2.0])] == [5.0, 6.0]


def test_a_row_for_people_and_a_mapping_for_programs() -> None:
    assert Phase(7301.0, 93600.0, -30.0, "measure", 37).row() == ["2 h 1 min", "1 d 2 h", "-30 degC", "measure", "37"]
    assert Phase(0.0, 1.0, None, "note", 0).row() == ["0 s", "1 s", "–", "note", "–"]
    assert Phase(0.0, 1.0, None, "note", 0).as_dict() == {
        "began_s": 0.0,
        "ended_s": 1.0,
        "temperature_degc": None,
        "kind": "note",
        "points": 0,
    }


def test_a_ramp_that_was_not_followed_and_a_soak_drawn_out_are_remarked() -> None:
    from bench.errors import Mark
    from bench.procedure.language import RampTemperature, Soak
    from bench.timeline import remarks

    ramp = RampTemperature.model_validate({"to": "-35 degC", "rate": "1 degC/min"})
    soak = Soak.model_validate({"for": "1 h", "until": {"slope": "0.1 degC/min"}, "timeout": "9 h"})
    plan = [
        PlannedStep(1, "ramp_temperature", ramp, Mark("p.yaml", 3, 5), 1, -35.0, None),
        PlannedStep(2, "soak", soak, Mark("p.yaml", 4, 5), 1, -35.0, None),
    ]
    assert remarks(plan, [3600.0 + 599.0, 3600.0 + 599.0 + 3600.0]) == []
    late, drawn_out = remarks(plan, [2 * 3600.0, 5 * 3600.0])
    assert late.startswith("p.yaml:3:5: the ramp to -35 degC took 2 h; at 1 degC/min it is 1 h.")
    assert drawn_out.startswith("p.yaml:4:5: the soak at -35 degC took 3 h instead of 1 h")
