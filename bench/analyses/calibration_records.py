"""Records at rest as a calibration takes them: without warm-up and outliers, gaps filled by rule, all of it counted."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.reduction import outliers, slope
from bench.series import Columns, read_parts
from fitting.random_errors.gaps import fill_gaps, stretches

Floats = NDArray[np.float64]

# An outlier is far from its neighbours, not from the record: drift and ramps make none. Up to five rows in a row.
MEDIAN_ROWS = 11
# Gaps up to this many rows are filled by a straight line; at longer ones the record is cut.
LONGEST_GAP = 10
OUTLIER_RULE = f"6 scaled MAD from the running median of {MEDIAN_ROWS} rows"
GAP_RULE = f"up to {LONGEST_GAP} rows by a straight line; cut at longer gaps, the longest part is used"


class NotRecorded(ValueError):
    """A figure cannot be made from what was recorded; the message says why."""


@dataclass(frozen=True)
class RestRecord:
    """One record of one DUT: output and temperature (n,) every `every_s`, no sample missing, and what was done to it.

    t_s: since the record began. missing: rows without a frame; filled, cut: of these and of the outliers, those that
    were filled, and those left out with the part they lie in.
    """

    label: str
    every_s: float
    t_s: Floats
    output_dps: Floats
    temperature_degc: Floats
    setpoint_degc: float | None
    warm_up_s: float
    outliers: int
    missing: int
    filled: int
    cut: int
    frames_lost: int

    @property
    def length_s(self) -> float:
        """Time that the rows cover."""
        return len(self.output_dps) * self.every_s

    @property
    def mean_degc(self) -> float:
        """Mean temperature of the DUT's own sensor."""
        return float(self.temperature_degc.mean())

    def conditions(self) -> dict[str, Any]:
        """What must stand beside every figure of it (gyro test metrics, section 11)."""
        return {
            "record": self.label,
            "record_length_s": self.length_s,
            "row_s": self.every_s,
            "warm_up_cut_s": self.warm_up_s,
            "dut_temperature_degc": {
                "min": float(self.temperature_degc.min()),
                "mean": self.mean_degc,
                "max": float(self.temperature_degc.max()),
                "slope_degc_min": slope(self.t_s / 60.0, self.temperature_degc),
            },
            "chamber_setpoint_degc": self.setpoint_degc,
            "outliers": self.outliers,
            "rows_missing": self.missing,
            "rows_filled": self.filled,
            "rows_cut": self.cut,
            "frames_lost": self.frames_lost,
        }


def abouts_of(series: Sequence[Mapping[str, Any]], dut: str, name: str) -> list[Mapping[str, Any]]:
    """What the journal says of a DUT's records `name`, `name-2` …, in the order made. NotRecorded if there is none."""
    called = re.compile(rf"{re.escape(name)}(-\d+)?")
    found = [one for one in series if one["dut"] == dut and called.fullmatch(str(one["label"]))]
    failed = [f"'{one['label']}' ({one['reasons']})" for one in found if one["verdict"] == "fail"]
    good = sorted((one for one in found if one["verdict"] != "fail"), key=lambda one: int(one["record"]))
    if not good:
        raise NotRecorded(f"no record '{name}' can be used" + (f": {', '.join(failed)} failed" if failed else ""))
    return good


def rest_record(folder: Path, about: Mapping[str, Any], warm_up_s: float) -> RestRecord:
    """Read one record. Raises NotRecorded, or what reading its parts raises."""
    return from_columns(read_parts(folder, about), about, warm_up_s)


def from_columns(series: Columns, about: Mapping[str, Any], warm_up_s: float) -> RestRecord:
    """A record from its rows; `about` as the journal has it."""
    if "temperature_degc" not in series:
        raise NotRecorded(f"record '{about['label']}' has no temperature of the DUT")
    since = np.asarray(series["t_s"], dtype=np.float64) - about["started_at_s"]
    used = since >= warm_up_s
    output, temperature = (
        np.asarray(series[name], dtype=np.float64)[used] for name in ("rate_dps", "temperature_degc")
    )
    missing = int(np.count_nonzero(~np.isfinite(output)))
    far = outliers_of(output)
    output = np.where(far, np.nan, output)
    whole, filled, part = without_gaps(output, str(about["label"]))
    return RestRecord(
        str(about["label"]),
        float(about["every_s"]),
        since[used][part],
        whole,
        fill_gaps(temperature[part], len(whole))[0] if np.isnan(temperature[part]).any() else temperature[part],
        about["temperature_degc"],
        warm_up_s,
        int(far.sum()),
        missing,
        filled,
        len(output) - len(whole),
        int(about["losses"].get("lost", 0)),
    )


def outliers_of(output: Floats) -> NDArray[np.bool_]:
    """Rows that the rule above leaves out."""
    from scipy.ndimage import median_filter

    present = np.isfinite(output)
    found = np.zeros(len(output), dtype=np.bool_)
    rows = output[present]
    if len(rows) > MEDIAN_ROWS:
        found[present] = outliers(rows - median_filter(rows, MEDIAN_ROWS, mode="nearest"))
    return found


def without_gaps(output: Floats, label: str) -> tuple[Floats, int, slice]:
    """The longest part without a gap once short gaps are filled, how many of its rows are filled, and where it is."""
    filled, _ = fill_gaps(output, LONGEST_GAP)
    runs = stretches(filled)
    if not runs:
        raise NotRecorded(f"record '{label}' has no row left")
    first, end = max(runs, key=lambda run: run[1] - run[0])
    part = slice(first, end)
    return filled[part], int(np.count_nonzero(~np.isfinite(output[part]))), part
