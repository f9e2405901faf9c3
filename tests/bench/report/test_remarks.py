import dataclasses
from typing import Any

import numpy as np
import pytest

from bench.report import remarks
from bench.report.data import DutData, ReportData
from bench.report.manifest import Manifest
from bench.report.residuals import HEADLINE_SPLIT


def with_floor(dut: DutData, floor_dps: float) -> DutData:
    metrics = {
        model: {split: {**figures, "floor_dps": floor_dps} for split, figures in splits.items()}
        for model, splits in dut.metrics.items()
    }
    return dataclasses.replace(dut, metrics=metrics)


def with_points(dut: DutData, **values: Any) -> DutData:
    return dataclasses.replace(dut, points=dut.points.assign(**values))


def only_random(dut: DutData) -> DutData:
    metrics = {model: {"random": splits["random"]} for model, splits in dut.metrics.items()}
    return dataclasses.replace(dut, metrics=metrics)


@pytest.mark.parametrize(
    ("outcome", "message", "notes", "reason"),
    [
        ("PASS", "all limits met", [], ""),
        ("ABORTED", "interrupted; made safe", ["a: x"], "interrupted; made safe"),
        ("FAIL", "std over 0.1; a: x; y; a: x; y; b: z", ["a: x; y", "a: x; y", "b: z"], "std over 0.1"),
        ("FAIL", "a: x; b: z", ["a: x", "b: z"], "Not everything could be fitted: see 'Read this first'."),
        ("ERROR", "no reply", ["a: x"], "no reply"),
        ("ERROR", None, None, ""),
    ],
)
def test_the_reason_is_the_message_without_the_notes_listed_below(
    outcome: str, message: str | None, notes: list[str] | None, reason: str
) -> None:
    raw = {"outcome": outcome, "message": message, "notes": notes}
    assert remarks.why(Manifest.from_mapping(raw, "r")) == reason


def test_a_run_without_limits_kept_none(small: ReportData) -> None:
    assert remarks.outcome_words(small.manifest) == "finished, every limit kept"
    assert remarks.outcome_words(dataclasses.replace(small.manifest, limits=())) == "finished; no limits were set"


def test_what_is_left_is_model_and_repeatability(small: ReportData) -> None:
    dut = with_floor(small.duts[0], 0.00005)
    told = remarks.remainder(dut, HEADLINE_SPLIT, 0.0172)
    assert told == (
        "Noise of the samples alone would leave 0.000050 °/s; the rest is model error plus the unit's repeatability "
        "from dwell to dwell: with one visit per temperature this run cannot tell them apart."
    )
    twice = with_points(dut, chamber_setpoint_degc=np.where(dut.points["dwell"] == 4, -30.0, -15.0))
    assert "visited more than once, so points.csv can" in remarks.remainder(twice, HEADLINE_SPLIT, 0.0172)


def test_noise_is_named_where_it_dominates(small: ReportData) -> None:
    told = remarks.remainder(with_floor(small.duts[0], 0.008), HEADLINE_SPLIT, 0.01)
    assert told == "Noise of the samples alone would leave 0.0080 °/s: most of what is left."


def test_points_of_known_dwells_say_little_about_repeatability(small: ReportData) -> None:
    dut = with_floor(small.duts[0], 0.00005)
    assert "hardly in it" in remarks.remainder(dut, "random", 0.01)
    assert "this one dwell only" in remarks.remainder(with_points(dut, dwell=0), "random", 0.01)


def test_residuals_say_which_they_are(small: ReportData) -> None:
    first, second = small.duts
    assert remarks.residual_remarks([first, second])[0].startswith("These residuals are held-out errors: each point")
    mixed = remarks.residual_remarks([first, dataclasses.replace(second, held_out=False)])
    assert mixed[0].startswith("The residuals of DUT gyro-a are held-out errors")
    assert mixed[1] == (
        "The residuals of DUT gyro-b are of the model fitted on all points, so they are smaller than the "
        "leave-temperatures-out figures of section 1; they show what structure is left."
    )
    alone = remarks.residual_remarks([dataclasses.replace(only_random(first), held_out=False)])
    assert "smaller than errors at temperatures left out;" in alone[0]
    assert remarks.residual_remarks([with_points(first, residual_dps=np.nan)]) == []


def test_only_one_visit_makes_the_ends_extrapolated(small: ReportData) -> None:
    dut = small.duts[0]
    assert "the coldest and the warmest are extrapolated" in remarks.residual_remarks([dut])[0]
    assert "extrapolated" not in remarks.residual_remarks([with_points(dut, chamber_setpoint_degc=0.0)])[0]


def test_the_splits_are_told_as_they_were_judged(small: ReportData) -> None:
    assert remarks.judged_on(small.duts).startswith("The headline leaves whole temperatures out")
    assert remarks.judged_on([only_random(small.duts[0])]).startswith("No temperatures could be left out")


def test_a_run_cut_short_does_not_draw_all_its_grid(small: ReportData) -> None:
    assert remarks.not_reached(small.manifest) == ""
    assert "never reached" in remarks.not_reached(dataclasses.replace(small.manifest, points_measured=3))


def test_the_model_shown_is_named_with_its_points(small: ReportData) -> None:
    dut = small.duts[0]
    assert remarks.compensated_by(dut).endswith(", each point predicted by a model that never saw its dwell")
    assert remarks.compensated_by(dataclasses.replace(dut, held_out=False)).endswith(" fitted on all points")


def test_z_scales_are_compared() -> None:
    assert "the right z axis is 200 times finer" in remarks.z_scales(10.0, 0.05)
    assert remarks.z_scales(10.0, None) == ""
