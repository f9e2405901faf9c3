"""Rows that exported code must answer as the model does, before anybody trusts it on another processor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form
from fitting.export.precision import Precision, rounding_bound
from fitting.modelfile import Compensation

_INSIDE, _OUTSIDE, _CORNERS = 12, 8, 4


@dataclass(frozen=True)
class Vector:
    """rows (n, k), what comes out (n,), by how much it may differ (n,), and which rows are outside (n,)."""

    rows: NDArray[np.float64]
    expected: NDArray[np.float64]
    tolerance: NDArray[np.float64]
    outside: NDArray[np.bool_]


def vector(compensation: Compensation, form: Form, precision: Precision) -> Vector:
    """Rows inside, rows beyond each edge and combinations that never occurred, none of them near an edge of anything.

    compensation: as `in_precision` gives it. The rows are drawn with a fixed seed and exact in the precision.
    """
    rng = np.random.default_rng(0)
    drawn = np.vstack([_inside(compensation, rng), _beyond(compensation, rng), _corners(compensation, rng)])
    rows = drawn.astype(precision.dtype).astype(np.float64)
    tolerance = rounding_bound(compensation, form, rows, precision)
    rows, tolerance = rows[np.isfinite(tolerance)], tolerance[np.isfinite(tolerance)]
    expected, outside = compensation.guarded(*rows.T)
    return Vector(rows, expected, tolerance, outside)


def _inside(compensation: Compensation, rng: np.random.Generator) -> NDArray[np.float64]:
    reach = compensation.reach
    held, _ = reach.bring_inside(rng.uniform(reach.low, reach.high, (_INSIDE, len(reach.low))))
    held[0] = reach.centre
    return np.asarray(reach.centre + 0.98 * (held - reach.centre))


def _beyond(compensation: Compensation, rng: np.random.Generator) -> NDArray[np.float64]:
    """Rows beyond one edge, by 20 % to 100 % of the half range."""
    reach = compensation.reach
    rows = np.tile(reach.centre, (_OUTSIDE, 1))
    inputs = rng.permutation(len(reach.low))
    for number, row in enumerate(rows):
        k = inputs[(number // 2) % len(inputs)]
        room = rng.uniform(0.2, 1.0) * reach.half_range[k]
        row[k] = reach.high[k] + room if number % 2 else reach.low[k] - room
    return rows


def _corners(compensation: Compensation, rng: np.random.Generator) -> NDArray[np.float64]:
    """Corners of the box that are far enough outside the range for any rounding to agree."""
    reach = compensation.reach
    corners = np.where(rng.random((_CORNERS, len(reach.low))) < 0.5, reach.low, reach.high)
    held, _ = reach.bring_inside(corners)
    moved = np.abs(held - corners) / reach.half_range
    return np.asarray(corners[moved.max(axis=1) > 0.02])
