"""Comparisons of models: the same figures as the run's own fit, medians and worst cases, and what is written."""

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

from bench.cli.compare import command
from bench.compare.gather import compare
from bench.compare.line import Line
from bench.errors import UserMistake
from tests.bench.analyses.test_cycles import CYCLES
from tests.bench.campaigns import run_campaign
from tests.bench.test_record import CYCLE


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_campaign(tmp_path_factory.mktemp("compared"), "grid").folder


def line_of(lines: list[Line], dut: str, model: str, split: str) -> Line:
    (found,) = [line for line in lines if (line.dut, line.model, line.split) == (dut, model, split)]
    return found


def test_the_first_seed_is_the_split_of_the_run_itself(run: Path) -> None:
    lines = compare([run], [], seeds=2)
    metrics = json.loads((run / "metrics.json").read_text())
    assert {line.model for line in lines} == {"none", "linear"}
    for dut, models in metrics.items():
        for model, splits in models.items():
            for split, figures in splits.items():
                line = line_of(lines, dut, model, split)
                assert line.std_dps[0] == pytest.approx(figures["std_dps"]) and len(line.std_dps) == 2
                assert line.max_dps[0] == pytest.approx(figures["max_abs_dps"])
    linear = line_of(lines, "FOG-A01", "linear", "random")
    assert linear.std_dps[0] != linear.std_dps[1]
    assert linear.parameters == 3 and linear.predict_us is not None and linear.fit_s is not None


def test_median_and_worst_are_over_the_seeds() -> None:
    line = Line(
        "r", "d", "m", "random", np.array([1.0, 5.0, 2.0]), np.array([3.0, 1.0, 9.0]), 0.5, 9, None, None, 3, None
    )
    about = line.as_dict()
    assert (about["std_median_dps"], about["std_worst_dps"]) == (2.0, 5.0)
    assert (about["max_median_dps"], about["max_worst_dps"], about["times_floor"]) == (3.0, 9.0, 4.0)


def test_the_command_writes_a_table_and_a_figure(run: Path, tmp_path: Path) -> None:
    arguments = [str(run), "--models", "linear,ts_joint", "--seeds", "1", "-o", str(tmp_path)]
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 0, done.output
    assert "FOG-B01 of grid" in done.output and "ts_joint" in done.output
    rows = list(csv.DictReader((tmp_path / "compare.csv").open()))
    assert {row["model"] for row in rows} == {"none", "linear", "ts_joint"}
    assert all(float(row["std_median_dps"]) > 0 for row in rows)
    picture = ElementTree.parse(tmp_path / "compare.svg").getroot()
    assert picture.tag.endswith("svg") and "T-S joint" in "".join(picture.itertext())


def test_cycle_models_are_compared_on_the_tests_of_their_procedure(tmp_path: Path) -> None:
    folder = run_campaign(tmp_path, "cycles", CYCLES).folder
    lines = compare([folder], ["linear", "bp_network"], seeds=3)
    figures = json.loads((folder / "analyses" / "cycles.json").read_text())["FOG-A01"]["linear"]
    assert {line.split for line in lines} == {"train", "second", "warming"}
    linear = line_of(lines, "FOG-A01", "linear", "second")
    assert linear.std_dps.tolist() == [pytest.approx(figures["second"]["std_dps"])] and linear.parameters
    # a network starts anew with every seed, a straight line has nothing to draw
    network = line_of(lines, "FOG-A01", "bp_network", "second")
    assert len(set(network.std_dps.tolist())) == 3


def test_what_cannot_be_compared(run: Path, tmp_path: Path) -> None:
    with pytest.raises(UserMistake, match=r"unknown model 'lineer'.*Did you mean linear"):
        compare([run], ["lineer"], seeds=1)
    recorded = run_campaign(tmp_path, "recorded", CYCLE).folder
    with pytest.raises(UserMistake, match="no points and no cycles"):
        compare([recorded], ["linear"], seeds=1)
