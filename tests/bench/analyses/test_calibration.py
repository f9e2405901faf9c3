"""Calibration figures from records and points: what is cut, filled and counted, what is stated, judged and refused."""

import json
from math import pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from bench.analyses.calibration import largest, raw_hash
from bench.analyses.calibration_lab import pooled
from bench.analyses.calibration_points import nearest, rate_sets, small_rates, visits
from bench.analyses.calibration_records import LONGEST_GAP, NotRecorded, abouts_of, from_columns
from bench.analyses.calibration_words import digits, expanded_of, limits_of, value_of
from bench.certificate.gather import calibrated
from bench.cli.metrics import command as metrics
from bench.errors import FogbenchError
from bench.report.render import write_report
from bench.verify.verify import verify
from fitting.random_errors.mean import NoiseOfMean
from tests.bench.campaigns import ROOT, run_campaign

BENCH = ROOT / "benches" / "virtual_metrics.yaml"
QUICK = """\
procedure: quick
raw: samples
quality: {noise_ratio: 50}
steps:
  - set_temperature: {to: 25 degC, band: 0.5 K}
  - set_rate: 0 deg/s
  - dwell: 1 h
  - record: {name: still, every: 1 s, steps: [{dwell: 40 min}]}
  - sweep:
      rate: [0 deg/s, 20 deg/s, -20 deg/s, 0 deg/s, 60 deg/s, -60 deg/s, 0 deg/s, 120 deg/s, -120 deg/s, 0 deg/s]
      steps:
        - settle: {band: 0.01 deg/s, for: 2 s, timeout: 60 s}
        - acquire: {for: 18 s, every: 1 s}
  - set_rate: 0 deg/s
"""
CALIBRATION = """\
calibration:
  static: {record: still, warm_up: 10 min, blocks: [1 s, 10 s]}
  scale_factor: {}
  bench: {table: 35 ppm}
  limits:
    - {figure: N, max: 0.01 deg/sqrt(h)}
    - {figure: Kn, max: 0.001 ppm of full scale}
"""


def about(label: str = "still", **changes: Any) -> dict[str, Any]:
    return {
        "record": 1,
        "label": label,
        "dut": "A",
        "verdict": "pass",
        "reasons": "",
        "started_at_s": 100.0,
        "every_s": 1.0,
        "temperature_degc": 25.0,
        "losses": {"lost": 3},
    } | changes


def columns(output: np.ndarray[Any, Any]) -> dict[str, np.ndarray[Any, Any]]:
    rows = np.arange(len(output))
    return {"t_s": 100.0 + rows + 0.5, "rate_dps": output, "temperature_degc": 25.0 + 1e-3 * rows}


def noise(n: int, seed: int = 1) -> np.ndarray[Any, Any]:
    return np.asarray(np.random.default_rng(seed).normal(0.0, 1.0, n))


class TestRecords:
    def test_warm_up_is_cut_outliers_are_left_out_and_both_are_counted(self) -> None:
        output = noise(1000)
        output[500] += 40.0
        output[600:602] = np.nan
        found = from_columns(columns(output), about(), warm_up_s=100.0)
        assert (found.outliers, found.missing, found.filled, found.cut, found.frames_lost) == (1, 2, 3, 0, 3)
        assert len(found.output_dps) == 900 and found.t_s[0] == pytest.approx(100.5)
        assert np.isfinite(found.output_dps).all() and abs(found.output_dps[400]) < 4.0
        conditions = found.conditions()
        assert conditions["warm_up_cut_s"] == 100.0 and conditions["record_length_s"] == 900.0
        assert conditions["dut_temperature_degc"]["slope_degc_min"] == pytest.approx(0.06, rel=1e-6)

    def test_a_long_gap_cuts_the_record_and_is_never_closed_up(self) -> None:
        output = noise(1000)
        output[300 : 300 + LONGEST_GAP + 1] = np.nan
        found = from_columns(columns(output), about(), warm_up_s=0.0)
        assert len(found.output_dps) == 1000 - 300 - LONGEST_GAP - 1
        assert found.cut == 300 + LONGEST_GAP + 1 and found.filled == 0

    def test_drift_and_ramps_are_no_outliers(self) -> None:
        ramp = np.concatenate([np.zeros(500), np.linspace(0.0, 200.0, 500)])
        assert from_columns(columns(noise(1000) + ramp), about(), 0.0).outliers == 0

    def test_failed_records_are_not_used_and_missing_ones_are_said(self) -> None:
        series = [about(), about("still-2", record=3), about("still-3", record=2), about("other")]
        assert [one["label"] for one in abouts_of(series, "A", "still")] == ["still", "still-3", "still-2"]
        with pytest.raises(NotRecorded, match=r"'still' \(frames lost\) failed"):
            abouts_of([about(verdict="fail", reasons="frames lost")], "A", "still")


