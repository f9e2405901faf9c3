"""Gustafson-Kessel against a loop written from the paper and against soft-clustering 0.2.0."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from soft_clustering import GK

from fitting.gustafson_kessel import gustafson_kessel, random_partitions


def blobs(seed: int = 0, n: int = 90) -> NDArray[np.float64]:
    """Three elongated clouds in three dimensions, z-scored."""
    rng = np.random.default_rng(seed)
    stretch = np.array([[2.0, 0.5, 0.1], [0.2, 1.0, 0.4], [0.1, 0.2, 0.3]])
    points = rng.normal(size=(n, 3)) @ stretch + 4.0 * rng.integers(0, 3, n)[:, np.newaxis] * [1.0, -1.0, 0.5]
    return np.asarray((points - points.mean(axis=0)) / points.std(axis=0))


def sweep_by_hand(points: NDArray[np.float64], u: NDArray[np.float64], m: float) -> NDArray[np.float64]:
    """One pass of the equations, one cluster and one point at a time; u is (clusters, n)."""
    n, size = points.shape
    distances = np.empty_like(u)
    for j in range(len(u)):
        v = sum(u[j, i] ** m * points[i] for i in range(n)) / sum(u[j] ** m)
        f = sum(u[j, i] ** m * np.outer(points[i] - v, points[i] - v) for i in range(n)) / sum(u[j] ** m)
        a = np.linalg.det(f) ** (1.0 / size) * np.linalg.inv(f)
        for i in range(n):
            distances[j, i] = np.sqrt((points[i] - v) @ a @ (points[i] - v))
    new = np.empty_like(u)
    for j in range(len(u)):
        for i in range(n):
            new[j, i] = 1.0 / sum((distances[j, i] / distances[k, i]) ** (2.0 / (m - 1.0)) for k in range(len(u)))
    return new


@pytest.mark.parametrize("fuzziness", [1.5, 2.0, 3.0])
def test_sweeps_are_the_papers_equations(fuzziness: float) -> None:
    points = blobs()
    start = random_partitions(1, 3, len(points), np.random.default_rng(1))
    expected = start[0]
    for _ in range(3):
        expected = sweep_by_hand(points, expected, fuzziness)
    (found,) = gustafson_kessel(points, start, fuzziness=fuzziness, max_iter=3)
    assert found.n_iter == 3 and not found.converged
    assert np.allclose(found.memberships, expected, atol=1e-9)


def test_agrees_with_soft_clustering() -> None:
    points = blobs(3)
    oracle = GK(random_state=5, max_iter=300, tol=0.0, init="random", reg_covar=0.0)
    expected = oracle.fit_predict(points, 3)
    start = np.random.default_rng(5).random((len(points), 3)).T  # soft-clustering's own start
    (found,) = gustafson_kessel(points, (start / start.sum(axis=0))[np.newaxis], tol=1e-10, max_iter=300)
    assert found.converged
    assert np.allclose(found.memberships, expected.T, atol=1e-6)
    assert np.allclose(found.centres, oracle.centers_, atol=1e-6)
    assert np.allclose(found.covariances, oracle.covariances_, atol=1e-6)
    assert found.objective == pytest.approx(oracle.objective_trajectory_[-1], rel=1e-6)


def test_several_starts_at_once_are_each_the_same_as_alone() -> None:
    points = blobs(7)
    starts = random_partitions(4, 3, len(points), np.random.default_rng(8))
    together = gustafson_kessel(points, starts)
    for start, found in zip(starts, together, strict=True):
        (alone,) = gustafson_kessel(points, start[np.newaxis])
        assert alone.n_iter == found.n_iter
        assert np.allclose(alone.centres, found.centres, atol=1e-9)


def test_convergence_is_reported() -> None:
    points = blobs(9)
    starts = random_partitions(1, 3, len(points), np.random.default_rng(10))
    (found,) = gustafson_kessel(points, starts, tol=1e-4, max_iter=500)
    (one_less,) = gustafson_kessel(points, starts, tol=0.0, max_iter=found.n_iter - 1)
    change = np.linalg.norm(found.memberships - one_less.memberships)
    assert found.converged and change < 1e-4
    (stopped,) = gustafson_kessel(points, starts, tol=1e-4, max_iter=found.n_iter - 1)
    assert not stopped.converged


def test_is_invariant_to_a_linear_map_of_healthy_data() -> None:
    """Pure Gustafson-Kessel is affine invariant (fitting notes, section 4): the cures must not touch healthy data."""
    points = blobs(11)
    starts = random_partitions(1, 3, len(points), np.random.default_rng(12))
    mixing = np.array([[1.0, 0.4, 0.0], [0.0, 2.0, 0.3], [0.5, 0.0, 0.7]])
    (plain,) = gustafson_kessel(points, starts, max_iter=40, tol=0.0)
    (mapped,) = gustafson_kessel(points @ mixing, starts, max_iter=40, tol=0.0)
    assert np.allclose(plain.memberships, mapped.memberships, atol=1e-7)


@pytest.mark.parametrize("case", ["plane", "duplicate column", "duplicate rows", "14 rows", "2 rows", "two places"])
def test_degenerate_points_survive(case: str) -> None:
    rng = np.random.default_rng(13)
    points = rng.normal(size=(40, 3))
    if case == "plane":
        points[:, 2] = points[:, 0] - 0.5 * points[:, 1]
    elif case == "duplicate column":
        points[:, 2] = points[:, 1]
    elif case == "duplicate rows":
        points = np.repeat(points[:8], 5, axis=0)
    elif case == "two places":
        points = np.repeat(points[:2], 20, axis=0)
    else:
        points = points[: 14 if case == "14 rows" else 2]
    for found in gustafson_kessel(points, random_partitions(20, 4, len(points), rng), max_iter=60):
        assert np.isfinite(found.centres).all() and np.isfinite(found.covariances).all()
        assert np.allclose(found.memberships.sum(axis=0), 1.0)
        assert (np.linalg.eigvalsh(found.covariances) > 0.0).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(1.02, 6.0), st.integers(1, 6))
def test_memberships_are_a_partition(seed: int, fuzziness: float, n_clusters: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(25, 2))
    (found,) = gustafson_kessel(points, random_partitions(1, n_clusters, 25, rng), fuzziness=fuzziness, max_iter=15)
    assert ((found.memberships >= 0.0) & (found.memberships <= 1.0)).all()
    assert np.allclose(found.memberships.sum(axis=0), 1.0)
