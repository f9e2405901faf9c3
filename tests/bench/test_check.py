"""`check`: what fits, what it will take, and every way in which a procedure and a bench do not fit each other."""

from pathlib import Path

import pytest

from bench import check as check_module
from bench.check import check, estimate_duration_s
from bench.errors import InvalidFiles
from bench.overrides import parse_overrides
from tests.bench.checking import BENCH, PROCEDURE, checked, mistakes

ROOT = Path(__file__).parents[2]
VIRTUAL, LAB = ROOT / "benches" / "virtual.yaml", ROOT / "benches" / "lab_example.yaml"


@pytest.mark.parametrize("bench", [VIRTUAL, LAB], ids=["virtual", "lab"])
@pytest.mark.parametrize(
    ("name", "points", "hours"),
    # Soaks of 2 h; points of 600 s and 2 s of settling; 90 or 85 K at 1 K/min after the 55 K from room temperature.
    [
        ("temperature_rate_grid", 703, (19 * 7200 + 703 * 602 + (90 + 55) * 60) / 3600),
        ("temperature_rate_grid_648", 648, (18 * 7200 + 648 * 602 + (85 + 55) * 60) / 3600),
        ("smoke", 3, (5 + 3 * 21) / 3600),
    ],
)
def test_the_procedures_of_the_house_fit_its_benches(name: str, points: int, hours: float, bench: Path) -> None:
    result = check(ROOT / "procedures" / f"{name}.yaml", bench)
    assert result.points == points
    assert result.duration_s / 3600 == pytest.approx(hours, rel=1e-9)
    assert result.head.procedure == name


def test_duration_is_the_sum_of_what_is_stated(tmp_path: Path) -> None:
    steps = """\
  - set_temperature: 35 degC
  - ramp_temperature: {to: 30 degC, rate: 0.5 degC/min}
  - ramp_temperature: {to: 40 degC, rate: 1 degC/min}
  - soak: {for: 1 h, until: {slope: 0.02 degC/min}, timeout: 6 h}
  - set_rate: 5 deg/s
  - settle: {band: 1 deg/s, for: 3 s}
  - acquire: {count: 100, every: 0.5 s}
  - dwell: 7 s
  - go_to_position: 90 deg
"""
    result = checked(tmp_path, steps)
    assert result.duration_s == pytest.approx(600 + 600 + 3600 + 3 + 50 + 7)
    assert estimate_duration_s([]) == 0.0
    assert estimate_duration_s(result.plan[:2]) == pytest.approx(600)


def test_a_first_ramp_begins_at_room_temperature(tmp_path: Path) -> None:
    result = checked(tmp_path, "  - ramp_temperature: {to: -30 degC, rate: 1 degC/min}")
    assert result.duration_s == pytest.approx((25 + 30) * 60)


@pytest.mark.parametrize(
    ("raw", "per_point"),
    # 10 s: 1000 frames of A1 and 500 of B1, or 20 samples of each.
    [("frames", 1500 * check_module.BYTES_PER_FRAME), ("samples", 40 * check_module.BYTES_PER_SAMPLE), ("none", 0.0)],
)
def test_room_on_the_disk(tmp_path: Path, raw: str, per_point: float) -> None:
    head = PROCEDURE.replace("procedure: x", f"procedure: x\nraw: {raw}")
    result = checked(tmp_path, "  - repeat: {times: 6, steps: [{acquire: {count: 20, every: 0.5 s}}]}", head)
    assert result.disk_bytes == pytest.approx(6 * (per_point + check_module.BYTES_PER_STEP))


