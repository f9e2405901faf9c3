"""Where the joint optimisation starts from: grids of quantiles, plain and shifted, and Gustafson-Kessel runs.

Measured on surface A and three other surfaces: no single start is best on all of them. The plain grid is reliable;
a grid shifted past one end of an input finds the gently bent planes that neighbouring rules make far from their
centres; a Gustafson-Kessel run cut short differs from seed to seed, where a finished one ends in two or three optima.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fitting.gustafson_kessel import Clustering, gustafson_kessel, random_partitions
from fitting.rules import Antecedents
from fitting.scaling import Scaling

_PLAIN_WIDTH, _SHIFTED_WIDTH = 0.8, 1.2  # in z-scores
_SHIFT = 2.0  # in z-scores: just outside the data of a grid campaign
_SHORT_RUN = 20  # sweeps
_SMALLEST_WIDTH = 1e-3  # in z-scores: a cluster that has shrunk onto one point still has a width


@dataclass(frozen=True)
class Start:
    """Antecedents in z-scores; sets: how many fuzzy sets each input has if they are a grid, else None."""

    antecedents: Antecedents
    sets: tuple[int, ...] | None


def projected(clustering: Clustering, inputs: NDArray[np.float64]) -> Antecedents:
    """Antecedents of clusters in the product space: sigma_jk^2 = sum_i mu_ji (x_ki - v_jk)^2 / sum_i mu_ji.

    inputs: (n, d), the first d coordinates of the clustered points.
    """
    centres = clustering.centres[:, : inputs.shape[1]]
    weights = clustering.memberships / clustering.memberships.sum(axis=1, keepdims=True)
    squares = (inputs - centres[:, np.newaxis, :]) ** 2
    variances = np.einsum("cn,cnd->cd", weights, squares)
    return Antecedents(centres, np.maximum(np.sqrt(variances), _SMALLEST_WIDTH))


def product_space(inputs: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """z = [inputs, target], with a constant target left out; all columns z-scored already."""
    points = np.column_stack([inputs, targets])
    return np.ascontiguousarray(points[:, Scaling.of(points).columns])


def grid_sets(n_rules: int, n_inputs: int) -> tuple[int, ...]:
    """Sets per input, with product n_rules and as even as its prime factors allow: 4 -> (2, 2), 6 -> (2, 3)."""
    sets = [1] * n_inputs
    factors, rest, divisor = [], n_rules, 2
    while rest > 1:
        while rest % divisor == 0:
            factors.append(divisor)
            rest //= divisor
        divisor += 1
    for factor in reversed(factors):
        smallest = min(range(n_inputs), key=lambda k: (sets[k], -k))
        sets[smallest] *= factor
    return tuple(sets)


def grid(inputs: NDArray[np.float64], sets: tuple[int, ...], shifted: int | None = None, shift: float = 0.0) -> Start:
    """Rules at the products of each input's quantiles, last input fastest; one input's sets may be moved aside."""
    axes = [np.quantile(inputs[:, k], (np.arange(count) + 0.5) / count) for k, count in enumerate(sets)]
    widths = np.full(len(sets), _PLAIN_WIDTH)
    if shifted is not None:
        axes[shifted] = axes[shifted] - axes[shifted].mean() + shift
        widths[shifted] = _SHIFTED_WIDTH
    centres = np.array(list(product(*axes)))
    return Start(Antecedents(centres, np.tile(widths, (len(centres), 1))), sets)


def starting_points(
    inputs: NDArray[np.float64],
    targets: NDArray[np.float64],
    n_rules: int,
    n_starts: int,
    fuzziness: float,
    rng: np.random.Generator,
) -> list[Start]:
    """n_starts starts for z-scored inputs (n, d >= 1) and targets (n,).

    In this order: the plain grid, the grid shifted along the last input by +2 and -2, two short Gustafson-Kessel
    runs, the grid shifted along the other inputs, and further Gustafson-Kessel runs.
    """
    n_inputs = inputs.shape[1]
    sets = grid_sets(n_rules, n_inputs)
    shifts = [(k, sign * _SHIFT) for k in reversed(range(n_inputs)) for sign in (1, -1)]
    grids = [grid(inputs, sets)] + [grid(inputs, sets, k, shift) for k, shift in shifts[: n_starts - 1]]
    n_runs = max(0, min(2, n_starts - 3), n_starts - len(grids))
    runs: list[Start] = []
    if n_runs:
        partitions = random_partitions(n_runs, n_rules, len(targets), rng)
        points = product_space(inputs, targets)
        found = gustafson_kessel(points, partitions, fuzziness=fuzziness, max_iter=_SHORT_RUN)
        runs = [Start(projected(clustering, inputs), None) for clustering in found]
    return (grids[:3] + runs[:2] + grids[3:] + runs[2:])[:n_starts]
