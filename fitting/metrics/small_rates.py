"""Threshold, resolution and dead zone: what a gyro makes of rates next to nothing.

50 % criterion: a rate is felt when the output changes by at least half of what it should. Small rates come from the
earth's rotation: input axis horizontal, turned by small angles about east.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitting.metrics.figure import Figure

_CRITERION = 0.5
# The noise of a mean may be a tenth of the smallest step (gyro test metrics, section 6).
_NOISE_SHARE = 0.1
_SOURCE = "GJB 2426A threshold and resolution, 50 % criterion"


def dwell_s(arw_deg_sqrt_h: float, step_dph: float) -> float:
    """Averaging time that brings the noise of a mean to a tenth of a step: (600 N / step)^2.

    >>> round(dwell_s(0.005, 0.1))
    900
    """
    return (60.0 * arw_deg_sqrt_h / (_NOISE_SHARE * step_dph)) ** 2


@dataclass(frozen=True)
class _Response:
    """Sorted |applied| and whether the output followed, of one side."""

    applied: NDArray[np.float64]
    felt: NDArray[np.bool_]

    def bracket(self) -> tuple[float, float]:
        """Largest rate that was not felt (0 if all were) and the smallest from which on every one was."""
        silent = np.flatnonzero(~self.felt)
        last = int(silent[-1]) if len(silent) else -1
        if last == len(self.felt) - 1:
            raise ValueError(f"even {self.applied[-1]:g} deg/h was not felt. Apply larger rates")
        return (float(self.applied[last]) if last >= 0 else 0.0), float(self.applied[last + 1])


def _sides(applied_dph: ArrayLike, response_dph: ArrayLike, response_u_dph: float, what: str) -> list[_Response]:
    applied, response = (np.asarray(values, dtype=np.float64) for values in (applied_dph, response_dph))
    moved = applied != 0.0
    smallest = float(np.abs(applied[moved]).min(initial=np.inf))
    if not response_u_dph <= _NOISE_SHARE * smallest:
        raise ValueError(
            f"{what}: the means are known to {response_u_dph:g} deg/h and the smallest step is {smallest:g} deg/h. "
            f"Allowed: a tenth of it. Average longer"
        )
    sides = []
    for sign in (1.0, -1.0):
        rows = np.flatnonzero(sign * applied > 0.0)
        rows = rows[np.argsort(np.abs(applied[rows]), kind="stable")]
        if len(rows):
            felt = response[rows] / applied[rows] >= _CRITERION
            sides.append(_Response(np.abs(applied[rows]), felt))
    return sides


def threshold(applied_dph: ArrayLike, response_dph: ArrayLike, response_u_dph: float) -> Figure:
    """W_th: the smallest rate from zero that is felt, with every larger one, in the worse direction, in deg/h.

    applied_dph (m,): known input rates; response_dph (m,): output minus output at zero rate, divided by K;
    response_u_dph: standard uncertainty of one response. ValueError: noise above a tenth of the smallest rate, or
    nothing felt.
    """
    return _worst("threshold", "W_th", "input rate", applied_dph, response_dph, response_u_dph)


def resolution(steps_dph: ArrayLike, response_dph: ArrayLike, response_u_dph: float, about_dph: float) -> Figure:
    """W_res: the same for changes steps_dph (m,) around an input rate of about_dph."""
    what = f"change around an input of {about_dph:g} deg/h"
    return _worst("resolution", "W_res", what, steps_dph, response_dph, response_u_dph)


def _worst(name: str, symbol: str, what: str, applied: ArrayLike, response: ArrayLike, u: float) -> Figure:
    """The bracket of the worse side; the true limit lies anywhere in it: rectangular, width / sqrt(12)."""
    brackets = [side.bracket() for side in _sides(applied, response, u, name)]
    silent, felt = max(brackets, key=lambda bracket: bracket[1])
    return Figure(
        name,
        symbol,
        felt,
        "deg/h",
        (felt - silent) / float(np.sqrt(12.0)),
        silent,
        felt,
        int(np.size(applied)),
        f"smallest {what} with at least {100 * _CRITERION:g} % of the expected change of output, as have all larger "
        "ones; the worse direction; limits: the largest not felt, and the value",
        _SOURCE,
    )


def dead_zone(applied_dph: ArrayLike, response_dph: ArrayLike, response_u_dph: float) -> Figure:
    """W_dz: width of the range of input rates about zero with less than half of the expected response, in deg/h.

    Both directions are needed. Its limits take the true edges anywhere between the steps.
    """
    sides = _sides(applied_dph, response_dph, response_u_dph, "dead zone")
    if len(sides) < 2:
        raise ValueError("rates of one direction only. Allowed: a slow scan through zero")
    brackets = np.array([side.bracket() for side in sides])
    silent, felt = brackets.sum(axis=0)
    u = float(np.sqrt(np.sum((brackets[:, 1] - brackets[:, 0]) ** 2) / 12.0))
    return Figure(
        "dead zone",
        "W_dz",
        float(silent),
        "deg/h",
        u,
        float(silent),
        float(felt),
        int(np.size(applied_dph)),
        f"width between the outermost input rates, one in each direction, with less than {100 * _CRITERION:g} % of the "
        "expected output; limits: none or all of the next step belongs to it",
        _SOURCE,
    )