@pytest.mark.parametrize(
    ("step", "problems"),
    [
        ("set_temperature: 60 degC", []),
        ("set_temperature: -30 degC", []),
        ("set_temperature: 61 degC", ["61 degC is outside the procedure's own limits: -30 to 60 degC."]),
        (
            "set_temperature: 75 degC",
            [
                "75 degC is outside DUT A1: -40 to 70 degC.",
                "75 degC is outside the procedure's own limits: -30 to 60 degC.",
            ],
        ),
        (
            "set_temperature: -61 degC",
            [
                "-61 degC is outside DUT A1: -40 to 70 degC.",
                "-61 degC is outside the chamber: -60 to 90 degC.",
                "-61 degC is outside the procedure's own limits: -30 to 60 degC.",
            ],
        ),
        ("set_rate: -180 deg/s", []),
        ("set_rate: 180.0005 deg/s", ["180.0005 deg/s is above the procedure's own limit, ± 180 deg/s."]),
        (
            "set_rate: -500 deg/s",
            [
                "-500 deg/s is above the full scale of DUT A1, ± 200 deg/s.",
                "-500 deg/s is above the full scale of DUT B1, ± 300 deg/s.",
                "-500 deg/s is above the procedure's own limit, ± 180 deg/s.",
                "-500 deg/s is above the rate table's limit, ± 400 deg/s.",
            ],
        ),
        ("ramp_temperature: {to: 0 degC, rate: 1 degC/min}", []),
        (
            "ramp_temperature: {to: 0 degC, rate: 5 degC/min}",
            [
                "a ramp of 5 degC/min is above the limit of the chamber, 4 degC/min.",
                "a ramp of 5 degC/min is above the limit of the procedure, 1 degC/min.",
            ],
        ),
        ("acquire: {count: 5, every: 20 ms}", []),
        ("acquire: {count: 5, every: 19 ms}", ["a sample every 0.019 s is faster than the 50 Hz of DUT B1."]),
    ],
)
def test_limits_of_procedure_chamber_table_and_duts(tmp_path: Path, step: str, problems: list[str]) -> None:
    if problems:
        verb = step.split(":")[0]
        assert mistakes(tmp_path, f"  - {step}") == [f"p.yaml:8:5: '{verb}': {problem}" for problem in problems]
    else:
        assert len(checked(tmp_path, f"  - {step}").plan) == 1


def test_points_that_would_not_fit_into_memory(tmp_path: Path) -> None:
    head = PROCEDURE.replace("  duration: 10 h\n", "")
    problems = mistakes(tmp_path, "  - acquire: {for: 7 d, every: 1 s}", head)
    assert len(problems) == 1
    assert "6.05e+07 frames of DUT A1 in one point" in problems[0]
    assert "Split it with repeat" in problems[0]


def test_a_sweep_beyond_a_limit_is_one_mistake_for_each_end(tmp_path: Path) -> None:
    steps = """\
  - repeat:
      times: 3
      steps:
        - sweep:
            temperature: {from: -50 degC, to: 75 degC, step: 5 K}
            steps: [{dwell: 1 s}]
        - sweep:
            rate: {from: -190 deg/s, to: 190 deg/s, step: 10 deg/s}
            steps: [{dwell: 1 s}]
"""
    assert mistakes(tmp_path, steps) == [
        "p.yaml:11:11: 'set_temperature': -50 degC is outside DUT A1: -40 to 70 degC. So is 1 more of the "
        "values visited here.",
        "p.yaml:11:11: 'set_temperature': -50 degC is outside the procedure's own limits: -30 to 60 degC. So are 3 "
        "more of the values visited here.",
        "p.yaml:11:11: 'set_temperature': 75 degC is outside DUT A1: -40 to 70 degC.",
        "p.yaml:11:11: 'set_temperature': 75 degC is outside the procedure's own limits: -30 to 60 degC. So are 2 "
        "more of the values visited here.",
        "p.yaml:14:11: 'set_rate': -190 deg/s is above the procedure's own limit, ± 180 deg/s. So is 1 more of "
        "the values visited here.",
    ]


