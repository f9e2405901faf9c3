"""Procedure files read into trees of steps: short forms, includes, places, and files made to do harm."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.procedure import parse
from bench.procedure.language import VERBS, Acquire, Note, SetRate, Soak, Sweep
from bench.procedure.parse import MAX_INCLUDE_DEPTH, MAX_INCLUDES, ParsedProcedure, StepNode, parse_procedure

ROOT = Path(__file__).parents[3]


def parsed(path: Path, text: str) -> tuple[ParsedProcedure, list[str]]:
    path.write_text(text)
    procedure, problems = parse_procedure(path)
    assert procedure is not None, problems
    return procedure, [str(problem).replace(str(path), path.name) for problem in problems]


def mistakes(path: Path, steps: str) -> list[str]:
    return parsed(path, f"procedure: x\nsteps:\n{steps}")[1]


def shape(nodes: tuple[StepNode, ...]) -> list[object]:
    return [(node.verb, shape(node.children)) if node.children else node.verb for node in nodes]


def test_a_tree_of_steps(tmp_path: Path) -> None:
    procedure, problems = parsed(
        tmp_path / "p.yaml",
        """\
procedure: x
steps:
  - note: begin
  - sweep:
      rate: [1 deg/s, 2 deg/s]
      steps:
        - repeat:
            times: 2
            steps:
              - acquire: {count: 5, every: 1 s}
        - set_rate: 0 deg/s
  - soak: {for: 2 h}
""",
    )
    assert problems == []
    assert shape(procedure.steps) == ["note", ("sweep", [("repeat", ["acquire"]), "set_rate"]), "soak"]
    sweep = procedure.steps[1]
    assert isinstance(sweep.args, Sweep)
    assert sweep.args.rate == [1.0, 2.0]
    inner = sweep.children[0].children[0]
    assert isinstance(inner.args, Acquire)
    assert (inner.mark.line, inner.mark.column) == (10, 17)
    assert procedure.included == ()


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("set_temperature: 5 degC", "set_temperature: {to: 5 degC}"),
        ("set_rate: 5 deg/s", "set_rate: {to: 5 deg/s}"),
        ("go_to_position: 5 deg", "go_to_position: {to: 5 deg}"),
        ("soak: 5 s", "soak: {for: 5 s}"),
        ("dwell: 5 s", "dwell: {for: 5 s}"),
        ("note: hello", "note: {text: hello}"),
    ],
)
def test_short_and_long_form_mean_the_same(tmp_path: Path, short: str, long: str) -> None:
    procedure, problems = parsed(tmp_path / "p.yaml", f"procedure: x\nsteps:\n  - {short}\n  - {long}\n")
    assert problems == []
    assert procedure.steps[0].args == procedure.steps[1].args


def test_a_mistake_in_a_short_form_has_the_place_of_the_value(tmp_path: Path) -> None:
    (problem,) = mistakes(tmp_path / "p.yaml", "  - set_rate: 10 degC/s")
    assert problem.startswith("p.yaml:3:15: 'to': '10 degC/s' has the unit 'degC/s'")


@pytest.mark.parametrize(
    ("step", "place", "words"),
    [
        ("- aquire: {count: 5}", "3:3", ["unknown verb 'aquire'", *VERBS, "Did you mean acquire?"]),
        ("- dwell", "3:3", ["one verb with its arguments", *VERBS]),
        ("- {dwell: 5 s, soak: 5 s}", "3:3", ["one verb with its arguments"]),
        ("- {}", "3:3", ["one verb with its arguments"]),
        ("- 5", "3:3", ["one verb with its arguments"]),
        ("-", "3:2", ["one verb with its arguments"]),
        ("- acquire:", "3:11", ["a mapping is expected", "count, for, every, take"]),
        ("- acquire: 5 s", "3:12", ["a mapping is expected", "count, for, every, take"]),
        ("- soak: {for: 2 h, bnd: 1}", "3:20", ["unknown key 'bnd'", "Allowed: for, on_timeout, timeout, until."]),
        ("- soak: {for: 2 h, untl: 1}", "3:20", ["unknown key 'untl'", "Did you mean until?"]),
        ("- soak: {until: {slope: 1 K/min}, timeout: 6 h}", "3:3", ["'for' is missing", "for: 2 h"]),
        ("- sweep:\n    rate: [1 deg/s]\n    steps: {dwell: 5 s}", "5:12", ["'steps'", "a list", "not a mapping"]),
        ("- sweep:\n    rate: [1 deg/s]\n    steps: []", "5:12", ["'steps': must not be empty"]),
        ("- sweep:\n    rate: [1 deg/s]\n    steps:", "5:11", ["'steps'", "a list", "not nothing"]),
        ("- sweep:\n    rate: [1 deg/s]", "3:3", ["'steps' is missing"]),
        ("- repeat: {times: 0, steps: [{dwell: 1 s}]}", "3:19", ["'times': must be above 0, not 0"]),
        ("- note: ''", "3:9", ["'text': must not be empty"]),
    ],
)
def test_one_mistake_in_a_step_is_one_message(tmp_path: Path, step: str, place: str, words: list[str]) -> None:
    (problem,) = mistakes(tmp_path / "p.yaml", step)
    assert problem.startswith(f"p.yaml:{place}: ")
    assert all(word in problem for word in words), problem


def test_mistakes_inside_a_block_with_a_mistake_are_found_too(tmp_path: Path) -> None:
    problems = mistakes(
        tmp_path / "p.yaml",
        """\
  - sweep:
      rat: [1 deg/s]
      steps:
        - dwel: 1 s
        - repeat: {times: x, steps: [{dwell: 5}]}
