"""The reference campaign, whole, as a newcomer runs it: 703 points, two gyros, 158 hours of bench time."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fitting.modelfile import load_model

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.campaign
# What is not looked at here need not be fitted.
MODELS = ("--set", "procedure.analysis.models=[linear, ts_joint]")

# Runs the command line in a process of its own and reports the peak memory of that process.
LAUNCHER = """
import resource, sys
from bench.cli.main import main
try:
    main()
finally:
    print("peak_mb", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, file=sys.stderr)
"""


def fogbench(results: Path, run_id: str, procedure: str, *options: str) -> tuple[dict[str, Any], float]:
    command = [sys.executable, "-c", LAUNCHER, "run", f"procedures/{procedure}", "--bench", "benches/virtual.yaml"]
    command += ["--results", str(results), "--run-id", run_id, "--json", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout), float(done.stderr.split("peak_mb")[1])


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], float]:
    results = tmp_path_factory.mktemp("results")
    summary, peak_mb = fogbench(results, "ts", "temperature_rate_grid.yaml")
    return results / "ts", summary, peak_mb


def test_every_point_of_the_procedure_is_there(campaign: tuple[Path, dict[str, Any], float]) -> None:
    folder, summary, peak_mb = campaign
    points = pd.read_csv(folder / "points.csv")
    grid = [(t, r) for t in range(-30, 61, 5) for r in range(-180, 181, 10) for _ in range(2)]
    assert list(zip(points["chamber_setpoint_degc"], points["rate_setpoint_dps"], strict=True)) == grid
    assert (points["samples"] + points["outliers"] == 1000).all() and (points["frames"] == 60_000).all()
    assert (points["verdict"] == "pass").all()
    assert ((points["ended_at_s"] - points["started_at_s"]).between(599.9, 600.5)).all()
    # the soak: at least 2 h between the last point of a dwell and the first of the next
    first, last = points.groupby("dwell")["started_at_s"].min(), points.groupby("dwell")["ended_at_s"].max()
    assert (first.to_numpy()[1:] - last.to_numpy()[:-1] > 7200.0).all()
    assert summary["duration_s"] > 155 * 3600
    assert peak_mb < 1000
    assert len(list((folder / "raw").glob("*.parquet"))) == 1406
    assert (folder / "report.html").stat().st_size < 3_000_000


def test_the_model_holds_on_points_it_never_saw(campaign: tuple[Path, dict[str, Any], float]) -> None:
    _, summary, _ = campaign
    for models in summary["metrics"].values():
        raw, linear, joint = (
            models[name]["leave_temperatures_out"]["std_dps"] for name in ("none", "linear", "ts_joint")
        )
        assert raw > 3.5 and 1.0 < linear < 2.5
        assert joint < 0.02  # fitting_notes section 5: 0.0153 with these dwell errors, floor 0.0125
        assert models["ts_joint"]["random"]["max_abs_dps"] < 0.14684
        assert models["ts_joint"]["random"]["std_dps"] < 0.02856


def test_the_compensation_recovers_the_truth(campaign: tuple[Path, dict[str, Any], float]) -> None:
    """The saved model against the simulator's own record of what went in, which the product has never read."""
    folder, _, _ = campaign
    points = pd.read_csv(folder / "points.csv")
    truth = pd.read_csv(folder.parent / ".truth" / folder.name / "truth.csv")
    for dut, mine in points.groupby("dut"):
        middle = (mine["started_at_s"] + mine["ended_at_s"]).to_numpy() / 2
        column = truth[f"input_rate_dps:{dut}"].to_numpy()
        true_rate = column[np.searchsorted(truth["t_s"], middle)]
        # the table's own gain error (tens of ppm of 180 deg/s) is in the reference and cannot be seen by the product
        assert np.abs(true_rate - mine["rate_reference_dps"]).max() < 0.05
        model = load_model(folder / "models" / str(dut) / "ts_joint.json")
        compensated = model.predict(mine["dut_temperature_degc"], mine["rate_mean_dps"])
        assert np.std(compensated - true_rate) < 0.02


def test_the_same_seed_gives_the_same_campaign(campaign: tuple[Path, dict[str, Any], float]) -> None:
    folder, _, _ = campaign
    fogbench(folder.parent, "again", "temperature_rate_grid.yaml", "--set", "procedure.raw=none", *MODELS)
    assert (folder.parent / "again" / "points.csv").read_bytes() == (folder / "points.csv").read_bytes()


def test_the_papers_own_count_and_split(tmp_path: Path) -> None:
    summary, _ = fogbench(tmp_path, "paper", "temperature_rate_grid_648.yaml", "--set", "procedure.raw=none", *MODELS)
    assert summary["points"] == 648
    for models in summary["metrics"].values():
        assert models["ts_joint"]["random_train"]["n"] == 448 and models["ts_joint"]["random"]["n"] == 200