def points(rates: list[float], outputs: list[float], **changes: Any) -> pd.DataFrame:
    n = len(rates)
    table: dict[str, Any] = {
        "dut": ["A"] * n,
        "verdict": ["pass"] * n,
        "reasons": [""] * n,
        "dwell": [1] * n,
        "chamber_setpoint_degc": [25.0] * n,
        "dut_temperature_degc": [27.0] * n,
        "dut_temperature_slope_degc_min": [0.001] * n,
        "rate_setpoint_dps": rates,
        "rate_reference_dps": rates,
        "rate_mean_dps": outputs,
        "rate_mean_u_dps": [1e-6] * n,
        "outliers": [0] * n,
        "spikes": [0] * n,
        "frames_lost": [0] * n,
        "started_at_s": [100.0 * k for k in range(n)],
        "ended_at_s": [100.0 * k + 60.0 for k in range(n)],
    }
    return pd.DataFrame(table | changes)


RATES = [0.0, 10.0, -10.0, 0.0, 50.0, -50.0, 0.0, 100.0, -100.0, 0.0]


class TestRateSets:
    def test_a_bias_that_drifts_is_taken_off_with_the_rests_around_each_point(self) -> None:
        drift = [1e-4 * k for k in range(len(RATES))]
        outputs = [1.0005 * rate + bias for rate, bias in zip(RATES, drift, strict=True)]
        (found,) = rate_sets(points(RATES, outputs), "A", 0.0)
        # Rests are two points of three away: what is left of the drift is the same for + and -, and no slope.
        assert found.rates.scale_factor.value == pytest.approx(1.0005, abs=2e-6)
        assert found.conditions["rests"] == 4 and found.conditions["rates_dps"] == sorted(set(RATES) - {0.0})
        assert found.conditions["revolutions_per_point"]["max"] == pytest.approx(100.0 * 60.0 / 360.0)

    def test_the_tables_error_is_in_k_and_not_in_its_comparisons(self) -> None:
        rng = np.random.default_rng(3)
        outputs = [rate + float(rng.normal(0.0, 1e-4)) for rate in RATES]
        (found,) = rate_sets(points(RATES, outputs), "A", 20.0)
        assert found.rates.scale_factor.u > 19e-6 > 5e-6 > found.u_noise > 0.0

    def test_without_a_rest_the_definition_says_what_the_offset_holds(self) -> None:
        rates = [rate for rate in RATES if rate]
        (found,) = rate_sets(points(rates, [rate + 0.01 for rate in rates]), "A", 0.0)
        assert found.rates.offset.value == pytest.approx(0.01)
        assert "holds bias and earth rate" in found.rates.offset.definition

    def test_each_dwell_and_each_repeat_has_a_set_of_its_own(self) -> None:
        table = pd.concat([points(RATES, RATES), points(RATES, RATES)], ignore_index=True)
        table["started_at_s"] = 100.0 * np.arange(len(table))
        assert len(rate_sets(table, "A", 0.0)) == 1
        repeated = rate_sets(table, "A", 0.0, repeats_s=[0.0, 1000.0])
        assert len(repeated) == 2 and len(visits(repeated, 25.0)) == 2
        cold = table.assign(dwell=[1] * 10 + [2] * 10, chamber_setpoint_degc=[25.0] * 10 + [-20.0] * 10)
        found = rate_sets(cold, "A", 0.0)
        assert nearest(found, -15.0).setpoint_degc == -20.0 and len(visits(found, 25.0)) == 1

    def test_a_scan_for_the_threshold_is_no_rate_set(self) -> None:
        rates = [0.0, 1e-4, -1e-4, 2e-4, -2e-4, 3e-4, -3e-4]
        assert rate_sets(points(rates, rates), "A", 0.0, within_dps=1e-3) == []

    def test_too_few_rates_are_no_set(self) -> None:
        assert rate_sets(points([-1.0, 1.0, 2.0], [-1.0, 1.0, 2.0]), "A", 0.0) == []


