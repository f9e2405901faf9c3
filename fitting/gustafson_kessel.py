"""Gustafson-Kessel clustering in the product space (reference experiment `ts`; Gustafson and Kessel, CDC 1979).

F_j = sum_i mu_ji^m (z_i - v_j)(z_i - v_j)' / sum_i mu_ji^m;  A_j = det(F_j)^(1/n) F_j^-1, n the dimension of z;
D_ji^2 = (z_i - v_j)' A_j (z_i - v_j);  mu_ji = 1 / sum_k (D_ji / D_ki)^(2/(m-1));  v_j = sum mu^m z / sum mu^m.
(pyFUME uses the exponent 1/m instead of 1/n.) Several starts run at once as one batch of matrix products.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Fitting notes, section 4: eigenvalues are clipped at lambda_max / beta. With z-scored data the moments are exact to
# about 1e-15, so a ratio of 1e10 is still a measured one and a larger one is rounding.
CONDITION_LIMIT = 1e10
# Weight of det(F0)^(1/n) I in a cluster whose covariance is singular (fitting notes, section 4: 20 of 20 runs cured).
SHRINKAGE = 0.1
_TINY = 1e-300


@dataclass(frozen=True)
class Clustering:
    """One finished run.

    memberships: (clusters, n), columns sum to 1. centres: (clusters, d). covariances: (clusters, d, d), as used.
    objective: J = sum mu^m D^2; a low J is not a good model (fitting notes, section 4), so it only documents.
    n_iter: sweeps made; converged: the last change of the memberships, as a Frobenius norm, was below tol.
    """

    memberships: NDArray[np.float64]
    centres: NDArray[np.float64]
    covariances: NDArray[np.float64]
    objective: float
    n_iter: int
    converged: bool


def random_partitions(n_starts: int, n_clusters: int, n_rows: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """The published start: random memberships, each row's summing to 1; shape (starts, clusters, rows)."""
    memberships = rng.random((n_starts, n_clusters, n_rows)) + np.finfo(np.float64).tiny
    scaled: NDArray[np.float64] = memberships / memberships.sum(axis=1, keepdims=True)
    return scaled


class _Moments:
    """Weighted means and covariances of fixed points for many weightings at once: one matrix product a sweep."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        self.upper = np.triu_indices(points.shape[1])
        products = points[:, self.upper[0]] * points[:, self.upper[1]]
        self.columns = np.column_stack([np.ones(len(points)), points, products])
        self.size = points.shape[1]

    def of(self, weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Weights (k, n) -> centres (k, d) and covariances (k, d, d)."""
        sums = weights @ self.columns
        sums = sums[:, 1:] / np.maximum(sums[:, :1], _TINY)
        centres = sums[:, : self.size]
        covariances = np.empty((len(weights), self.size, self.size))
        covariances[:, self.upper[0], self.upper[1]] = sums[:, self.size :]
        covariances[:, self.upper[1], self.upper[0]] = sums[:, self.size :]
        covariances -= centres[:, :, np.newaxis] * centres[:, np.newaxis, :]
        return centres, covariances


def _geometric_mean(eigenvalues: NDArray[np.float64]) -> NDArray[np.float64]:
    """det^(1/n) from eigenvalues along the last axis, by logarithms so that it neither over- nor underflows."""
    mean: NDArray[np.float64] = np.exp(np.log(eigenvalues).mean(axis=-1))
    return mean


