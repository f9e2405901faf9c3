"""Results as text tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.analyses.context import Judged
from bench.cli.options import table
from bench.quantities import shown

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
        as_shown = shown(item.quantity, item.limit)
        values = {dut: "–" if v is None else f"{v * as_shown.factor:.4g}" for dut, v in item.measured.items()}
        what = f"{item.model}, {item.split.replace('_', ' ')}: {as_shown.words}"
        measured = ", ".join(f"{dut} {value}" for dut, value in values.items())
        rows.append([what, as_shown.text(item.limit), measured, "pass" if item.passed else "FAIL"])
    return table(rows, ["limit", "at most", "measured", "judged"])