def test_a_bench_that_lacks_what_a_step_needs(tmp_path: Path) -> None:
    bare = BENCH[: BENCH.index("chamber")] + BENCH[BENCH.index("duts") :]
    steps = """\
  - set_temperature: 20 degC
  - set_rate: 5 deg/s
  - settle: {band: 1 deg/s}
  - go_to_position: 5 deg
  - acquire: {count: 5, every: 1 s}
"""
    problems = mistakes(tmp_path, steps, bench=bare)
    assert [problem.split(". ")[0] for problem in problems] == [
        "p.yaml:8:5: 'set_temperature': this bench has no chamber",
        "p.yaml:9:5: 'set_rate': this bench has no rate table",
        "p.yaml:10:5: 'settle': this bench has no rate table",
        "p.yaml:11:5: 'go_to_position': this bench has no rate table",
    ]


def test_settling_to_no_rate(tmp_path: Path) -> None:
    (problem,) = mistakes(tmp_path, "  - settle: {band: 1 deg/s}\n  - set_rate: 5 deg/s\n  - settle: {band: 1 deg/s}")
    assert problem == ("p.yaml:8:5: 'settle': no rate was set before it. Put a set_rate or a rate sweep around it.")


def test_a_procedure_that_takes_too_long(tmp_path: Path) -> None:
    (problem,) = mistakes(tmp_path, "  - repeat: {times: 5, steps: [{soak: 2.5 h}]}")
    assert problem == "p.yaml:6:13: the procedure takes about 12 h 30 min, its limit is 10 h."
    (problem,) = mistakes(tmp_path, "  - repeat: {times: 9, steps: [{soak: 1e308 s}]}")
    assert "takes about inf s" in problem


@pytest.mark.parametrize(
    ("safe", "problems"),
    [
        ("{action: hold, temperature: 200 degC}", []),
        ("{action: go_to}", []),
        ("{action: go_to, temperature: 70 degC, rate: 4 degC/min}", []),
        (
            "{action: go_to, temperature: 80 degC}",
            ["b.yaml:6:38: the safe state: 80 degC is outside DUT A1: -40 to 70 degC."],
        ),
        (
            "{action: go_to, temperature: 95 degC, rate: 5 degC/min}",
            [
                "b.yaml:6:38: the safe state: 95 degC is outside DUT A1: -40 to 70 degC.",
                "b.yaml:6:38: the safe state: 95 degC is outside the chamber: -60 to 90 degC.",
                "b.yaml:6:53: the safe state: a ramp of 5 degC/min is above the limit of the chamber, 4 degC/min.",
            ],
        ),
    ],
)
def test_a_safe_state_must_be_safe(tmp_path: Path, safe: str, problems: list[str]) -> None:
    bench = BENCH.replace("rate_table:", f"  safe: {safe}\nrate_table:", 1)
    if problems:
        assert mistakes(tmp_path, "  - dwell: 1 s", bench=bench) == problems
    else:
        assert checked(tmp_path, "  - dwell: 1 s", bench=bench).plan


def test_both_files_at_once_and_changed_by_overrides(tmp_path: Path) -> None:
    checked(tmp_path, "  - set_rate: 5 deg/s")
    overrides = parse_overrides(["procedure.steps.0.set_rate=190 deg/s", "bench.duts.A1.limits.rate=100 deg/s"])
    with pytest.raises(InvalidFiles) as caught:
        check(tmp_path / "p.yaml", tmp_path / "b.yaml", overrides)
    messages = [problem.message for problem in caught.value.problems]
    assert messages == [
        "'set_rate': 190 deg/s is above the full scale of DUT A1, ± 100 deg/s.",
        "'set_rate': 190 deg/s is above the procedure's own limit, ± 180 deg/s.",
    ]


def test_files_that_are_not_there_are_both_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidFiles) as caught:
        check(tmp_path / "p.yaml", tmp_path / "b.yaml")
    assert [Path(problem.mark.file).name for problem in caught.value.problems] == ["b.yaml", "p.yaml"]


def test_check_touches_no_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    def opened(*_: object, **__: object) -> None:
        raise AssertionError("check opened a port")

    monkeypatch.setattr(serial, "serial_for_url", opened)
    monkeypatch.setattr("can.Bus", opened)
    assert check(ROOT / "procedures" / "smoke.yaml", LAB).points == 3