def _clip(eigenvalues: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ascending eigenvalues along the last axis, none below the largest / CONDITION_LIMIT."""
    return np.asarray(np.maximum(eigenvalues, np.maximum(eigenvalues[..., -1:] / CONDITION_LIMIT, _TINY)))


@dataclass(frozen=True)
class _Shapes:
    """Centres (k, d) and covariances V diag(lambda) V' of k clusters, lambda (k, d), V (k, d, d)."""

    centres: NDArray[np.float64]
    values: NDArray[np.float64]
    vectors: NDArray[np.float64]

    def squared_distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """D^2 of every point to every centre, (k, n): the length of A^(1/2) (z - v), never negative by rounding."""
        root = self.vectors * np.sqrt(_geometric_mean(self.values)[:, np.newaxis] / self.values)[:, np.newaxis, :]
        whitened = np.matmul(points, root)
        whitened -= np.matmul(self.centres[:, np.newaxis, :], root)
        return np.asarray(np.maximum(np.einsum("kne,kne->kn", whitened, whitened), _TINY))


def _memberships(squared: NDArray[np.float64], fuzziness: float) -> NDArray[np.float64]:
    """mu from D^2, (..., clusters, n); ratios to the nearest centre, so that nothing overflows for m close to 1."""
    ratios: NDArray[np.float64] = (squared.min(axis=-2, keepdims=True) / squared) ** (1.0 / (fuzziness - 1.0))
    scaled: NDArray[np.float64] = ratios / ratios.sum(axis=-2, keepdims=True)
    return scaled


class _Sweep:
    """One update of the memberships of several starts."""

    def __init__(self, points: NDArray[np.float64], fuzziness: float, shrinkage: float) -> None:
        self.points, self.fuzziness, self.shrinkage = points, fuzziness, shrinkage
        self.moments = _Moments(points)
        whole = self.moments.of(np.ones((1, len(points))))[1]
        spread = np.asarray(np.linalg.eigvalsh(whole), dtype=np.float64)
        self.sphere = float(_geometric_mean(_clip(spread))[0])

    def shapes(self, memberships: NDArray[np.float64]) -> _Shapes:
        """Centres and usable covariances of memberships (k, n).

        Singular ones are shrunk, F <- (1 - g) F + g det(F0)^(1/n) I, which keeps their eigenvectors; the healthy ones
        stay exactly as published.
        """
        centres, covariances = self.moments.of(memberships**self.fuzziness)
        values, vectors = np.linalg.eigh(covariances)
        singular = values[:, 0] * CONDITION_LIMIT <= values[:, -1]
        values[singular] = (1.0 - self.shrinkage) * values[singular] + self.shrinkage * self.sphere
        return _Shapes(centres, _clip(values), vectors)

    def update(self, memberships: NDArray[np.float64]) -> NDArray[np.float64]:
        """Memberships (starts, clusters, n) after one sweep."""
        squared = self.shapes(memberships.reshape(-1, len(self.points))).squared_distances(self.points)
        return _memberships(squared.reshape(memberships.shape), self.fuzziness)

    def finish(self, memberships: NDArray[np.float64], n_iter: int, converged: bool) -> Clustering:
        """Describe one start's final memberships (clusters, n)."""
        shapes = self.shapes(memberships)
        covariances = (shapes.vectors * shapes.values[:, np.newaxis, :]) @ shapes.vectors.transpose(0, 2, 1)
        objective = float(np.sum(memberships**self.fuzziness * shapes.squared_distances(self.points)))
        return Clustering(memberships, shapes.centres, covariances, objective, n_iter, converged)


def gustafson_kessel(
    points: NDArray[np.float64],
    starts: NDArray[np.float64],
    *,
    fuzziness: float = 2.0,
    tol: float = 1e-4,
    max_iter: int = 500,
    shrinkage: float = SHRINKAGE,
) -> list[Clustering]:
    """Cluster points (n, d), z-scored and without constant columns, from every start (starts, clusters, n).

    Each start stops by itself when ||U_i - U_(i-1)|| < tol or after max_iter sweeps; see `Clustering`.
    """
    sweep = _Sweep(points, fuzziness, shrinkage)
    memberships = starts.copy()
    n_iter = np.zeros(len(starts), dtype=int)
    running = np.arange(len(starts))
    for _ in range(max_iter):
        updated = sweep.update(memberships[running])
        change = np.sqrt(((updated - memberships[running]) ** 2).sum(axis=(1, 2)))
        memberships[running] = updated
        n_iter[running] += 1
        running = running[change >= tol]
        if not running.size:
            break
    return [sweep.finish(memberships[k], int(n_iter[k]), converged=k not in running) for k in range(len(starts))]
