"""Guards that this bench can never hear are refused before hour 0, where they are written."""

from pathlib import Path

import pytest

from tests.bench.checking import BENCH, PROCEDURE, checked, mistakes

STEPS = "  - dwell: 1 min"


def without(bench: str, instrument: str) -> str:
    """The bench file without one of its blocks."""
    lines = bench.splitlines(keepends=True)
    begin = lines.index(f"{instrument}:\n")
    end = next(number for number in range(begin + 1, len(lines)) if not lines[number].startswith(" "))
    return "".join(lines[:begin] + lines[end:])


def guarded(text: str, guard: str) -> str:
    """A file with a guard, in line 2."""
    first, rest = text.split("\n", 1)
    return f"{first}\nguards: [{guard}]\n{rest}"


BAND = "inside: {from: 0 degC, to: 50 degC}"


@pytest.mark.parametrize(
    ("guard", "missing", "words"),
    [
        (f"{{name: g, watch: chamber_temperature, {BAND}}}", "chamber", "this bench has no chamber"),
        ("{name: g, watch: chamber_alarm}", "chamber", "this bench has no chamber"),
        ("{name: g, watch: chamber_door}", "chamber", "this bench has no chamber"),
        ("{name: g, watch: rate, max_rate: 100 deg/s}", "rate_table", "this bench has no rate table"),
        ("{name: g, watch: table_fault}", "rate_table", "this bench has no rate table"),
        ("{name: g, watch: chamber_door}", None, "nothing tells whether the chamber's door is open"),
    ],
)
def test_a_guard_without_a_signal_is_refused_in_either_file(
    tmp_path: Path, guard: str, missing: str | None, words: str
) -> None:
    bench = BENCH if missing is None else without(BENCH, missing)
    column = guarded("x\n", guard).splitlines()[1].index("watch: ") + len("watch: ") + 1
    (mistake,) = mistakes(tmp_path, STEPS, guarded(PROCEDURE, guard), bench)
    assert mistake.startswith(f"p.yaml:2:{column}: guard 'g': {words}")
    (mistake,) = mistakes(tmp_path, STEPS, PROCEDURE, guarded(bench, guard))
    assert mistake.startswith(f"b.yaml:2:{column}: guard 'g': {words}")


def test_guards_with_a_signal_are_accepted(tmp_path: Path) -> None:
    bench = BENCH.replace("  port: sim://chamber\n", "  port: sim://chamber\n  settings: {door_register: 106}\n")
    guards = ", ".join(
        [
            "{name: a, watch: chamber_door}",
            "{name: b, watch: table_fault}",
            "{name: c, watch: sample_quality, lost: 1 %}",
            f"{{name: d, watch: chamber_temperature, {BAND}}}",
            f"{{name: e, watch: dut_temperature, {BAND}}}",
        ]
    )
    assert len(checked(tmp_path, STEPS, guarded(PROCEDURE, guards), bench).head.guards) == 5


def test_a_chamber_driver_that_knows_of_no_door_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.chambers.watlow_f4 import WatlowF4

    monkeypatch.delattr(WatlowF4, "door_open")
    (mistake,) = mistakes(tmp_path, STEPS, guarded(PROCEDURE, "{name: g, watch: chamber_door}"))
    assert "guard 'g': the driver 'watlow_f4' cannot tell whether the chamber's door is open" in mistake
