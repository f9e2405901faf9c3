"""The chaotic swarm and the network it starts: its bound, its map, its memory, and what stability is worth."""

import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.utils.estimator_checks import check_estimator

from fitting.csapso import CsapsoNetwork
from fitting.lag_bank_history import History
from fitting.swarm import PUBLISHED, STABLE, LogisticMap, SwarmSettings, UnstableSwarmWarning, csapso
from tests.fitting import twins

Array = NDArray[np.float64]
QUICK: dict[str, Any] = {"hidden": 4, "iterations": 40, "particles": 15, "epochs": 100}


def _sphere(positions: Array) -> Array:
    return np.asarray(np.sum((positions - 0.3) ** 2, axis=1))


@pytest.mark.filterwarnings("ignore::fitting.swarm.UnstableSwarmWarning")
@pytest.mark.parametrize("finish", ["none", "gradient", "levenberg_marquardt"])
def test_is_a_scikit_learn_estimator(finish: Any) -> None:
    settings = {**QUICK, "epochs": 20 if finish == "levenberg_marquardt" else 1000}
    check_estimator(CsapsoNetwork(finish=finish, **settings), on_skip=None)


def test_published_settings_are_the_papers_and_beyond_the_bound() -> None:
    """Fitting notes, section 6: 24 (1 - 0.8^2) / (7 - 5 0.8) = 2.88 < 4."""
    assert (PUBLISHED.particles, PUBLISHED.inertia, PUBLISHED.cognitive, PUBLISHED.social) == (40, 0.8, 2.0, 2.0)
    assert (PUBLISHED.start_temperature, PUBLISHED.cooling) == (1000.0, 0.98)
    assert PUBLISHED.bound == pytest.approx(2.88) and not PUBLISHED.stable
    assert (STABLE.inertia, STABLE.cognitive, STABLE.social) == (0.729, 1.49, 1.49) and STABLE.stable
    assert not SwarmSettings(inertia=1.0, cognitive=0.1, social=0.1).stable


def test_the_bound_is_where_the_spread_of_a_particle_begins_to_grow() -> None:
    """Order-2 stability of x' = x + w v + c1 r1 (p - x) + c2 r2 (g - x), simulated on both sides of the bound."""
    rng, w = np.random.default_rng(0), 0.5
    bound = SwarmSettings(inertia=w).bound
    for share, grows in ((0.85, False), (1.15, True)):
        c = 0.5 * share * bound
        x, v = rng.standard_normal((2, 20_000))
        sizes = []
        for _ in range(120):
            r = rng.uniform(size=(2, 20_000))
            v = w * v - c * (r[0] + r[1]) * x
            x = x + v
            sizes.append(float(np.mean(x**2)))
        assert (sizes[-1] > sizes[10]) == grows


def test_logistic_map_is_4z_1_minus_z_and_stays_inside() -> None:
    chaos = LogisticMap((50,), np.random.default_rng(1))
    before = chaos.next().copy()
    assert chaos.next() == pytest.approx(4.0 * before * (1.0 - before))
    orbit = np.array([chaos.next() for _ in range(20_000)])
    assert orbit.min() > 0.0 and orbit.max() < 1.0 and (orbit.std(axis=0) > 0.3).all()
    # its invariant density is arcsine: mean 1/2, variance 1/8
    assert orbit.mean() == pytest.approx(0.5, abs=0.01) and orbit.var() == pytest.approx(0.125, abs=0.005)


def test_the_best_is_what_the_cost_says_and_never_gets_worse() -> None:
    result = csapso(_sphere, 4, STABLE, np.random.default_rng(0))
    assert result.cost == pytest.approx(_sphere(result.best[np.newaxis])[0]) == result.history[-1]
    assert (np.diff(result.history) <= 0.0).all() and len(result.history) == STABLE.iterations + 1


