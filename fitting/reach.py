"""Where a model may be trusted: the range its training rows cover, and how a row outside is brought back to it.

The range is a polytope with fixed directions (a discrete oriented polytope, Klosowski et al., IEEE TVCG 4(1), 1998):
the limits of every input, and the limits of the sums and differences of every two inputs, each scaled by its own
range. The first are the training box; the second cut off the combinations that never occurred, such as one
temperature sensor far from its neighbour. It is a handful of numbers for any amount of data, needs no search, and
exists for data that lie on a line, where a convex hull does not.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

# Room beyond the largest sum and difference met, in halves of the range of an input: another cycle repeats the lag
# between two sensors only so well. The box itself has no room.
MARGIN = 0.05
# More inputs than this keep only their box: sums and differences grow with the square of their number.
MOST_PAIRED = 32


@dataclass(frozen=True)
class Reach:
    """The range of k inputs, in their units.

    low, high: the training box, (k,). centre: mean of the training rows, (k,). sums, differences: smallest and largest
    s_i + s_j and s_i - s_j over the training rows, of shape (2, p) for the p = k (k - 1) / 2 pairs i < j in the order
    of `itertools.combinations`, with s = (x - centre) / half range; None keeps the box only.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    centre: NDArray[np.float64]
    sums: NDArray[np.float64] | None = None
    differences: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, inputs: NDArray[np.float64]) -> "Reach":
        """Measure training rows (n >= 1, k), finite."""
        low, high = inputs.min(axis=0), inputs.max(axis=0)
        box = cls(low, high, np.clip(inputs.mean(axis=0), low, high))
        if not 2 <= inputs.shape[1] <= MOST_PAIRED:
            return box
        scaled = (inputs - box.centre) / box.half_range
        first, second = np.array(list(combinations(range(inputs.shape[1]), 2))).T
        sums, differences = scaled[:, first] + scaled[:, second], scaled[:, first] - scaled[:, second]
        limits = [np.array([pairs.min(axis=0), pairs.max(axis=0)]) for pairs in (sums, differences)]
        return cls(low, high, box.centre, *limits)

    @property
    def half_range(self) -> NDArray[np.float64]:
        """Half the range of every input, 1 for a constant one, (k,)."""
        half = 0.5 * (self.high - self.low)
        return np.where(half > 0.0, half, 1.0)

    def bring_inside(self, inputs: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Rows (n, k) as the model may see them, and which of them (n,) were outside.

        Every input is first held at the edge of its box; a combination that never occurred is then moved straight
        towards the centre until it is one that did. Rows inside stay as they are, to the last bit; a row with a NaN
        stays NaN and counts as outside.
        """
        held = np.clip(inputs, self.low, self.high)
        if self.sums is not None and self.differences is not None:
            share = self._share(held)
            pulled = self.centre + share[:, np.newaxis] * (held - self.centre)
            held = np.where(share[:, np.newaxis] < 1.0, pulled, held)
        return held, np.asarray((held != inputs).any(axis=1))

    def _share(self, held: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far from the centre each row may go, as a share of where it is: 1 for a combination that occurred."""
        scaled = ((held - self.centre) / self.half_range).T
        share = np.ones(len(held))
        assert self.sums is not None and self.differences is not None
        for p, (i, j) in enumerate(combinations(range(len(scaled)), 2)):
            for limits, value in ((self.sums, scaled[i] + scaled[j]), (self.differences, scaled[i] - scaled[j])):
                limit = np.where(value > 0.0, limits[1, p] + MARGIN, limits[0, p] - MARGIN)
                with np.errstate(divide="ignore", invalid="ignore"):
                    share = np.fmin(share, np.where(value == 0.0, 1.0, limit / value))
        return share
