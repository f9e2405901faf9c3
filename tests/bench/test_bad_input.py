"""Bad input and what it gets (issue 2): one paragraph with the place and the way out, before anything was touched."""

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from bench.check import check
from bench.errors import ExitCode, InvalidFiles

PROCEDURE = """\
procedure: p
limits:
  temperature: {from: -30 degC, to: 60 degC}
  rate: 250 deg/s
steps:
  - set_rate: 0 deg/s
  - sweep:
      temperature: {from: -30 degC, to: 60 degC, step: 5 K}
      ramp: 1 degC/min
      steps:
        - soak: {for: 2 h, until: {slope: 0.02 degC/min}, timeout: 6 h}
        - sweep:
            rate: {from: -180 deg/s, to: 180 deg/s, step: 10 deg/s}
            steps:
              - settle: {band: 0.02 deg/s}
              - acquire: {count: 1000, every: 0.6 s}
analysis:
  models: [linear, ts_joint]
"""
BENCH = """\
bench: b
chamber:
  driver: watlow_f4
  port: sim://chamber
  limits: {temperature: {from: -60 degC, to: 90 degC}}
rate_table:
  driver: acutronic_acl
  port: sim://table
  limits: {rate: 300 deg/s}
duts:
  A1:
    driver: serial_frames
    port: sim://a1
    settings: {data_rate: 100 Hz}
    limits: {rate: 200 deg/s}
simulation:
  seed: 1
"""


@dataclass(frozen=True)
class Bad:
    """`old` becomes `new` in the file that has it. The mistake is shown where `at` begins (p: procedure, b: bench)."""

    what: str
    old: str
    new: str
    at: str
    words: str
    mistakes: int = 1

    @property
    def files(self) -> dict[str, str]:
        files = {"p": PROCEDURE, "b": BENCH}
        name = "p" if self.old in PROCEDURE else "b"
        assert self.old in files[name]
        return files | {name: files[name].replace(self.old, self.new, 1)}

    @property
    def place(self) -> str:
        """file:line:column of `at`, found in the text by itself."""
        name, _, fragment = self.at.partition(":")
        if not fragment:
            return f"{name}: "
        text = self.files[name]
        assert fragment in text
        before = text[: text.index(fragment)].split("\n")
        return f"{name}:{len(before)}:{len(before[-1]) + 1}: "


ALIAS_BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdef", "bcdefg", strict=True)
)
T_SWEEP, R_SWEEP = "p:sweep:\n      t", "p:sweep:\n            r"

