"""Non-negative least squares with a handful of unknowns, for many right-hand sides at once."""

from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray


@cache
def _subsets(size: int) -> tuple[tuple[int, ...], ...]:
    return tuple(chosen for count in range(1, size + 1) for chosen in combinations(range(size), count))


def nonnegative(gram: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """argmin over x >= 0 of x' G x / 2 - b' x for every row b of targets (s, p); gram (p, p), p up to about 6.

    All 2^p - 1 sets of free unknowns are solved, and the best with x >= 0 is taken: exact, and for thousands of rows a
    few matrix products instead of as many active-set searches.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    g, b = gram / np.outer(scale, scale), targets / scale
    best, gain = np.zeros_like(b), np.zeros(len(b))
    for subset in _subsets(len(scale)):
        chosen = list(subset)
        x = _solve(g[np.ix_(chosen, chosen)], b[:, chosen])
        if x is None:
            continue
        gained = np.einsum("sp,sp->s", x, b[:, chosen])
        better = (x >= 0.0).all(axis=1) & (gained > gain)
        best[better] = 0.0
        best[np.ix_(better, chosen)] = x[better]
        gain[better] = gained[better]
    return best / scale


def _solve(gram: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Rows of G^-1 b, or None if the columns depend on each other: a smaller set then does as well."""
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(gram))
    except np.linalg.LinAlgError:
        return None
    return np.asarray(targets @ (inverse.T @ inverse))
