"""The noise a DUT usually has: what counts as comparable, and that a journal gives it back."""

from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.noise import REMEMBERED, NoiseHistory
from bench.procedure.language import Acquire
from bench.resume import prepare_resume
from bench.run import run
from tests.bench.campaigns import GRID, run_campaign
from tests.bench.test_points import STEP
from tests.bench.test_resume import STEPS_TO_POINT_9, interrupted_run

ARGS = Acquire.model_validate({"count": 100, "every": "0.1 s"})
OTHER = Acquire.model_validate({"count": 100, "every": "0.2 s"})


def row(std: float | None, rate: float | None = 100.0, verdict: str = "pass", dut: str = "A", point: int = 1) -> Any:
    return {"dut": dut, "rate_std_dps": std, "rate_setpoint_dps": rate, "verdict": verdict, "point": point}


def history(*rows: Any, args: Acquire = ARGS) -> NoiseHistory:
    noise = NoiseHistory()
    for one in rows:
        noise.add(one, args)
    return noise


def test_it_is_the_median_once_there_are_enough() -> None:
    noise = history(*(row(std) for std in (1.0, 3.0, 2.0, 50.0)))
    assert noise.typical_dps("A", 100.0, ARGS, 5) is None
    noise.add(row(2.5), ARGS)
    assert noise.typical_dps("A", 100.0, ARGS, 5) == 2.5


@pytest.mark.parametrize("useless", [row(9.0, verdict="fail"), row(None), row(0.0)])
def test_failed_points_and_points_without_noise_are_no_measure(useless: Any) -> None:
    assert history(useless).typical_dps("A", 100.0, ARGS, 1) is None


@pytest.mark.parametrize(
    ("rate", "other", "alike"),
    [
        (100.0, 50.0, True),
        (100.0, -200.0, True),
        (100.0, 49.0, False),
        (0.0, 1.9, True),
        (0.0, 10.0, False),
        (None, None, True),
        (0.0, None, True),
    ],
)
def test_rates_within_a_factor_of_two_are_comparable(rate: float | None, other: float | None, alike: bool) -> None:
    assert (history(row(1.0, rate)).typical_dps("A", other, ARGS, 1) == 1.0) is alike


def test_another_dut_and_another_sampling_are_not_comparable() -> None:
    noise = history(row(1.0))
    assert noise.typical_dps("B", 100.0, ARGS, 1) is None
    assert noise.typical_dps("A", 100.0, OTHER, 1) is None
    newest = ARGS.model_copy(update={"take": "newest"})
    assert noise.typical_dps("A", 100.0, newest, 1) is None


def test_it_follows_a_gyro_that_ages() -> None:
    noise = history(*(row(1.0) for _ in range(100)), *(row(3.0) for _ in range(REMEMBERED)))
    assert noise.typical_dps("A", 100.0, ARGS, 5) == 3.0


@given(st.lists(st.floats(1e-6, 1e3), min_size=1, max_size=REMEMBERED))
def test_it_is_that_of_the_standard_library(stds: list[float]) -> None:
    assert history(*(row(std) for std in stds)).typical_dps("A", 100.0, ARGS, 1) == median(stds)


def test_a_journal_gives_back_what_was_known() -> None:
    plan = [replace(STEP, number=n, point=n, args=ARGS if n < 4 else OTHER) for n in range(1, 6)]
    rows = [row(float(n), point=n) for n in range(1, 6)] + [row(99.0, point=77)]
    noise = NoiseHistory()
    noise.fold(rows, plan)
    assert noise.typical_dps("A", 100.0, ARGS, 3) == 2.0
    assert noise.typical_dps("A", 100.0, OTHER, 2) == 4.5


def louder(monkeypatch: pytest.MonkeyPatch, sigma_dps: float, from_frame: int) -> None:
    """Every gyro has this much more noise, frame by frame, from a frame on."""
    from simulated_hw.physics.gyro import GyroUnit

    quiet = GyroUnit.block

    def block(self: Any, first: int, end: int) -> Any:
        made = quiet(self, first, end)
        more = np.random.default_rng(first).normal(0.0, sigma_dps, end - first)
        more[: max(0, min(end, from_frame) - first)] = 0.0
        return replace(made, rate_dps=made.rate_dps + more)

    monkeypatch.setattr(GyroUnit, "block", block)


def test_a_gyro_that_becomes_noisy_fails_its_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty times the noise of before. At rest there is one point a dwell, so that two before are too few at first."""
    louder(monkeypatch, 1.0, from_frame=225_000)
    procedure = GRID.replace("quality: {", "quality: {repeats: 0, noise_history: 2, ")
    end = run_campaign(tmp_path, "loud", procedure)
    points = pd.read_csv(end.folder / "points.csv", keep_default_na=False)
    quiet, loud = points.query("ended_at_s < 2250"), points.query("started_at_s > 2251 and rate_setpoint_dps != 0")
    assert end.outcome == "FAIL" and len(quiet) == 14 and (quiet["verdict"] == "pass").all()
    assert len(loud) == 36 and (loud["verdict"] == "fail").all()
    assert loud["reasons"].str.match(r"noise against the DUT's own \d+(\.\d+)? over 2$").all()


def test_a_resumed_run_knows_the_noise_from_before(tmp_path: Path) -> None:
    folder = interrupted_run(tmp_path, at_point=STEPS_TO_POINT_9)
    before = pd.read_csv(folder / "points.csv")
    assert before["noise_ratio"].isna().any()
    run(prepare_resume(folder))
    after = pd.read_csv(folder / "points.csv").iloc[len(before) :].query("rate_setpoint_dps != 0")
    assert after["noise_ratio"].between(0.3, 2.0).all()