WORDS = [
    Bad("key of a step", "until: {", "untl: {", "p:untl", "unknown key 'untl' | Allowed: for, | Did you mean until?"),
    Bad("key deep inside", "slope: 0", "slop: 0", "p:slop", "unknown key 'slop' | Did you mean slope?", 2),
    Bad("key at the top", "analysis:", "analisys:", "p:anali", "unknown key 'analisys' | Did you mean analysis?"),
    Bad("key of the bench", "rate_table:", "ratetable:", "b:rate", "'ratetable' | Did you mean rate_table?"),
    Bad("key of a DUT", "limits: {rate: 2", "limit: {rate: 2", "b:limit: ", "'limit' | Did you mean limits?", 2),
    Bad("setting", "data_rate:", "datarate:", "b:datarate", "unknown key 'datarate' | Did you mean data_rate?"),
    Bad("key of the simulation", "seed: 1", "sead: 1", "b:sead", "unknown key 'sead' | Did you mean seed?"),
    Bad("verb", "- acquire:", "- aquire:", "p:aquire", "unknown verb 'aquire' | Allowed: acquire, dwell | acquire?"),
    Bad("order", "ramp: 1 degC/min", "order: donw", "p:donw", "'donw' is not allowed | Did you mean down?"),
    Bad("model", "ts_joint", "ts_jiont", "p:ts_jiont", "unknown model 'ts_jiont' | Allowed: automatic, | ts_joint?"),
    Bad("driver", "watlow_f4", "watlow-f4", "b:watlow-f4", "unknown driver 'watlow-f4' | chamber | watlow_f4?"),
    Bad(
        "driver of another kind", "serial_frames", "watlow_f4", "b:watlow_f4\n    port: sim://a1", "for a DUT | can_dbc"
    ),
]
QUANTITIES = [
    Bad(
        "wrong unit", "set_rate: 0 deg/s", "set_rate: 10 degC/s", "p:10 degC/s", "'degC/s' | angular rate | '10 deg/s'"
    ),
    Bad("wrong unit in the bench", "300 deg/s", "300 Hz", "b:300 Hz", "'300 Hz' | angular rate | deg/s"),
    Bad("no unit", "every: 0.6 s", "every: 0.6", "p:0.6", "0.6 has no unit | time | '2 h'"),
    Bad("NaN", "for: 2 h", "for: .nan", "p:.nan", "'for' | not a finite number | '2 h'"),
    Bad("NaN with a unit", "set_rate: 0", "set_rate: nan", "p:nan", "'nan deg/s' | not a finite number"),
    Bad("infinite", "for: 2 h", "for: .inf", "p:.inf", "not a finite number"),
    Bad("too large", "for: 2 h", "for: 1e999 h", "p:1e999", "too large"),
    Bad("negative", "for: 2 h", "for: -2 h", "p:-2 h", "'for': must be above 0 s, not '-2 h'"),
    Bad("a word for a number", "1000", "many", "p:many", "'count': expected a whole number, not 'many'"),
]
SWEEPS = [
    Bad("missing end", ", to: 60 degC, step", ", step", "p:temperature: {from: -30 degC, s", "the key 'to' is missing"),
    Bad("missing step", ", step: 10 deg/s", "", "p:rate: {", "the key 'step' is missing here | step: 10 deg/s"),
    Bad("steps that overshoot", "5 K", "20 K", T_SWEEP, "steps of 20 K | reach 50, then 70 | to: 50 degC"),
    Bad("upside down", "-180 deg/s, to: ", "180 deg/s, to: -", R_SWEEP, "'from' (180 deg/s) is above | order: down"),
    Bad(
        "two quantities",
        "ramp: 1 degC/min",
        "rate: [1 deg/s]",
        "p:temperature: {from: -30 degC, to: 60 degC, s",
        "one of",
    ),
    Bad(
        "a ramp for a rate",
        "            rate: {",
        "            ramp: 1 K/min\n            rate: {",
        "p:ramp: 1 K",
        "settle",
    ),
]
LIMITS = [
    Bad("chamber", "to: 90 degC", "to: 55 degC", T_SWEEP, "60 degC is outside the chamber: -60 to 55 degC"),
    Bad("procedure, temperature", "60 degC}", "50 degC}", T_SWEEP, "60 degC | procedure's own limits | So is 1 more"),
    Bad("DUT", "{rate: 200", "{temperature: {from: 0 degC, to: 60 degC}, rate: 200", T_SWEEP, "-30 degC | DUT A1"),
    Bad("table", "300 deg/s", "100 deg/s", R_SWEEP, "-180 deg/s | rate table's limit, ± 100 deg/s | 15 more"),
    Bad("full scale", "200 deg/s", "179 deg/s", R_SWEEP, "-180 deg/s | the full scale of DUT A1, ± 179 deg/s"),
    Bad("procedure, rate", "250 deg/s", "170 deg/s", R_SWEEP, "-180 deg/s | procedure's own limit, ± 170 deg/s"),
    Bad("ramp", "1 degC/min", "6 degC/min", T_SWEEP, "a ramp of 6 degC/min | the chamber, 5 degC/min"),
    Bad("data rate", "0.6 s", "6 ms", "p:acquire", "a sample every 0.006 s is faster than the 100 Hz of DUT A1"),
    Bad("an empty band", "from: -60 degC", "from: 95 degC", "b:{from: 95", "'from' is above 'to'"),
]
PORTS = [
    Bad(
        "one port",
        "sim://a1",
        "sim://table",
        "b:sim://table\n    settings",
        "A1 is on sim://table | rate table already is",
    ),
    Bad(
        "half real", "sim://a1", "/dev/ttyUSB0", "b:/dev", "some ports are simulated and some real (A1 at /dev/ttyUSB0)"
    ),
]
HOSTILE = [
    Bad("duplicate key", "  rate: 250", "  rate: 20 deg/s\n  rate: 250", "p:rate: 250", "'rate' stands twice | line 4"),
    Bad(
        "duplicate DUT", "  A1:", "  A1: {}\n  A1:", "b:A1:\n    d", "the key 'A1' stands twice | line 11 | Remove one"
    ),
    Bad("alias bomb", PROCEDURE, ALIAS_BOMB, "p:&a", "anchors (&) and aliases (*) are not read"),
    Bad("tag", "1000", "!!python/object/apply:os.system [a]", "p:!!py", "!!python/object/apply:os.system is not read"),
    Bad("deep nesting", PROCEDURE, "steps: " + 40 * "[" + "X" + 10_000 * "[", "p:X", "too large | 40 levels"),
    Bad("many values", PROCEDURE, f"[{'1,' * 99_999}X, {'1,' * 50_000}]", "p:X", "too large | 100000 values"),
    Bad("huge", PROCEDURE, "#" * 2_000_000, "p", "2000000 bytes | at most 1000000"),
    Bad("tabs", "  rate: 250", "\trate: 250", "p:\trate", "not YAML | spaces, not tabs"),
    Bad("unclosed", "5 K}", "5 K", "p:: 1 degC/min", "not YAML"),
    Bad("empty", PROCEDURE, "", "p", "a mapping is expected | procedure, title"),
    Bad("another kind of file", BENCH, "PK\x03\x04", "b:\x03", "U+0003 | Is this a text file?"),
    Bad("a bench for a procedure", PROCEDURE, BENCH, "p:bench", "unknown key 'bench' | Allowed: analysis,", 7),
]
CASES = [*WORDS, *QUANTITIES, *SWEEPS, *LIMITS, *PORTS, *HOSTILE]


