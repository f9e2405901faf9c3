"""What single steps and blocks accept and refuse."""

import inspect
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from bench import engine
from bench.procedure.analyses import Analysis
from bench.procedure.language import (
    MAX_SAMPLES,
    MAX_SLOPE_WINDOW_S,
    SHORT_FORM,
    VERBS,
    Acquire,
    ProcedureHead,
    Soak,
    Sweep,
)
from bench.steps import STEPS

# Verbs that the plan resolves; the engine never sees them.
RESOLVED = {"sweep", "repeat", "include"}

MINIMAL: dict[str, dict[str, Any]] = {
    "set_temperature": {"to": "-30 degC"},
    "ramp_temperature": {"to": "60 degC", "rate": "1 degC/min"},
    "soak": {"for": "2 h"},
    "set_rate": {"to": "-180 deg/s"},
    "settle": {"band": "0.02 deg/s"},
    "go_to_position": {"to": "90 deg"},
    "dwell": {"for": "5 s"},
    "power": {"to": "off"},
    "acquire": {"count": 1000, "every": "0.6 s"},
    "sweep": {"rate": ["1 deg/s"], "steps": [{"dwell": "1 s"}]},
    "repeat": {"times": 3, "steps": [{"dwell": "1 s"}]},
    "record": {"name": "cycle", "every": "1 s", "steps": [{"dwell": "1 s"}]},
    "include": {"file": "a.yaml"},
    "note": {"text": "hello"},
}


def test_every_verb_is_there_with_its_least_arguments_and_the_engine_can_do_it() -> None:
    assert set(MINIMAL) == set(VERBS)
    for verb, arguments in MINIMAL.items():
        assert VERBS[verb].model_validate(arguments)
    assert set(STEPS) == set(VERBS) - RESOLVED | {"end_record"}


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_documented_and_refuses_unknown_keys(verb: str) -> None:
    assert inspect.cleandoc(VERBS[verb].__doc__ or "").endswith(".")
    with pytest.raises(ValidationError, match="Extra inputs"):
        VERBS[verb].model_validate(MINIMAL[verb] | {"colour": "red"})


@pytest.mark.parametrize("verb", SHORT_FORM)
def test_the_short_form_names_the_one_argument_that_must_be_given(verb: str) -> None:
    required = [field.alias for field in VERBS[verb].model_fields.values() if field.is_required()]
    assert required == [SHORT_FORM[verb]]


def error_of(model: Any, arguments: dict[str, Any]) -> str:
    with pytest.raises(ValidationError) as caught:
        model.model_validate(arguments)
    return str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"for": "2 h", "until": {"slope": "0.02 degC/min"}}, "needs a 'timeout'"),
        ({"for": "2 h", "timeout": "1 h"}, "longer than its minimum time"),
        ({"for": "2 h", "timeout": "2 h"}, "longer than its minimum time"),
        ({"for": "0 s"}, "greater than 0"),
        ({"for": "2 h", "until": {"slope": "0 degC/min"}, "timeout": "6 h"}, "greater than 0"),
        ({"for": "2 h", "until": {"slope": "1 degC/h", "over": "5 h"}, "timeout": "6 h"}, "less than or equal"),
        ({"for": "2 h", "on_timeout": "stop"}, "'fail' or 'continue'"),
    ],
)
def test_soaks_that_cannot_be_meant(arguments: dict[str, Any], words: str) -> None:
    assert words in error_of(Soak, arguments)


def test_a_slope_is_asked_over_no_longer_than_the_engine_remembers() -> None:
    assert MAX_SLOPE_WINDOW_S <= engine.HISTORY_S
    soak = {"for": "2 h", "until": {"slope": "1 degC/h", "over": "4 h"}, "timeout": "9 h"}
    assert Soak.model_validate(soak).until


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"every": "1 s"}, "either 'count' or 'for'"),
        ({"count": 5, "for": "5 s", "every": "1 s"}, "either 'count' or 'for'"),
        ({"for": "0.5 s", "every": "1 s"}, "shorter than one interval"),
        ({"count": 0, "every": "1 s"}, "greater than 0"),
        ({"count": MAX_SAMPLES + 1, "every": "1 s"}, "less than or equal"),
        ({"for": "1e300 s", "every": "1e-300 s"}, "split it with repeat"),
        ({"for": "7 d", "every": "1 ms"}, "split it with repeat"),
        ({"count": 5, "every": "0 s"}, "greater than 0"),
        ({"count": 5, "every": "1 s", "take": "median"}, "'mean' or 'newest'"),
    ],
)
def test_acquisitions_that_cannot_be_meant(arguments: dict[str, Any], words: str) -> None:
    assert words in error_of(Acquire, arguments)


