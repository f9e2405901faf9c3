"""Gaps in a uniform record: missing samples are NaN; they split the record or are filled by rule, never closed up."""

import itertools

import numpy as np
from numpy.typing import NDArray

# Samples averaged on each side of a gap: the line drawn through it then carries a third of the noise of one sample.
_NEIGHBOURS = 10


def stretches(rate: NDArray[np.float64]) -> list[tuple[int, int]]:
    """First index and end of every stretch without a missing sample, in order."""
    missing = np.flatnonzero(~np.isfinite(rate))
    edges = np.concatenate([[-1], missing, [len(rate)]])
    return [(int(a) + 1, int(b)) for a, b in itertools.pairwise(edges) if b - a > 1]


def fill_gaps(rate: NDArray[np.float64], longest: int) -> tuple[NDArray[np.float64], int]:
    """Fill gaps of up to `longest` samples by a straight line; return the record (n,) and the number of samples filled.

    The line runs between the means of up to 10 samples on either side. Longer gaps, and gaps at the ends, stay NaN.
    The line has no noise of its own: a share p of filled samples lowers the Allan variance at short times by about p.
    """
    filled = np.array(rate, dtype=np.float64)
    runs = stretches(filled)
    count = 0
    for (first, end), (begin, last) in itertools.pairwise(runs):
        if begin - end > longest:
            continue
        left = filled[max(first, end - _NEIGHBOURS) : end].mean()
        right = rate[begin : min(last, begin + _NEIGHBOURS)].mean()
        filled[end:begin] = np.linspace(left, right, begin - end + 2)[1:-1]
        count += begin - end
    return filled, count