def problems_of(folder: Path, procedure: str, bench: str) -> list[str]:
    (folder / "p.yaml").write_text(procedure)
    (folder / "b.yaml").write_text(bench)
    with pytest.raises(InvalidFiles) as caught:
        check(folder / "p.yaml", folder / "b.yaml")
    assert caught.value.exit_code == ExitCode.USER_MISTAKE
    assert str(caught.value) == "\n".join(map(str, caught.value.problems))
    return [str(problem).replace(f"{folder}/", "").replace(".yaml:", ":", 1) for problem in caught.value.problems]


@pytest.mark.parametrize("bad", CASES, ids=lambda bad: bad.what)
def test_one_mistake_is_one_paragraph_with_its_place_and_the_way_out(tmp_path: Path, bad: Bad) -> None:
    problems = problems_of(tmp_path, bad.files["p"], bad.files["b"])
    assert len(problems) == bad.mistakes, problems
    words = bad.words.split(" | ")
    meant = [
        problem for problem in problems if problem.startswith(bad.place) and all(word in problem for word in words)
    ]
    assert len(meant) == 1, (bad.place, problems)
    assert "\n" not in meant[0]
    assert len(meant[0]) < 500


def test_the_files_are_right_without_a_mistake_in_them(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text(PROCEDURE)
    (tmp_path / "b.yaml").write_text(BENCH)
    assert check(tmp_path / "p.yaml", tmp_path / "b.yaml").points == 703


def test_several_mistakes_come_all_together_in_file_order(tmp_path: Path) -> None:
    changes = {
        "driver: watlow_f4": "driver: watlow",
        "sim://a1": "sim://table",
        "data_rate": "date_rate",
        "set_rate: 0 deg/s": "set_rate: 10 degC/s",
        "temperature: {from: -30 degC, to: 60 degC, step: 5 K}": "temperature: {from: -30 degC, step: 5 K}",
        "until: {slope": "untl: {slope",
        "- settle:": "- setle:",
        "every: 0.6 s": "every: .nan",
        "ts_joint": "ts_jiont",
    }
    procedure, bench = PROCEDURE, BENCH
    for old, new in changes.items():
        procedure, bench = procedure.replace(old, new), bench.replace(old, new)
    problems = problems_of(tmp_path, procedure, bench)
    assert [problem.split(":")[0] for problem in problems] == ["b", "b", "p", "p", "p", "p", "p", "p"]
    words = ["'watlow'", "'date_rate'", "'10 degC/s'", "'to' is missing", "'untl'", "'setle'", "'nan'", "'ts_jiont'"]
    assert all(word in problem for word, problem in zip(words, problems, strict=True)), problems


def test_no_message_speaks_of_the_programs_insides(tmp_path: Path) -> None:
    """What a user reads has no class names, no dumps and no words of the libraries underneath."""
    for bad in CASES:
        for problem in problems_of(tmp_path, bad.files["p"], bad.files["b"]):
            assert not re.search(r"pydantic|Input should|validation|function-|dict\b|NoneType|lambda|Error", problem)
