"""Sentences of the report that depend on what the run has: how it ended, what was judged, what the figures show."""

from __future__ import annotations

from collections.abc import Sequence

from bench.report.data import UNCOMPENSATED, DutData
from bench.report.formats import listed, ratio, significant
from bench.report.manifest import Manifest
from bench.report.residuals import HEADLINE_SPLIT
from bench.report.wording import model_name

OUTCOME_WORDS = {
    "PASS": "finished, every limit kept",
    "FAIL": "finished, not passed",
    "ERROR": "the bench failed",
    "ABORTED": "interrupted",
    "UNKNOWN": "no outcome recorded",
}
# Above this share of the std (half of the variance), noise is most of what is left.
MOSTLY_NOISE = 0.7
UNSEEN = "each point predicted by a model that never saw its dwell"


def outcome_words(manifest: Manifest) -> str:
    """What the outcome means, in a few words."""
    if manifest.outcome == "PASS" and not manifest.limits:
        return "finished; no limits were set"
    return OUTCOME_WORDS[manifest.outcome]


def why(manifest: Manifest) -> str:
    """Why the run did not pass, without the notes that are listed below it; empty for a run that passed."""
    if manifest.outcome == "PASS":
        return ""
    message = manifest.message
    for note in reversed(manifest.notes):
        while message.endswith(note):
            message = message.removesuffix(note).removesuffix("; ")
    return message if message or not manifest.message else "Not everything could be fitted: see 'Read this first'."


def remainder(dut: DutData, split: str, after_dps: float) -> str:
    """What the error after compensation is made of, as far as this run can tell."""
    floor = dut.floor_dps
    noise = "" if floor is None else f"Noise of the samples alone would leave {significant(floor, 2)} °/s"
    if floor is not None and floor > MOSTLY_NOISE * after_dps:
        return f"{noise}: most of what is left."
    start = f"{noise}; the rest is" if noise else "What is left is"
    if split != HEADLINE_SPLIT:
        return f"{start} model error. {_shared_dwells(dut)}"
    if dut.revisited:
        apart = "some temperatures were visited more than once, so points.csv can tell them apart; this report does not"
    else:
        apart = "with one visit per temperature this run cannot tell them apart"
    return f"{start} model error plus the unit's repeatability from dwell to dwell: {apart}."


def _shared_dwells(dut: DutData) -> str:
    if dut.usable["dwell"].nunique() > 1:
        return "Repeatability from dwell to dwell is hardly in it: each dwell also has points the model was fitted to."
    return "It holds for this one dwell only: nothing is said about other temperatures or about repeatability."


def judged_on(duts: Sequence[DutData]) -> str:
    """What the two splits are worth, according to which of them this run was judged on."""
    flatters = "it flatters every model, since errors common to a dwell are in the training set too."
    if any(dut.figure(UNCOMPENSATED, HEADLINE_SPLIT, "n") for dut in duts):
        return (
            "The headline leaves whole temperatures out: each point is predicted by a model that never saw its dwell. "
            f"The random split is beside it because published figures use it; {flatters}"
        )
    return f"No temperatures could be left out, so only the random split was judged: {flatters}"


def residual_remarks(duts: Sequence[DutData]) -> list[str]:
    """One sentence for the DUTs with held-out residuals, one for the others; naming them if there are both."""
    shown = [dut for dut in duts if dut.usable["residual_dps"].notna().any()]
    held_out = [dut for dut in shown if dut.held_out]
    in_sample = [dut for dut in shown if not dut.held_out]
    remarks = []
    if held_out:
        revisited = any(dut.revisited for dut in held_out)
        unseen = "a dwell that was not calibrated" if revisited else "a temperature that was not calibrated"
        ends = "" if revisited else "; the coldest and the warmest are extrapolated"
        remarks.append(
            f"{_whose(held_out, shown)} are held-out errors: {UNSEEN}, so their spread is the leave-temperatures-out "
            f"std of section 1. They show what {unseen} would get{ends}."
        )
    if in_sample:
        judged = any(dut.figure(dut.model or UNCOMPENSATED, HEADLINE_SPLIT, "std_dps") is not None for dut in in_sample)
        figures = "the leave-temperatures-out figures of section 1" if judged else "errors at temperatures left out"
        remarks.append(
            f"{_whose(in_sample, shown)} are of the model fitted on all points, so they are smaller than {figures}; "
            "they show what structure is left."
        )
    return [*remarks, "Points with verdict fail are left out."] if remarks else []


def _whose(some: Sequence[DutData], shown: Sequence[DutData]) -> str:
    names = listed([f"DUT {dut.name}" for dut in some])
    return "These residuals" if len(some) == len(shown) else f"The residuals of {names}"


def compensated_by(dut: DutData) -> str:
    """The model whose error is shown, and on which points it was fitted."""
    name = model_name(dut.model or UNCOMPENSATED)
    return f"{name}, {UNSEEN}" if dut.held_out else f"{name} fitted on all points"


def z_scales(before_dps: float | None, after_dps: float | None) -> str:
    """How much finer the z axis of the compensated surface is."""
    if before_dps is None or after_dps is None:
        return ""
    return (
        f"Largest magnitude {significant(before_dps)} °/s before and {significant(after_dps)} °/s after: the right z "
        f"axis is {ratio(before_dps, after_dps)} times finer than the left one."
    )


def not_reached(manifest: Manifest) -> str:
    """That a run cut short has no cells for the setpoints it never came to; empty for a whole run."""
    planned, measured = manifest.points_planned, manifest.points_measured
    cut_short = planned is not None and measured is not None and measured < planned
    return " Setpoints that the run never reached are not drawn." if cut_short else ""