class TestSmallRates:
    inputs = tuple(k / 3600.0 for k in (-2.0, -1.0, 0.0, 1.0, 2.0))

    def test_responses_are_against_the_point_nearest_no_input_and_divided_by_k(self) -> None:
        outputs = [2.0 * one + 0.5 for one in self.inputs]
        found = small_rates(points([*self.inputs], outputs), "A", 2.0, 3.0 / 3600.0, "rate_reference_dps")
        assert found.applied_dph.tolist() == pytest.approx([-2.0, -1.0, 1.0, 2.0])
        assert found.response_dph.tolist() == pytest.approx([-2.0, -1.0, 1.0, 2.0])
        assert found.u_dph == pytest.approx(np.hypot(1e-6, 1e-6) * 3600.0 / 2.0)

    def test_points_that_failed_are_not_looked_at(self) -> None:
        lost = points([*self.inputs], [0.0] * 5, verdict=["fail"] * 5, reasons=["output frozen"] * 5)
        with pytest.raises(NotRecorded, match="0 points have their input"):
            small_rates(lost, "A", 1.0, 3.0 / 3600.0, "rate_reference_dps")


def test_pooled_noise_has_the_mean_variance_and_the_degrees_of_all() -> None:
    found = pooled([NoiseOfMean(0.1, 2.0, 0.05)] * 5)
    assert (found.u, found.dof, found.white_u) == pytest.approx((0.1, 10.0, 0.05))
    assert pooled([NoiseOfMean(3.0, 1.0, 0.0), NoiseOfMean(4.0, np.inf, 0.0)]).u == pytest.approx(np.sqrt(12.5))


def test_words_keep_the_digits_that_the_uncertainty_allows() -> None:
    even = {"symbol": "K", "value": 1.0000483, "u": 2.03e-5, "low": 1.0000085, "high": 1.0000881}
    assert (value_of(even), expanded_of(even)) == ("1.000048", "± 0.000040")
    needless = {"symbol": "Krw", "value": 0.005, "u": 0.008, "low": 0.0, "high": 0.0459}
    assert (value_of(needless), limits_of(needless)) == ("below 0.0459", "–")
    threshold = {"symbol": "W_th", "value": 0.25, "u": 0.07, "low": 0.0, "high": 0.25}
    assert value_of(threshold) == "0.250" and digits(None, 1.0) == "–"


def test_an_unmeasured_figure_among_others_leaves_the_limit_open() -> None:
    figures = [{"symbol": "B0", "value": -0.3}, {"symbol": "B0", "value": 0.1}]
    assert largest({"figures": figures}, "B0") == 0.3
    assert largest({"figures": [*figures, {"symbol": "B0", "value": None}]}, "B0") is None
    assert largest({}, "B0") is None


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    end = run_campaign(tmp_path_factory.mktemp("calibration"), "quick", QUICK + CALIBRATION, BENCH)
    assert end.outcome == "FAIL" and "Kn in ppm of full scale" in end.message and "N in" not in end.message
    return end.folder


def figures_of(run: Path, dut: str) -> dict[str, dict[str, Any]]:
    document = json.loads((run / "analyses" / "calibration.json").read_text())[dut]
    return {one["symbol"]: one for one in document["figures"]}


def test_every_figure_has_its_definition_source_and_conditions(run: Path) -> None:
    found = figures_of(run, "NAV-1")
    wanted = {"B0", "Bs(1 s)", "Bs(10 s)", "Bs(1 s) detrended", "Bs(10 s) detrended", "K", "F0", "Kn", "Ka"}
    assert set(found) == wanted | {"Qn", "N", "B", "Krw", "R", "sigma_min"}
    assert all(one["definition"] and one["source"] and one["conditions"] for one in found.values())
    assert "not the bias instability" in found["sigma_min"]["definition"]
    assert found["B0"]["conditions"]["k_from"].startswith("rate set of this run at 2")
    conditions = json.loads((run / "analyses" / "calibration.json").read_text())["NAV-1"]["conditions"]
    assert conditions["raw_data"] == raw_hash(run, "NAV-1") and len(conditions["raw_data"]["sha256"]) == 64
    assert conditions["versions"]["fogbench"] and conditions["latitude_deg"] == 40.0
    assert any(rule.startswith("settle: ") for rule in conditions["rules"])