""",
    )
    assert sorted(problem.split(":")[1] for problem in problems) == ["4", "6", "7", "7"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "p.yaml: a mapping is expected here. Allowed keys: procedure, title,"),
        ("- a", "p.yaml:1:1: a mapping is expected here. Allowed keys: procedure, title,"),
        ("just words", "p.yaml:1:1: a mapping is expected here. Allowed keys: procedure, title,"),
        ("procedure: x", "p.yaml:1:1: the key 'steps' is missing here."),
        ("steps: [{dwell: 1 s}]", "p.yaml:1:1: the key 'procedure' is missing here."),
        ("procedure: x\nsteps: 5", "p.yaml:2:8: 'steps': expected a list (its items start with '- '), not 5."),
        ("procedure: x\nsteps: []", "p.yaml:2:8: 'steps': must not be empty."),
        ("procedure: x\nsteps: [{dwell: 1 s}]\ntitel: y", "p.yaml:3:1: unknown key 'titel'. Allowed: analysis,"),
    ],
)
def test_a_file_that_is_no_procedure(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    procedure, problems = parse_procedure(path)
    assert procedure is None
    assert [str(found).replace(str(path), "p.yaml").startswith(problem) for found in problems] == [True]


@pytest.mark.parametrize("path", sorted((ROOT / "procedures").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_procedures_of_the_house_are_right(path: Path) -> None:
    procedure, problems = parse_procedure(path)
    assert problems == []
    assert procedure is not None
    assert procedure.head.procedure == path.stem


class TestInclude:
    def test_steps_of_the_included_file_stand_in_its_place(self, tmp_path: Path) -> None:
        (tmp_path / "parts").mkdir()
        (tmp_path / "parts/warm.yaml").write_text("steps:\n  - soak: 2 h\n  - include: more.yaml\n")
        (tmp_path / "parts/more.yaml").write_text("steps:\n  - note: deep\n")
        procedure, problems = parsed(
            tmp_path / "p.yaml", "procedure: x\nsteps:\n  - include: parts/warm.yaml\n  - set_rate: 1 deg/s\n"
        )
        assert problems == []
        assert shape(procedure.steps) == [("include", ["soak", ("include", ["note"])]), "set_rate"]
        soak, more = procedure.steps[0].children
        assert isinstance(soak.args, Soak)
        assert str(soak.mark) == f"{tmp_path / 'parts/warm.yaml'}:2:5"
        assert more.children[0].args == Note(text="deep")
        assert procedure.included == (tmp_path / "parts/warm.yaml", tmp_path / "parts/more.yaml")

    def test_a_mistake_in_an_included_file_is_shown_there(self, tmp_path: Path) -> None:
        inner = tmp_path / "inner.yaml"
        inner.write_text("steps:\n  - set_rate: 5 K\n")
        (problem,) = mistakes(tmp_path / "p.yaml", "  - include: inner.yaml")
        assert problem.startswith(f"{inner}:2:15: 'to': '5 K'")

    @pytest.mark.parametrize(
        "text", ["", "- dwell: 1 s", "steps: []", "steps:", "steps: 5", "procedure: x\nsteps: [{dwell: 1 s}]", "words"]
    )
    def test_an_included_file_holds_steps_and_nothing_else(self, tmp_path: Path, text: str) -> None:
        (tmp_path / "inner.yaml").write_text(text)
        (problem,) = mistakes(tmp_path / "p.yaml", "  - include: inner.yaml")
        assert str(tmp_path / "inner.yaml") in problem
        assert "one key, 'steps'" in problem

    def test_what_cannot_be_read_is_shown_where_it_is_included(self, tmp_path: Path) -> None:
        (tmp_path / "bad.yaml").write_text("steps: [&a x]")
        problems = mistakes(
            tmp_path / "p.yaml", '  - include: nowhere.yaml\n  - include: bad.yaml\n  - include: "a\\0b"\n'
        )
        assert [problem.split(" ")[0] for problem in problems] == ["p.yaml:3:14:", "p.yaml:4:14:", "p.yaml:5:14:"]
        assert "nowhere.yaml: cannot be read: No such file" in problems[0]
        assert "bad.yaml:1:9: anchors" in problems[1]
        assert "null byte" in problems[2]

    def test_a_file_that_includes_itself_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "loop.yaml").write_text("steps:\n  - include: loop.yaml\n")
        (problem,) = mistakes(tmp_path / "p.yaml", "  - include: loop.yaml")
        assert f"{MAX_INCLUDE_DEPTH} levels" in problem
        assert "include itself" in problem

    def test_a_bomb_of_includes_is_refused_before_it_bursts(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Ten includes on each of eight levels are a hundred million files."""
        loads = 0
        load = parse.load_yaml

        def counted(path: Path) -> object:
            nonlocal loads
            loads += 1
            return load(path)

        monkeypatch.setattr(parse, "load_yaml", counted)
        (tmp_path / "bomb.yaml").write_text("steps:\n" + "  - include: bomb.yaml\n" * 10)
        problems = mistakes(tmp_path / "p.yaml", "  - include: bomb.yaml\n")
        assert loads <= MAX_INCLUDES + 1
        assert any(f"{MAX_INCLUDES} altogether" in problem for problem in problems)

    def test_includes_may_be_left_alone(self, tmp_path: Path) -> None:
        path = tmp_path / "p.yaml"
        path.write_text("procedure: x\nsteps:\n  - include: nowhere.yaml\n")
        procedure, problems = parse_procedure(path, follow_includes=False)
        assert problems == []
        assert procedure is not None
        assert shape(procedure.steps) == ["include"]


def test_the_document_may_be_changed_before_it_is_checked(tmp_path: Path) -> None:
    from bench.overrides import editor, parse_overrides

    path = tmp_path / "p.yaml"
    path.write_text("procedure: x\nsteps:\n  - set_rate: 1 deg/s\n")
    edit = editor(parse_overrides(["procedure.steps.0.set_rate=2 deg/s"]), "procedure")
    procedure, problems = parse_procedure(path, edit)
    assert problems == []
    assert procedure is not None
    assert procedure.steps[0].args == SetRate.model_validate({"to": "2 deg/s"})


WORDS = st.sampled_from([*VERBS, "steps", "for", "to", "rate", "5 s", "1 deg/s", "a", "", "0"])
TREES = st.recursive(
    st.one_of(WORDS, st.integers(), st.none(), st.booleans(), st.floats()),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=12,
)


@given(data=TREES)
def test_any_tree_is_a_procedure_or_a_list_of_mistakes(tmp_path_factory: pytest.TempPathFactory, data: object) -> None:
    import yaml

    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(yaml.safe_dump({"procedure": "x", "steps": data}))
    procedure, problems = parse_procedure(path)
    assert (procedure is None) <= bool(problems)
    assert all(problem.mark.line > 0 for problem in problems)
