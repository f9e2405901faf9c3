"""--set path=value: what it changes, what it leaves alone, and where its mistakes are shown."""

import copy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import ExitCode, UserMistake
from bench.overrides import Override, editor, parse_overrides
from bench.procedure.parse import parse_procedure
from bench.yamlfile import Document, parse_yaml

BENCH = """\
bench: b
duts:
  '0142':
    port: sim://a
    settings: {frame: kvh}
simulation:
  seed: 1
  rates: [1, 2, 3]
"""


def edited(*texts: str, root: str = "bench", text: str = BENCH) -> Document:
    return editor(parse_overrides(texts), root)(parse_yaml(text, "b.yaml"))


def refusal(*texts: str, root: str = "bench") -> str:
    with pytest.raises(UserMistake) as caught:
        edited(*texts, root=root)
    assert caught.value.exit_code == ExitCode.USER_MISTAKE
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "root", "path", "value"),
    [
        ("bench.simulation.seed=7", "bench", ("simulation", "seed"), 7),
        ("procedure.raw=none", "procedure", ("raw",), "none"),
        ("procedure.limits.rate = 5 deg/s", "procedure", ("limits", "rate"), "5 deg/s"),
        ("bench.a.0.b=", "bench", ("a", "0", "b"), None),
        ("bench.a=x=y", "bench", ("a",), "x=y"),
        ("bench.a={rate: [1, two]}", "bench", ("a",), {"rate": [1, "two"]}),
        ("bench.a='5'", "bench", ("a",), "5"),
        ("bench.a=true", "bench", ("a",), True),
    ],
)
def test_paths_and_values(text: str, root: str, path: tuple[str, ...], value: Any) -> None:
    assert parse_overrides([text]) == [Override(root, path, value, text)]


@pytest.mark.parametrize(
    "text", ["", "x", "bench", "bench=5", "bench.=5", "bench..a=5", "seed=7", "run.seed=7", ".a=5", "=5", "bench.a"]
)
def test_what_is_no_override_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(UserMistake) as caught:
        parse_overrides([text])
    assert "--set bench.simulation.seed=7" in str(caught.value)
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("bench.a=[1", "not YAML"),
        ("bench.a=&x 1", "anchors"),
        ("bench.a=!!python/name:os.system", "tag"),
        ("bench.a={x: 1, x: 2}", "stands twice"),
        ("bench.a=\udcff", "U+DCFF"),
    ],
)
def test_a_value_is_read_as_safely_as_a_file(text: str, words: str) -> None:
    with pytest.raises(UserMistake) as caught:
        parse_overrides([text])
    assert "--set bench.a" in str(caught.value)
    assert words in str(caught.value)


def test_values_are_replaced_and_nothing_else(tmp_path: Path) -> None:
    before = parse_yaml(BENCH, "b.yaml")
    kept = copy.deepcopy(before.data)
    overrides = parse_overrides(
        ["bench.simulation.seed=7", "bench.simulation.rates.1=20", "bench.duts.0142.port=sim://b", "procedure.raw=none"]
    )
    after = editor(overrides, "bench")(before)
    assert before.data == kept
    assert after.data == {
        "bench": "b",
        "duts": {"0142": {"port": "sim://b", "settings": {"frame": "kvh"}}},
        "simulation": {"seed": 7, "rates": [1, 20, 3]},
    }
    assert editor(overrides, "procedure")(parse_yaml("raw: frames", "p")).data == {"raw": "none"}


def test_the_last_one_wins() -> None:
    assert edited("bench.simulation.seed=7", "bench.simulation.seed=8").data["simulation"]["seed"] == 8
    assert edited("bench.simulation={x: 1}", "bench.simulation.x=2").data["simulation"] == {"x": 2}


