import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.report.manifest import Manifest

KEYS = [field.name for field in dataclasses.fields(Manifest)]
JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from(KEYS), JUNK))
def test_any_json_gives_a_manifest(raw: dict[str, Any]) -> None:
    manifest = Manifest.from_mapping(raw, "folder")
    assert manifest.outcome in {"PASS", "FAIL", "ERROR", "ABORTED", "UNKNOWN"}
    assert manifest.run_id


def test_folder_name_stands_in_for_the_run_id() -> None:
    assert Manifest.from_mapping({}, "20261103-grid").run_id == "20261103-grid"


def test_what_is_written_is_read() -> None:
    manifest = Manifest.from_mapping(
        {
            "run_id": "r1",
            "outcome": "FAIL",
            "bench": {"name": "lab-3", "virtual": False},
            "limits": [{"model": "m", "split": "s", "quantity": "std_dps", "limit": 0.1, "measured": {"a": None}}],
            "host": {"system": "Linux", "machine": "x86_64"},
            "events": [{"t_s": 1.5, "kind": "safe", "text": "at rest"}],
            "message": "m std over 0.1 deg/s",
            "notes": ["a: too few", "b: too few", "a: too few", ""],
            "overrides": ["x=1", "x=2", "x=1"],
        },
        "folder",
    )
    assert (manifest.run_id, manifest.outcome, manifest.virtual, manifest.bench.name) == ("r1", "FAIL", False, "lab-3")
    assert manifest.limits[0].measured == {"a": None}
    assert manifest.limits[0].passed is None
    assert manifest.host == "system Linux, machine x86_64"
    assert manifest.events[0].t_s == 1.5
    assert manifest.message == "m std over 0.1 deg/s"
    assert manifest.notes == ("a: too few", "b: too few")
    assert manifest.overrides == ("x=1", "x=2", "x=1")


@pytest.mark.parametrize("duration", [float("nan"), float("inf"), "12", True])
def test_a_duration_that_is_no_number_is_unknown(duration: object) -> None:
    assert Manifest.from_mapping({"duration_s": duration}, "r").duration_s is None