def test_stable_swarms_without_annealing_find_the_minimum_and_unstable_ones_do_not() -> None:
    cold = {"start_temperature": 1e-12, "iterations": 300}
    stable, unstable = SwarmSettings(inertia=0.729, cognitive=1.49, social=1.49, **cold), SwarmSettings(**cold)
    assert csapso(_sphere, 10, stable, np.random.default_rng(2)).cost < 1e-3
    assert csapso(_sphere, 10, unstable, np.random.default_rng(2)).cost > 1e-2


def test_costs_that_are_not_finite_are_only_bad() -> None:
    def cost(positions: Array) -> Array:
        return np.where(positions[:, 0] > 0.0, np.nan, _sphere(positions))

    result = csapso(cost, 2, SwarmSettings(iterations=50), np.random.default_rng(3))
    assert np.isfinite(result.cost) and result.best[0] <= 0.0


def _bp(seed: int) -> tuple[Array, Array]:
    cycle = twins.bp(seed)
    return History(()).features(cycle.temperatures_degc, 100.0), cycle.bias_dph


def test_published_settings_are_kept_and_said_to_be_unstable() -> None:
    inputs, bias = _bp(0)
    with pytest.warns(UnstableSwarmWarning, match=r"c1 \+ c2 = 4 .*2\.88.*w = 0\.8"):
        model = CsapsoNetwork(**QUICK).fit(inputs, bias)
    assert not model.stable_ and model.stability_bound_ == pytest.approx(2.88)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert CsapsoNetwork(settings="stable", **QUICK).fit(inputs, bias).stable_


@pytest.mark.filterwarnings("ignore::fitting.swarm.UnstableSwarmWarning")
def test_stability_is_worth_more_than_the_swarm_and_a_finish_more_than_both() -> None:
    inputs, bias = _bp(1)
    losses = {
        (settings, finish): CsapsoNetwork(6, settings, finish, iterations=200, start_temperature=0.01, epochs=300)
        .fit(inputs, bias)
        .loss_
        for settings, finish in [
            ("published", "none"),
            ("stable", "none"),
            ("stable", "gradient"),
            ("stable", "levenberg_marquardt"),
        ]
    }
    ordered = list(losses.values())
    assert ordered == sorted(ordered, reverse=True) and ordered[2] < 0.7 * ordered[0]


@pytest.mark.filterwarnings("ignore::fitting.swarm.UnstableSwarmWarning")
def test_same_seed_same_model() -> None:
    inputs, bias = _bp(2)
    model = CsapsoNetwork(**QUICK)
    first, second, other = (clone(model).set_params(random_state=k).fit(inputs, bias) for k in (0, 0, 1))
    assert np.array_equal(first.predict(inputs), second.predict(inputs))
    assert not np.array_equal(first.predict(inputs), other.predict(inputs))


@pytest.mark.filterwarnings("ignore::fitting.swarm.UnstableSwarmWarning")
@pytest.mark.parametrize("case", ["constant column", "duplicate rows", "few rows", "constant target"])
def test_data_that_are_not_nice(case: str) -> None:
    inputs = np.random.default_rng(4).normal(size=(30, 2))
    if case == "constant column":
        inputs[:, 0] = 3.0
    if case == "duplicate rows":
        inputs = np.repeat(inputs[:3], 10, axis=0)
    if case == "few rows":
        inputs = inputs[:3]
    target = np.full(len(inputs), 2.0) if case == "constant target" else inputs[:, 1]
    assert np.isfinite(CsapsoNetwork(**QUICK).fit(inputs, target).predict(inputs)).all()


@pytest.mark.parametrize(
    "bad",
    [
        {"hidden": 0},
        {"settings": "wild"},
        {"finish": "adam"},
        {"particles": 0},
        {"iterations": 0},
        {"start_temperature": -1.0},
        {"activation": "relu"},
    ],
)
def test_a_bad_parameter_is_named_with_what_is_allowed(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(bad))}.*allowed"):
        CsapsoNetwork(**bad).fit(np.arange(20.0).reshape(10, 2), np.arange(10.0))


def test_values_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="NaN"):
        CsapsoNetwork().fit([[1.0], [np.nan], [2.0]], [1.0, 2.0, 3.0])