@pytest.mark.parametrize(
    ("arguments", "samples", "duration_s"),
    [
        ({"count": 1000, "every": "0.6 s"}, 1000, 600.0),
        ({"for": "20 s", "every": "0.5 s"}, 40, 20.0),
        ({"for": "10 min", "every": "0.6 s"}, 1000, 600.0),
        ({"for": "1 s", "every": "0.1 s"}, 10, 1.0),
        ({"for": "1 s", "every": "0.3 s"}, 3, 0.9),
        ({"for": "1 s", "every": "1 s"}, 1, 1.0),
    ],
)
def test_samples_and_duration_of_an_acquisition(arguments: dict[str, Any], samples: int, duration_s: float) -> None:
    acquire = Acquire.model_validate(arguments)
    assert acquire.samples == samples
    assert acquire.duration_s == pytest.approx(duration_s, rel=1e-12)


@given(st.integers(1, 100_000), st.integers(1, 10_000))
def test_a_whole_number_of_intervals_is_never_one_short(count: int, every_ms: int) -> None:
    duration = f"{count * every_ms} ms"
    assert Acquire.model_validate({"for": duration, "every": f"{every_ms} ms"}).samples == count


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "exactly one of"),
        ({"rate": ["1 deg/s"], "temperature": ["1 degC"]}, "exactly one of"),
        ({"rate": ["1 deg/s"], "ramp": "1 degC/min"}, "'ramp' belongs to a temperature sweep"),
        ({"rate": ["1 deg/s"], "band": "1 K"}, "'band' belongs to a temperature sweep"),
        ({"position": ["1 deg"], "timeout": "1 h"}, "'timeout' belongs to a temperature sweep"),
        ({"rate": ["1 deg/s"], "order": "sideways"}, "'up', 'down', 'alternate' or 'random'"),
        ({"temperature": ["1 degC"], "ramp": "0 degC/min"}, "greater than 0"),
    ],
)
def test_sweeps_that_cannot_be_meant(arguments: dict[str, Any], words: str) -> None:
    assert words in error_of(Sweep, {"steps": [1], **arguments})


def test_a_temperature_sweep_takes_its_ramp_band_and_timeout() -> None:
    sweep = Sweep.model_validate(
        {"temperature": ["1 degC"], "ramp": "1 degC/min", "band": "0.2 K", "timeout": "3 h", "steps": [1]}
    )
    assert (sweep.ramp_degc_min, sweep.band_k, sweep.timeout_s) == (1.0, 0.2, 10800.0)


@pytest.mark.parametrize(
    ("analysis", "words"),
    [
        ({"models": []}, "at least 1"),
        ({"models": ["x"], "limits": [{"model": "x"}]}, "'max_abs' or 'std'"),
        ({"models": ["x"], "splits": {"random": {}}}, "either 'train' (rows) or 'share'"),
        ({"models": ["x"], "splits": {"random": {"train": 5, "share": 0.5}}}, "either 'train' (rows) or 'share'"),
        ({"models": ["x"], "splits": {"random": {"share": 1.0}}}, "less than 1"),
        ({"models": ["x"], "inputs": []}, "at least 2"),
        ({"models": ["x"], "inputs": ["rate", "dut_temperature"]}, "a temperature and the rate"),
        ({"models": ["x"], "inputs": ["rate", "rate"]}, "a temperature and the rate"),
    ],
)
def test_analyses_that_cannot_be_meant(analysis: dict[str, Any], words: str) -> None:
    assert words in error_of(Analysis, analysis)


def test_defaults_of_a_procedure() -> None:
    head = ProcedureHead.model_validate({"procedure": "p", "steps": [1], "analysis": {"models": ["x"]}})
    assert head.raw == "frames"
    assert head.limits.temperature is None
    assert (head.quality.lost_ppm, head.quality.fail_at) == (1000.0, 5.0)
    assert head.analysis is not None
    assert (head.analysis.splits.random.share, head.analysis.splits.leave_temperatures_out.folds) == (0.69, 6)
    assert head.analysis.inputs == ["dut_temperature", "rate"]
