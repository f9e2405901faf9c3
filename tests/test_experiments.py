"""The published experiments on their virtual benches, whole: their limits kept, their figures where they belong."""

import json
from pathlib import Path
from typing import Any

import pytest

from bench.conclude import RunEnd
from bench.run import RunRequest, prepare, run
from bench.verify.verify import verify

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.campaign


def experiment(folder: Path, procedure: str, bench: str) -> tuple[RunEnd, dict[str, Any]]:
    files = ROOT / "procedures" / f"{procedure}.yaml", ROOT / "benches" / f"{bench}.yaml"
    end = run(prepare(RunRequest(*files, folder, "r")))
    documents = {path.stem: json.loads(path.read_text()) for path in (end.folder / "analyses").glob("*.json")}
    return end, documents


def test_rlg_three_ring_lasers_through_slow_cycles(tmp_path: Path) -> None:
    end, documents = experiment(tmp_path, "rlg_thermal_cycle", "virtual_rlg")
    assert end.outcome == "PASS", end.message
    assert len(documents["cycles"]) == 3
    for models in documents["cycles"].values():
        none, linear, quadratic = (models[name]["second_cycle"]["std_dps"] * 3600.0 for name in MODELS)
        # published: about 0.03 deg/h over the cycle, inside 0.01 after compensation, which linear does not reach
        assert 0.025 < none < 0.035 and quadratic < 0.01 < linear
        assert models["none"]["unsmoothed"]["n"] > 3_000_000
        assert abs(models["none"]["train"]["n"] - 336) <= 4
    assert not verify(end.folder).wrong


MODELS = ("none", "linear", "quadratic")


def test_bp_one_gyro_through_a_stepped_cycle_twice(tmp_path: Path) -> None:
    end, documents = experiment(tmp_path, "bp_stepped_cycle", "virtual_bp")
    assert end.outcome == "PASS", end.message
    (models,) = documents["cycles"].values()
    other = {name: by["other_cycle"]["std_dps"] * 3600.0 for name, by in models.items()}
    # published: 0.011 deg/h at room temperature, 0.09 over the cycle
    assert 0.07 < other["none"] < 0.11 and models["none"]["room"]["bias_stability_dps"] * 3600.0 < 0.013
    assert other["lag_bank"] < 0.5 * other["csapso_stable"] < 0.5 * other["none"]
    assert abs(models["none"]["train"]["n"] - 498) <= 8
    (warnings,) = documents["cycles_warnings"].values()
    assert "2.88" in warnings["csapso_published"][0] and "csapso_stable" not in warnings


def test_north_two_and_four_positions(tmp_path: Path) -> None:
    end, documents = experiment(tmp_path, "north_seeking", "virtual_north")
    assert end.outcome == "PASS", end.message
    (found,) = documents["north"].values()
    assert found["seekings"] == 40 and found["mils_per_circle"] == 6000.0
    assert 0.3 < found["two_positions"]["rms_before_mil"] < 3.0
    assert found["two_positions"]["verdict"].startswith("smoothing ")
    assert set(found["allan"]["before"]["coefficients"]) == set("QNBKR")
