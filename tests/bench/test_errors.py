"""Exit codes, the order of mistakes, and the hint for a misspelt word."""

from bench.errors import BenchFailure, ExitCode, Interrupted, InvalidFiles, Mark, Problem, UserMistake, did_you_mean


def test_exit_codes_are_those_of_the_documentation() -> None:
    assert {code.name: int(code) for code in ExitCode} == {
        "PASSED": 0,
        "FAILED": 1,
        "USER_MISTAKE": 2,
        "BENCH_FAILED": 3,
        "INTERRUPTED": 130,
    }
    assert [error.exit_code for error in (UserMistake, InvalidFiles, BenchFailure, Interrupted)] == [2, 2, 3, 130]


def test_mistakes_come_in_file_order_and_once() -> None:
    late, early = Problem(Mark("a.yaml", 12, 3), "late"), Problem(Mark("a.yaml", 2, 40), "early")
    other = Problem(Mark("b.yaml", 1, 1), "other file")
    error = InvalidFiles([late, other, early, late])
    assert error.problems == [early, late, other]
    assert str(error) == "a.yaml:2:40: early\na.yaml:12:3: late\nb.yaml:1:1: other file"


def test_a_mark_without_a_line_is_the_file_alone() -> None:
    assert str(Mark("--set bench.x=1")) == "--set bench.x=1"
    assert str(Mark("p.yaml", 3, 7)) == "p.yaml:3:7"


def test_hint_names_what_is_allowed_and_the_nearest() -> None:
    assert did_you_mean("timout", ["timeout", "band", "for"]) == " Allowed: band, for, timeout. Did you mean timeout?"
    assert did_you_mean("zzz", ["timeout", "band"]) == " Allowed: band, timeout."
    assert did_you_mean("x", []) == ""
