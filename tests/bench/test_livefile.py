"""The bench file printed for live simulators: another bench's with other ports, read back as it was meant."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from bench.benchfile import Bench, load_bench
from bench.livefile import _Dumper, live_file
from bench.yamlfile import parse_yaml
from tests.bench.campaigns import ROOT, VIRTUAL, write

PORTS: dict[Any, Any] = {
    ("chamber",): "/dev/pts/3",
    ("rate_table",): "socket://127.0.0.1:4000",
    ("duts", "FOG-A01"): "/dev/pts/4",
    ("duts", "FOG-B01"): {"interface": "slcan", "channel": "/dev/pts/5", "bitrate": 1_000_000},
}


def loaded(path: Path) -> Bench:
    bench, problems = load_bench(path)
    assert bench is not None, problems
    return bench


@pytest.mark.parametrize("speed", [1.0, 12.5])
def test_only_ports_clock_simulation_and_description_differ(tmp_path: Path, speed: float) -> None:
    before = loaded(VIRTUAL)
    after = loaded(write(tmp_path, "live.yaml", live_file(before, PORTS, speed)))
    assert not after.virtual and after.file.clock.speed == speed
    assert ("clock" in after.document.data) == (speed != 1.0)
    assert after.file.simulation == {} and "not hardware" in after.file.description
    assert [item.address for item in after.instruments] == [
        "/dev/pts/3", "socket://127.0.0.1:4000", "/dev/pts/4", "can:slcan//dev/pts/5",
    ]  # fmt: skip
    assert [item.settings for item in after.instruments] == [item.settings for item in before.instruments]
    for name in ("bench", "site"):
        assert getattr(after.file, name) == getattr(before.file, name)
    assert before.file.chamber and after.file.chamber and before.file.rate_table and after.file.rate_table
    assert after.file.chamber.limits == before.file.chamber.limits
    assert after.file.chamber.safe == before.file.chamber.safe
    assert after.file.rate_table.limits == before.file.rate_table.limits
    assert {s: d.limits for s, d in after.file.duts.items()} == {s: d.limits for s, d in before.file.duts.items()}


def test_a_declaration_beside_the_bench_file_is_found_from_another_folder(tmp_path: Path) -> None:
    frame = (ROOT / "drivers" / "gyros" / "frames" / "kvh_36_c100.yaml").read_text(encoding="utf-8")
    write(tmp_path, "mine.yaml", frame)
    bench = VIRTUAL.read_text(encoding="utf-8").replace("frame: kvh_36_c100", "frame: mine.yaml")
    other = tmp_path / "other"
    other.mkdir()
    after = loaded(write(other, "live.yaml", live_file(loaded(write(tmp_path, "b.yaml", bench)), PORTS, 1.0)))
    assert after.duts["FOG-A01"].settings.frame == str(tmp_path / "mine.yaml")


PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**12), 10**12)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Cn", "Zl", "Zp")))
    | st.sampled_from(
        ["1e3", "010", "0x1F", "1:30", "on", "no", "~", "1_000", "-1E5", "<<", "=", "2026-01-01", ".5", "5."]
    ),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from("abcd"), inner),
    max_leaves=12,
)


@given(st.dictionaries(st.sampled_from(["a", "b", "1e3", "no", "010"]), PLAIN, min_size=1))
def test_what_is_dumped_is_read_back_with_its_types(data: dict[str, Any]) -> None:
    text = yaml.dump({**data, "again": data}, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    read = parse_yaml(text, "x").data
    assert read == {**data, "again": data}
    assert repr(read) == repr({**data, "again": data})


def test_a_virtual_bench_has_no_clock(tmp_path: Path) -> None:
    bench, problems = load_bench(write(tmp_path, "b.yaml", VIRTUAL.read_text(encoding="utf-8") + "clock: {speed: 2}\n"))
    assert bench is None
    assert ["leave 'clock:' out" in problem.message for problem in problems] == [True]


@pytest.mark.parametrize("speed", ["0", "-1", ".inf", "fast"])
def test_a_clock_without_a_pace_is_refused(tmp_path: Path, speed: str) -> None:
    text = live_file(loaded(VIRTUAL), PORTS, 2.0).replace("speed: 2.0", f"speed: {speed}")
    bench, problems = load_bench(write(tmp_path, "b.yaml", text))
    assert bench is None and len(problems) == 1 and "speed" in problems[0].message
