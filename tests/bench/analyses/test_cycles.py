"""Thermal cycles from records to figures: averages, truth, tests, limits, and what is refused before hour 0."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bench.analyses.cycles import averaged, labels_of
from bench.errors import InvalidFiles, UserMistake
from bench.procedure.analyses import CycleAnalysis
from bench.run import RunRequest, prepare
from bench.verify.verify import verify
from tests.bench.campaigns import VIRTUAL, run_campaign, virtual_bench, write

CYCLES = """\
procedure: cycles
raw: samples
steps:
  - set_temperature: {to: 25 degC, band: 1 K}
  - dwell: 1 h
  - repeat:
      times: 2
      steps:
        - record:
            name: cycle
            every: 10 s
            steps:
              - dwell: 1 h
              - ramp_temperature: {to: 5 degC, rate: 1 degC/min}
              - dwell: 1 h
              - ramp_temperature: {to: 25 degC, rate: 1 degC/min}
              - dwell: 1 h
cycles:
  models: [linear, lag_bank]
  average: 100 s
  reference: {record: cycle, from: 10 min, to: 50 min}
  train: [cycle]
  tests: {second: [cycle-2]}
  halves: {warming: {record: cycle, at: 110 min}}
  limits:
    - {model: lag_bank, test: second, std: 100 deg/h}
    - {model: linear, test: warming, times_floor: 0.5}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cycles")
    duts = {
        dut: {"class": kind, "repeatability": {"scale": "0 ppm", "bias": "0 deg/h", "sensor": "0 K"}}
        for dut, kind in (("FOG-A01", "ts_a"), ("FOG-B01", "ts_b"))
    }
    end = run_campaign(folder, "r", CYCLES, virtual_bench(folder, seed=1, duts=duts))
    assert end.outcome == "FAIL", end.message
    assert "linear, warming: standard deviation in noise floors" in end.message and "lag_bank" not in end.message
    return end.folder


def figures_of(run: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((run / "analyses" / "cycles.json").read_text())
    return found


def test_every_model_is_judged_on_every_test(run: Path) -> None:
    found = figures_of(run)
    assert set(found) == {"FOG-A01", "FOG-B01"}
    for models in found.values():
        assert set(models) == {"none", "linear", "lag_bank"}
        assert all(set(by) == {"train", "second", "warming", "unsmoothed"} for by in models.values())


def test_history_beats_the_straight_line_on_a_cycle_not_seen(run: Path) -> None:
    for models in figures_of(run).values():
        none, linear, bank = (models[name]["second"]["std_dps"] for name in ("none", "linear", "lag_bank"))
        assert bank < 0.5 * linear < 0.5 * none


def test_the_rows_kept_are_those_of_the_figures(run: Path) -> None:
    rows = pd.read_parquet(run / "analyses" / "cycles.parquet")
    mine = rows[(rows["dut"] == "FOG-A01") & (rows["model"] == "linear") & (rows["split"] == "second")]
    assert set(mine["label"]) == {"cycle-2"} and mine["t_s"].is_monotonic_increasing
    figures = figures_of(run)["FOG-A01"]["linear"]["second"]
    assert np.std(mine["residual_dps"]) == pytest.approx(figures["std_dps"]) and len(mine) == figures["n"]


def test_verify_works_the_figures_out_again(run: Path) -> None:
    assert not verify(run).wrong, verify(run).wrong
    path = run / "analyses" / "cycles.json"
    whole = path.read_text()
    figures = json.loads(whole)
    figures["FOG-A01"]["linear"]["second"]["max_abs_dps"] *= 1.01
    path.write_text(json.dumps(figures))
    try:
        assert any("linear / second / max_abs_dps" in str(finding) for finding in verify(run).wrong)
    finally:
        path.write_text(whole)


def test_the_report_shows_them(run: Path) -> None:
    from bench.report.render import write_report

    page = write_report(run).read_text(encoding="utf-8")
    assert '<section id="cycles">' in page and "second" in page and "lag_bank" in page


def test_averages_leave_out_blocks_with_a_gap_and_know_their_white_noise() -> None:
    rng = np.random.default_rng(3)
    drift = np.linspace(0.0, 10.0, 1000)
    rate = drift + 0.1 * rng.standard_normal(1000)
    rate[250] = np.nan
    series = {"t_s": np.arange(1000) + 500.5, "rate_dps": rate, "case_degc": drift}
    rows = averaged(series, "a", 500.0, ["case"], 100)
    assert len(rows.t_s) == 9 and rows.t_s[:3].tolist() == [50.0, 150.0, 350.0]
    np.testing.assert_allclose(rows.temperatures_degc[0, 0], drift[:100].mean())
    # drift of a hundred times the noise of a mean is not taken for noise
    np.testing.assert_allclose(rows.u_dps, 0.01, rtol=0.1)


def test_a_temperature_that_was_not_recorded_is_named() -> None:
    series = {"t_s": np.arange(10.0), "rate_dps": np.ones(10), "case_degc": np.ones(10)}
    with pytest.raises(UserMistake, match=r"no temperature 'cathode'. It has: case"):
        averaged(series, "a", 0.0, ["cathode"], 5)


def test_every_record_that_is_named_is_read() -> None:
    text = {"models": ["linear"], "train": ["a"], "tests": {"x": ["b"]}}
    text |= {"halves": {"y": {"record": "c", "at": "1 h"}}, "reference": {"record": "d", "from": "0 s", "to": "1 h"}}
    assert labels_of(CycleAnalysis.model_validate(text)) == ["a", "b", "c", "d"]


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("[linear, lag_bank]", "[linear, lagbank]", "p.yaml:19:20: there is no model 'lagbank'.*Did you mean lag_bank"),
        ("second: [cycle-2]", "second: [cycle-3]", "p.yaml:23:20: there is no record 'cycle-3'"),
        ("record: cycle, at", "record: cyle, at", "there is no record 'cyle'.*Did you mean cycle"),
        ("model: linear, test: warming", "model: svr, test: warming", "there is no fitted model 'svr'"),
        ("test: second, std", "test: third, std", "there is no test 'third'.*second"),
        ("from: 10 min, to: 50 min", "from: 1 h, to: 50 min", "'from' is not before 'to'"),
    ],
)
def test_what_is_refused_before_hour_0(tmp_path: Path, wrong: str, right: str, message: str) -> None:
    assert wrong in CYCLES
    procedure = write(tmp_path, "p.yaml", CYCLES.replace(wrong, right))
    with pytest.raises(InvalidFiles, match=message):
        prepare(RunRequest(procedure, VIRTUAL, tmp_path / "results", "r"))


def test_the_models_are_applied_to_what_was_not_averaged(run: Path) -> None:
    """Rows of 10 s of a record not seen: what is taken off is about what the averages lose."""
    for models in figures_of(run).values():
        none, bank = (models[name]["unsmoothed"] for name in ("none", "lag_bank"))
        assert none["n"] == bank["n"] > 1000 and none["rate_hz"] == 0.1
        assert bank["std_dps"] < 0.5 * none["std_dps"]


def test_the_fitted_models_are_kept_as_files(run: Path) -> None:
    from fitting.modelfile import load_model

    for dut in ("FOG-A01", "FOG-B01"):
        model = load_model(run / "analyses" / "models" / dut / "linear.json")
        assert [(column.name, column.unit) for column in model.inputs] == [("temperature", "degC")]
        assert model.output.name == "bias_error"
        assert abs(float(model.predict(25.0)) - float(model.predict(5.0))) > 1e-4
