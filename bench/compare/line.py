"""One line of a comparison, and what a model costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.clock import stopwatch
from fitting.modelfiles.kinds import codec_of, kind_of

# Rows in one timed prediction: long enough for a clock, as many as minutes of frames.
PREDICTED_ROWS = 20_000
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Line:
    """One model on one split of one DUT, over all seeds.

    std_dps, max_dps: (seeds,). floor_dps: median of the noise floors. fit_s: median of the fits. predict_us, of one
    row, and parameters: of the model fitted on all rows; None for the uncompensated output. guarded: largest share of
    rows outside the training range, None if nobody counted.
    """

    run: str
    dut: str
    model: str
    split: str
    std_dps: NDArray[np.float64]
    max_dps: NDArray[np.float64]
    floor_dps: float
    n: int
    fit_s: float | None
    predict_us: float | None
    parameters: int | None
    guarded: float | None

    def as_dict(self) -> dict[str, Any]:
        """Median and worst over the seeds, for JSON and tables."""
        return {
            "run": self.run,
            "dut": self.dut,
            "model": self.model,
            "split": self.split,
            "points": self.n,
            "seeds": len(self.std_dps),
            "std_median_dps": float(np.median(self.std_dps)),
            "std_worst_dps": float(np.max(self.std_dps)),
            "max_median_dps": float(np.median(self.max_dps)),
            "max_worst_dps": float(np.max(self.max_dps)),
            "floor_dps": self.floor_dps,
            "times_floor": float(np.median(self.std_dps)) / self.floor_dps if self.floor_dps else None,
            "fit_s": self.fit_s,
            "predict_us": self.predict_us,
            "parameters": self.parameters,
            "guarded": self.guarded,
        }


def predict_us(model: Any, X: NDArray[np.float64]) -> float:
    """Time of one row in a long prediction, microseconds; the best of three."""
    rows = np.resize(X, (PREDICTED_ROWS, X.shape[1]))
    times = []
    for _ in range(3):
        began = stopwatch()
        model.predict(rows)
        times.append(stopwatch() - began)
    return min(times) / PREDICTED_ROWS * 1e6


def parameters_of(model: Any) -> int | None:
    """Numbers in the model's file that its predictions need; None for a kind that has no file."""
    chosen = getattr(model, "best_estimator_", model)
    try:
        described = codec_of(kind_of(chosen)).describe(chosen)
    except TypeError:
        return None
    return sum(_numbers(value) for key, value in described.items() if not key.endswith("_u"))


def _numbers(value: Any) -> int:
    if isinstance(value, dict):
        return sum(_numbers(inner) for inner in value.values())
    if isinstance(value, list):
        return sum(_numbers(inner) for inner in value)
    return int(isinstance(value, int | float) and not isinstance(value, bool))
