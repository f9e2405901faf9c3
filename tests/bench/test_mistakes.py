"""Pydantic's errors as mistakes: one mistake gives one message, in words of the file, at its place."""

import pytest

from bench.bench_entries import BenchFile, CanPort, DutLimits
from bench.errors import Problem
from bench.fields import YamlMapping, validate
from bench.mistakes import model_at, sentence, suffix_at
from bench.procedure.language import ProcedureHead, RateRange, Sweep
from bench.yamlfile import parse_yaml


def mistakes(model: type[YamlMapping], text: str) -> list[str]:
    problems: list[Problem] = []
    assert validate(model, parse_yaml(text, "f"), (), problems) is None
    return [str(problem) for problem in sorted(problems)]


SWEEP = "steps: [x]\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rate: {from: 1 deg/s, step: 1 deg/s}", ["f:2:1: the key 'to' is missing here. Example: to: 10 deg/s"]),
        ("temperature: {to: 1 degC, step: 1 K}", ["f:2:1: the key 'from' is missing here. Example: from: -30 degC"]),
        (
            "rate: {from: 1 deg/s, to: 2 deg/s, stp: 1 deg/s}",
            [
                "f:2:1: the key 'step' is missing here. Example: step: 10 deg/s",
                "f:2:36: unknown key 'stp'. Allowed: from, step, to, without. Did you mean step?",
            ],
        ),
        (
            "rate: [1 deg/s, 2 K, 3]",
            [
                "f:2:17: 'rate': '2 K' has the unit 'K', which is no unit of angular rate. Allowed for angular rate: a "
                "number with a unit out of deg/s, deg/min, deg/h, rad/s, e.g. '10 deg/s'.",
                "f:2:22: 'rate': 3 has no unit. Allowed for angular rate: a number with a unit out of deg/s, deg/min, "
                "deg/h, rad/s, e.g. '10 deg/s'.",
            ],
        ),
        (
            "rate: {from: 1 deg/s, to: 2 deg/s, step: 1 deg/s, without: [x]}",
            [
                "f:2:61: 'without': 'x' is not a finite number with a unit. Allowed for angular rate: a number with a "
                "unit out of deg/s, deg/min, deg/h, rad/s, e.g. '10 deg/s'.",
            ],
        ),
        (
            "rate: 5 deg/s",
            [
                "f:2:7: 'rate': expected a list (its items start with '- ') or a mapping with the keys from, to, step, "
                "without, not '5 deg/s'.",
            ],
        ),
        (
            "rate: {from: 1 deg/s, to: 2 deg/s, step: 0 deg/s}",
            ["f:2:42: 'step': must be above 0 deg/s, not '0 deg/s'."],
        ),
        ("rate: [1 deg/s]\nseed: 1.5", ["f:3:7: 'seed': expected a whole number, not 1.5."]),
        (
            "rate: [1 deg/s]\nposition: [1 deg]",
            ["f:1:1: a sweep needs exactly one of 'temperature', 'rate' or 'position'."],
        ),
    ],
)
def test_alternatives_are_judged_by_the_one_that_was_meant(text: str, expected: list[str]) -> None:
    assert mistakes(Sweep, SWEEP + text) == expected


BENCH = "bench: b\nduts:\n  A1:\n    driver: x\n    port: {port}\n    limits: {limits}\n"


@pytest.mark.parametrize(
    ("port", "limits", "expected"),
    [
        ("{interface: socketcan}", "{rate: 1 deg/s}", ["f:5:5: the key 'channel' is missing here."]),
        (
            "5",
            "{rate: 1 deg/s}",
            ["f:5:11: 'port': expected text or a mapping with the keys interface, channel, bitrate, not 5."],
        ),
        (
            "x",
            "{rat: 1 deg/s}",
            [
                "f:6:5: the key 'rate' is missing here. Example: rate: 10 deg/s",
                "f:6:14: unknown key 'rat'. Allowed: rate, temperature. Did you mean rate?",
            ],
        ),
        ("x", "{rate: -1 deg/s}", ["f:6:20: 'rate': must be above 0 deg/s, not '-1 deg/s'."]),
        (
            "x",
            "{rate: 1 deg/s, temperature: {from: 5 degC, to: 1 degC}}",
            ["f:6:42: 'from' is above 'to'; write the lower temperature first."],
        ),
    ],
)
def test_entries_by_serial_number(port: str, limits: str, expected: list[str]) -> None:
    assert mistakes(BenchFile, BENCH.format(port=port, limits=limits)) == expected


def test_a_serial_number_that_is_no_name() -> None:
    text = BENCH.replace("A1", "'A 1'").format(port="x", limits="{rate: 1 deg/s}")
    (problem,) = mistakes(BenchFile, text)
    assert problem.startswith("f:3:3: 'A 1' cannot be a name. Allowed: letters, digits, '.', '_' and '-'")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("procedure: 5", "'procedure': expected text, not 5."),
        ("procedure: ../x", "'procedure': '../x' cannot be a name. Allowed: letters, digits"),
        ("quality: {fail_at: 0.5}", "'fail_at': must be at least 1, not 0.5."),
        ("quality: {lost: 3}", "'lost': 3 has no unit. Allowed for ratio"),
        ("limits: {rate: -5 deg/s}", "'rate': must be above 0 deg/s, not '-5 deg/s'."),
        ("analysis: {models: []}", "'models': must not be empty."),
        (
            "analysis: {models: [x], inputs: [speed, rate]}",
            "'inputs': 'speed' is not allowed. Allowed: chamber_temperature, dut_temperature, rate.",
        ),
        ("analysis: {models: [x], inputs: [rate]}", "'inputs': has fewer than 2 items."),
        ("analysis: {models: [x], inputs: [rate, rate, rate]}", "'inputs': has more than 2 items."),
        ("analysis: {models: [x], inputs: [rate, dut_temperature]}", "'inputs' are a temperature and the rate"),
        (
            "analysis: {models: [x], splits: {leave_temperatures_out: {folds: 1}}}",
            "'folds': must be at least 2, not 1.",
        ),
        ("analysis: {models: [x], splits: {random: {share: 1.0}}}", "'share': must be below 1, not 1.0."),
        ("analysis: 5", "'analysis': expected a mapping with the keys models, inputs, splits, limits, seed, not 5."),
        ("description: [a]", "'description': expected text, not a list."),
    ],
)
def test_bounds_and_kinds(line: str, expected: str) -> None:
    head = "steps: [x]\n" + ("" if line.startswith("procedure") else "procedure: x\n")
    (problem,) = mistakes(ProcedureHead, head + line)
    assert problem.partition(": ")[2].startswith(expected)


def test_models_and_suffixes_along_a_path() -> None:
    assert model_at(BenchFile, ("duts", "A1", "limits")) is DutLimits
    assert model_at(BenchFile, ("duts", "A1", "port")) is CanPort
    assert model_at(BenchFile, ("duts", "A1", "settings", "frame")) is None
    assert model_at(BenchFile, ("simulation",)) is None
    assert model_at(Sweep, ("rate",)) is RateRange
    assert model_at(BenchFile, ("nonsense", "deep")) is None
    assert suffix_at(Sweep, ("rate", "without", 3)) == "dps"
    assert suffix_at(BenchFile, ("duts", "A1", "limits", "rate")) == "dps"
    assert suffix_at(BenchFile, ("duts", "A1", "driver")) is None
    assert suffix_at(Sweep, ()) is None


def test_a_sentence_ends_once() -> None:
    assert [sentence("a"), sentence("a."), sentence("Did you mean b?")] == ["a.", "a.", "Did you mean b?"]
