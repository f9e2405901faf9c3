"""What of a calibration block is known before hour 0 to be wrong: each mistake with its place and what is allowed."""

from pathlib import Path

import pytest

from bench.check import check
from bench.procedure.calibration import CalibrationAnalysis, figure_unit
from tests.bench.campaigns import ROOT
from tests.bench.checking import BENCH, checked, mistakes

SITED = BENCH.replace("bench: b\n", "bench: b\nsite: {latitude: 40 deg}\n")
STILL = "  - set_rate: 0 deg/s\n  - record: {name: still, every: 1 s, steps: [{dwell: 1 h}]}\n"
RATES = "  - sweep:\n      rate: [-3 deg/s, -2 deg/s, -1 deg/s, 0 deg/s, 1 deg/s, 2 deg/s, 3 deg/s]\n"
ACQUIRED = f"{RATES}      steps: [{{acquire: {{count: 5, every: 1 s}}}}]\n"


def block(text: str) -> str:
    return f"calibration:\n  {text}\n"


@pytest.mark.parametrize(
    ("steps", "calibration", "problem"),
    [
        (STILL, "static: {record: stil}", "there is no record 'stil'. Allowed: still. Did you mean still?"),
        (STILL, "temperature: {ramps: other}", "there is no record 'other'. Allowed: still."),
        (STILL, "static: {record: still, blocks: [1500 ms]}", "1.5 s is no whole number of rows: record 'still' has"),
        (STILL, "temperature: {soaks: still}", "one record 'still' is no dependence on temperature."),
        (STILL, "power_cycles: {record: still}", "one record 'still' has no repeatability."),
        (STILL, "scale_factor: {}", "no temperature has points at 3 rates in each direction"),
        (
            ACQUIRED,
            "scale_factor: {}\n  limits: [{figure: Bt, max: 1 deg/h/degC}]",
            "Bt is not made: that takes a block 'temperature:'.",
        ),
        (ACQUIRED, "threshold: {span: 3 deg/h}", "no scan through zero: within ± 3 deg/h of it are 0 points"),
    ],
)
def test_records_points_and_limits_that_there_are_not(
    tmp_path: Path, steps: str, calibration: str, problem: str
) -> None:
    (found,) = mistakes(tmp_path, steps, tail=block(calibration), bench=SITED)
    place, _, said = found.partition(": ")
    assert said.startswith(problem), found
    line = int(place.split(":")[1])
    assert "calibration" in (tmp_path / "p.yaml").read_text().splitlines()[line - 2] or line > 10


@pytest.mark.parametrize(
    ("limit", "problem"),
    [
        ("{figure: Bs, max: 1 deg/h}", "there is no figure 'Bs'."),
        ("{figure: Kn, max: 1 ppm}", "'1 ppm' is no limit on Kn. Allowed: a number in ppm of full scale"),
        ("{figure: N, max: 0.005}", "'0.005' is no limit on N. Allowed: a number in deg/sqrt(h)"),
    ],
)
def test_a_limit_is_on_a_figure_in_its_unit(tmp_path: Path, limit: str, problem: str) -> None:
    text = block(f"static: {{record: still}}\n  limits: [{limit}]")
    (found,) = mistakes(tmp_path, STILL, tail=text, bench=SITED)
    assert problem in found


def test_a_block_that_reports_nothing_and_a_band_without_power_are_refused(tmp_path: Path) -> None:
    assert "'calibration' reports nothing" in mistakes(tmp_path, STILL, tail=block("k: {value: 1.0}"), bench=SITED)[0]
    text = block("power_cycles: {record: still, between: thermal_excursion, band: 1 deg/h}")
    assert "needs between: power_off" in mistakes(tmp_path, STILL, tail=text, bench=SITED)[0]
    text = block("temperature: {room: 25 degC}")
    assert "'temperature' needs records" in mistakes(tmp_path, STILL, tail=text, bench=SITED)[0]


def test_a_bias_needs_the_latitude_a_scale_factor_does_not(tmp_path: Path) -> None:
    (found,) = mistakes(tmp_path, STILL, tail=block("static: {record: still}"))
    assert found.startswith("b.yaml:1:1: a bias is known only where the earth's rotation is")
    checked(tmp_path, ACQUIRED, tail=block("scale_factor: {}"))


def test_units_of_figures() -> None:
    assert figure_unit("BsT(100 s)") == figure_unit("Bs(1 s) detrended") == "deg/h"
    assert figure_unit("Krw") == "deg/h/sqrt(h)" and figure_unit("Bs()") is None
    limit = CalibrationAnalysis.model_validate(
        {"scale_factor": {}, "limits": [{"figure": "Kn", "max": "1e1 ppm of full scale"}]}
    ).limits[0]
    assert limit.value == 10.0


@pytest.mark.parametrize("name", ["static", "scale_factor", "temperature_ramps", "power_cycles", "threshold"])
def test_the_procedures_pass_their_check(name: str) -> None:
    check(ROOT / "procedures" / f"{name}.yaml", ROOT / "benches" / "virtual_metrics.yaml")
