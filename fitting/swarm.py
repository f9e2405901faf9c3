"""Chaotic simulated-annealing particle swarm (CSAPSO), the published search for a network's first weights (`bp`).

Our reading of the paper: positions and velocities begin on the logistic map, and the factors r1 and r2 of every
velocity update follow it; a particle's memory takes a worse position with probability exp(-increase / temperature).
The best position ever met is what is returned. Iterations and the range of the start are not published.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# An unstable swarm would leave the range of float64 in a few thousand iterations.
_FARTHEST = 1e12


class UnstableSwarmWarning(UserWarning):
    """The swarm's settings are beyond its stability bound."""


@dataclass(frozen=True)
class SwarmSettings:
    """particles fly `iterations` times with inertia w, cognitive factor c1 and social factor c2.

    start_temperature, cooling: of the acceptance of worse positions, cooled after every iteration. spread: positions
    and velocities begin within +-spread.
    """

    particles: int = 40
    iterations: int = 600
    inertia: float = 0.8
    cognitive: float = 2.0
    social: float = 2.0
    start_temperature: float = 1000.0
    cooling: float = 0.98
    spread: float = 1.0

    @property
    def bound(self) -> float:
        """What c1 + c2 must be below, 24 (1 - w^2) / (7 - 5 w), for the spread of a particle to stay bounded.

        Poli (IEEE Trans. Evol. Comput. 13(4), 2009), for equal factors; no sum is stable for |w| >= 1.
        """
        if abs(self.inertia) >= 1.0:
            return 0.0
        return 24.0 * (1.0 - self.inertia**2) / (7.0 - 5.0 * self.inertia)

    @property
    def stable(self) -> bool:
        """Whether c1 + c2 is below the bound."""
        return self.cognitive + self.social < self.bound

    def warn_if_unstable(self) -> None:
        """Say so with the numbers; the swarm runs all the same."""
        if self.stable:
            return
        warnings.warn(
            f"swarm: c1 + c2 = {self.cognitive + self.social:g} is beyond the stability bound "
            f"24 (1 - w^2) / (7 - 5 w) = {self.bound:.2f} for inertia w = {self.inertia:g}: the particles fly apart "
            "and find little more than their start did. Take w = 0.729 and c1 = c2 = 1.49 (settings 'stable').",
            UnstableSwarmWarning,
            stacklevel=2,
        )


PUBLISHED = SwarmSettings()
# Clerc and Kennedy's constriction (IEEE Trans. Evol. Comput. 6(1), 2002); fitting_notes.md, section 6.
STABLE = SwarmSettings(inertia=0.729, cognitive=1.49, social=1.49)


@dataclass(frozen=True)
class SwarmResult:
    """best: (p,), the best position ever met; cost: its; history: best cost so far after every iteration, (m + 1,)."""

    best: Array
    cost: float
    history: Array


class LogisticMap:
    """z -> 4 z (1 - z), one orbit for every entry of an array; values in (0, 1)."""

    def __init__(self, shape: tuple[int, ...], rng: np.random.Generator) -> None:
        self._state = rng.uniform(0.01, 0.99, shape)

    def next(self) -> Array:
        """The next value of every orbit.

        Orbits end in 0 when rounding puts them on 0, 1/2 or 1 (Knuth, vol. 2, 3.1, of such recurrences): kept off.
        """
        self._state = np.clip(4.0 * self._state * (1.0 - self._state), 1e-12, 1.0 - 1e-12)
        return self._state


def csapso(cost: Callable[[Array], Array], size: int, settings: SwarmSettings, rng: np.random.Generator) -> SwarmResult:
    """Minimise cost, which takes positions (m, size) and gives their costs (m,); a cost that is not finite is bad."""
    shape = (settings.particles, size)
    chaos = [LogisticMap(shape, rng) for _ in range(4)]
    for _ in range(20):  # an orbit forgets how evenly it began
        for orbit in chaos:
            orbit.next()
    positions, velocities = (settings.spread * (2.0 * orbit.next() - 1.0) for orbit in chaos[:2])
    memories, costs = positions, _finite(cost(positions))
    k = int(np.argmin(costs))
    best, least, history = positions[k].copy(), float(costs[k]), [float(costs[k])]
    temperature = settings.start_temperature
    for _ in range(settings.iterations):
        pull = settings.cognitive * chaos[2].next() * (memories - positions)
        pull += settings.social * chaos[3].next() * (memories[np.argmin(costs)] - positions)
        velocities = np.clip(settings.inertia * velocities + pull, -_FARTHEST, _FARTHEST)
        positions = np.clip(positions + velocities, -_FARTHEST, _FARTHEST)
        now = _finite(cost(positions))
        k = int(np.argmin(now))
        if now[k] < least:
            best, least = positions[k].copy(), float(now[k])
        taken = _accepted(now - costs, temperature, rng)
        memories, costs = np.where(taken[:, np.newaxis], positions, memories), np.where(taken, now, costs)
        temperature *= settings.cooling
        history.append(least)
    return SwarmResult(best, least, np.array(history))


def _accepted(increase: Array, temperature: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Better ones always, worse ones with probability exp(-increase / temperature)."""
    chance = np.exp(-np.maximum(increase, 0.0) / max(temperature, np.finfo(np.float64).tiny))
    return np.asarray(rng.uniform(size=len(increase)) < chance)


def _finite(costs: Array) -> Array:
    return np.where(np.isfinite(costs), costs, np.finfo(np.float64).max / 4.0)
