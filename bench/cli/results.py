"""Results as text tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.analysis import Judged
from bench.cli.options import table

SPLITS = (("random", "random split"), ("leave_temperatures_out", "temperatures left out"))


def results_table(metrics: dict[str, Any]) -> str:
    """Held-back errors per DUT and model, both splits, with the noise floor."""
    rows = []
    for dut, models in metrics.items():
        for model, splits in models.items():
            figures = [_figure(splits.get(split), key) for split, _ in SPLITS for key in ("max_abs_dps", "std_dps")]
            floor = _figure(splits.get("random") or splits.get("leave_temperatures_out"), "floor_dps")
            rows.append([dut, model, *figures, floor])
    header = ["DUT", "model", "max|e| random", "std random", "max|e| left out", "std left out", "noise floor"]
    return "Errors of held-back points, deg/s (random split, and whole temperatures left out)\n" + table(rows, header)


def _figure(figures: dict[str, Any] | None, key: str) -> str:
    value = (figures or {}).get(key)
    return "–" if value is None else f"{value:.3g}"


def limits_table(limits: Sequence[Judged]) -> str:
    """Each limit, what was measured, pass or fail."""
    rows = []
    for item in limits:
        measured = ", ".join(f"{dut} {'–' if v is None else format(v, '.4g')}" for dut, v in item.measured.items())
        what = f"{item.model}, {item.split}: {item.quantity}"
        rows.append([what, f"{item.limit:g}", measured, "pass" if item.passed else "FAIL"])
    return table(rows, ["limit", "at most", "measured", "judged"])