def test_k_is_divided_by_first_and_the_earth_is_taken_off_then(run: Path) -> None:
    found = figures_of(run, "NAV-1")
    about = found["B0"]["conditions"]
    assert about["earth_rate_dph"] == pytest.approx(15.041067 * sin(40.0 * pi / 180.0), rel=1e-6)
    series = pd.read_parquet(run / "series" / "still-NAV-1.parquet")["rate_dps"].to_numpy()[600:]
    assert found["B0"]["value"] == pytest.approx(
        series.mean() * 3600.0 / about["k"] - about["earth_rate_dph"], abs=1e-3
    )


def test_white_noise_sets_the_short_bias_stability(run: Path) -> None:
    found = figures_of(run, "NAV-1")
    # 60 N, the sanity check of the standard's family, N = 0.005 deg/sqrt(h) in the class.
    assert found["Bs(1 s)"]["value"] == pytest.approx(60.0 * 0.005, rel=0.05)
    assert found["N"]["value"] == pytest.approx(0.005, rel=0.05)


def test_verify_makes_the_same_figures_again(run: Path) -> None:
    assert not [finding for check in verify(run).checks for finding in check.findings]
    path = run / "analyses" / "calibration.json"
    text = path.read_text()
    document = json.loads(text)
    document["NAV-1"]["figures"][0]["value"] += 1e-3
    path.write_text(json.dumps(document))
    try:
        assert any("figures / 0 / value" in str(finding) for check in verify(run).checks for finding in check.findings)
    finally:
        path.write_text(text)


def test_the_report_has_the_figures_and_the_allan_curve(run: Path) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    assert "Calibration figures" in page and "Allan deviation" in page and "Bs(10 s) detrended" in page
    assert "what the line leaves at each rate" in page


def test_metrics_prints_figures_limits_and_definitions(run: Path) -> None:
    done = CliRunner().invoke(metrics, [str(run), "--dut", "NAV-1"])
    assert done.exit_code == 0, done.output
    assert "0.01 pass" in done.output and "0.001 FAIL" in done.output and "HIGH-1 of" not in done.output
    assert "B: flat part of the overlapping Allan deviation divided by 0.664" in done.output
    assert "record still: 1800 s after 600 s of warm-up" in done.output
    assert "ppm of reading" not in done.output
    assert "ppm of reading" in CliRunner().invoke(metrics, [str(run), "--tables"]).output
    as_json = json.loads(CliRunner().invoke(metrics, [str(run), "--json"]).output)
    assert as_json["asked"] is True and set(as_json["duts"]) == {"NAV-1", "HIGH-1"}


def test_metrics_of_a_run_without_the_block_are_what_the_data_allow(tmp_path: Path) -> None:
    end = run_campaign(tmp_path, "plain", QUICK, BENCH)
    found = calibrated(end.folder, "NAV-1")
    assert not found.asked and not (end.folder / "analyses" / "calibration.json").exists()
    assert found.spec.static is not None and found.spec.static.record == "still"
    symbols = {one["symbol"] for one in found.documents["NAV-1"]["figures"]}
    assert {"B0", "Bs(100 s)", "N", "K", "Kn"} <= symbols
    done = CliRunner().invoke(metrics, [str(end.folder)])
    assert "no calibration block" in done.output and "K  " in done.output


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"NAV-1": 5}', '{"NAV-1": {"figures": [{}], "tables": {}}}', "[" * 20_000]
)
def test_a_damaged_file_is_said_and_costs_nothing_else(run: Path, text: str) -> None:
    path = run / "analyses" / "calibration.json"
    kept = path.read_text()
    path.write_text(text)
    try:
        page = write_report(run).read_text(encoding="utf-8")
        assert "analyses/calibration.json cannot be read" in page and "Data quality" in page
        done = CliRunner().invoke(metrics, [str(run), "--dut", "NAV-1"])
        assert isinstance(done.exception, FogbenchError) and "fogbench fit" in str(done.exception)
    finally:
        path.write_text(kept)