def test_a_bench_file_takes_keys_it_does_not_have_yet() -> None:
    data = edited("bench.simulation.duts.0142.noise.arw=0.1 deg/sqrt(h)").data
    assert data["simulation"]["duts"] == {"0142": {"noise": {"arw": "0.1 deg/sqrt(h)"}}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("bench.simulatin.seed=7", ["no 'simulatin' there", "Did you mean simulation?"]),
        ("bench.simulation.rates.3=7", ["no '3' there", "Allowed: 0, 1, 2."]),
        ("bench.simulation.rates.-1=7", ["no '-1' there"]),
        ("bench.simulation.rates.first=7", ["no 'first' there"]),
        ("bench.simulation.rates.²=7", ["no '²' there"]),
        ("bench.simulation.rates.00=7", ["no '00' there"]),
        ("bench.simulation.seed.x=7", ["no mapping or list to put 'x' into"]),
        ("bench.simulation.seed.x.y=7", ["no 'x' there"]),
    ],
)
def test_a_place_that_is_not_there(text: str, words: list[str]) -> None:
    message = refusal(text)
    assert message.startswith(f"--set {text}: ")
    assert all(word in message for word in words), message


def test_a_procedure_is_not_given_blocks_by_a_misspelt_path() -> None:
    assert "no 'analysis' there" in refusal("procedure.analysis.models.0=x", root="procedure")


PROCEDURE = """\
procedure: x
limits:
  rate: 5 deg/s
steps:
  - acquire: {count: 5, every: 1 s}
"""


def mistakes(tmp_path: Path, *texts: str) -> list[str]:
    path = tmp_path / "p.yaml"
    path.write_text(PROCEDURE)
    problems = parse_procedure(path, editor(parse_overrides(texts), "procedure"))[1]
    return [str(problem).replace(str(path), "p.yaml") for problem in problems]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("procedure.raw=all", "'raw': 'all' is not allowed. Allowed: frames, none, samples."),
        ("procedure.rav=none", "unknown key 'rav'. Allowed: analysis, calibration, cycles,"),
        ("procedure.limits.rate=5 K", "'rate': '5 K' has the unit 'K'"),
        (
            "procedure.limits.rat=5 K",
            "unknown key 'rat'. Allowed: duration, ramp, rate, temperature. Did you mean rate?",
        ),
        ("procedure.limits={rate: 5 K}", "'rate': '5 K' has the unit 'K'"),
        ("procedure.steps.0.acquire.count=x", "'count': expected a whole number, not 'x'."),
        ("procedure.steps.0={acquire: {count: x, every: 1 s}}", "'count': expected a whole number, not 'x'."),
        ("procedure.steps=[{dwel: 1 s}]", "unknown verb 'dwel'."),
        (
            "procedure.analysis={models: [a], splits: {random: {shar: 1}}}",
            "unknown key 'shar'. Allowed: seed, share, train. Did you mean share?",
        ),
    ],
)
def test_a_mistake_in_a_new_value_is_shown_at_the_set_not_in_the_file(tmp_path: Path, text: str, message: str) -> None:
    (problem,) = mistakes(tmp_path, text)
    assert problem.startswith(f"--set {text}: {message}")


def test_a_mistake_elsewhere_keeps_its_place(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(PROCEDURE + "  - dwel: 5 s\n")
    edit = editor(parse_overrides(["procedure.steps.0.acquire.count=7"]), "procedure")
    procedure, problems = parse_procedure(path, edit)
    assert [(problem.mark.line, problem.mark.column) for problem in problems] == [(6, 5)]
    assert procedure is not None
    assert procedure.steps[0].args.model_dump()["count"] == 7


@given(st.text(max_size=30), st.text(max_size=20))
def test_any_text_is_an_override_or_a_refusal(path: str, value: str) -> None:
    try:
        overrides = parse_overrides([f"bench.{path}={value}"])
        document = editor(overrides, "bench")(parse_yaml(BENCH, "b.yaml"))
    except UserMistake:
        return
    place: Any = document.data
    for part in overrides[0].path:
        place = place[int(part)] if isinstance(place, list) else place[part]
    assert repr(place) == repr(overrides[0].value)
