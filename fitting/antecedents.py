"""The two ways to find antecedents: as published (Gustafson-Kessel), and optimised jointly with the consequents."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.gustafson_kessel import gustafson_kessel, random_partitions
from fitting.joint import Candidate, JointWalk
from fitting.rules import Antecedents
from fitting.selection import can_hold_out, held_out_error, training_error
from fitting.starts import Start, product_space, projected, starting_points

# Steps a candidate may adapt to the rows left in a fold: enough to follow them, too few to find another optimum.
_REFINE_STEPS = 5
# Rules with sets of their own replace rules with shared sets only if they halve the error on held-out blocks.
# Surface A with dwell errors, temperatures left out, 4 rules, 12 seeds: std 0.0159 deg/s in the median and 0.029 at
# worst; without the preference (1.0) 0.0167 and 0.046, because rules with more freedom memorise dwells.
_CLEARLY_BETTER = 2.0
# Starts that are grids whatever the number of inputs; tied rules are walked from these only.
_GRIDS_FIRST = 3
# Walks finished, of those that set out with sets of their own.
_FINALISTS = 2


@dataclass(frozen=True)
class SearchSettings:
    """What both searches need to know; the fields are those of `TakagiSugeno`."""

    n_rules: int
    n_starts: int
    fuzziness: float
    tol: float
    max_iter: int
    ridge: float
    tied: bool = False


@dataclass(frozen=True)
class Found:
    """The antecedents kept, in z-scores, with the iterations of their own run and whether it converged.

    sets: how many fuzzy sets each input has if rules share them, else None. tied: see `JointWalk`.
    """

    antecedents: Antecedents
    n_iter: int
    converged: bool
    sets: tuple[int, ...] | None = None
    tied: bool = False


def search_published(
    inputs: NDArray[np.float64], targets: NDArray[np.float64], settings: SearchSettings, rng: np.random.Generator
) -> Found:
    """Gustafson-Kessel in the product space from random partitions, run to the end; inputs (n, d >= 1) z-scores."""
    partitions = random_partitions(settings.n_starts, settings.n_rules, len(targets), rng)
    clusterings = gustafson_kessel(
        product_space(inputs, targets),
        partitions,
        fuzziness=settings.fuzziness,
        tol=settings.tol,
        max_iter=settings.max_iter,
    )
    found = [Found(projected(run, inputs), run.n_iter, run.converged) for run in clusterings]
    if len(found) == 1:
        return found[0]

    def error(one: Found) -> float:
        if can_hold_out(len(targets), one.antecedents):
            return held_out_error(inputs, targets, lambda x, y: one.antecedents, settings.ridge)
        return training_error(inputs, targets, one.antecedents, settings.ridge)

    return min(found, key=error)


class _JointSearch:
    """Walks on z-scored inputs (n, d) and targets (n,), and the choice between their ends."""

    def __init__(self, inputs: NDArray[np.float64], targets: NDArray[np.float64], settings: SearchSettings) -> None:
        self.inputs, self.targets, self.settings = inputs, targets, settings

    def walk(self, start: Start, *, shared: bool) -> JointWalk:
        sets = start.sets if shared else None
        ridge, tied = self.settings.ridge, self.settings.tied
        return JointWalk(self.inputs, self.targets, start.antecedents, ridge=ridge, sets=sets, tied=tied)

    def finalists(self, walks: list[JointWalk], n_kept: int) -> list[Candidate]:
        """Walk a third of the way from every start, and on only from the lowest."""
        total = self.settings.max_iter
        costs = [walk.advance(-(-total // 3)).optimum.cost for walk in walks]
        kept = np.argsort(costs, kind="stable")[:n_kept]
        return sorted((walks[k].advance(total) for k in kept), key=lambda candidate: candidate.optimum.cost)

    def held_out(self, candidate: Candidate) -> float:
        """Root-mean-square error on held-out blocks (on the training rows if they are too few), z-scored."""
        ridge = self.settings.ridge

        def refine(x: NDArray[np.float64], y: NDArray[np.float64]) -> Antecedents:
            walk = JointWalk(x, y, candidate.antecedents, ridge=ridge, sets=candidate.sets)
            return walk.advance(_REFINE_STEPS).antecedents

        if can_hold_out(len(self.targets), candidate.antecedents):
            squares = held_out_error(self.inputs, self.targets, refine, ridge)
        else:
            squares = candidate.optimum.cost
        return float(np.sqrt(squares / len(self.targets)))

    def best(self, starts: list[Start]) -> Candidate:
        """Walk from every start; from a grid once with its sets shared and once without."""
        shared = [self.walk(start, shared=True) for start in starts if start.sets is not None]
        simple = self.finalists(shared, 1)[0]
        if self.settings.tied:
            return simple
        free = self.finalists([self.walk(start, shared=False) for start in starts], _FINALISTS)
        errors = [self.held_out(candidate) for candidate in free]
        clearly_better = _CLEARLY_BETTER * min(errors) < self.held_out(simple)
        return free[int(np.argmin(errors))] if clearly_better else simple


def search_joint(
    inputs: NDArray[np.float64], targets: NDArray[np.float64], settings: SearchSettings, rng: np.random.Generator
) -> Found:
    """Variable projection from every start of `fitting.starts`; inputs (n, d >= 1) z-scores."""
    n_starts = min(settings.n_starts, _GRIDS_FIRST) if settings.tied else settings.n_starts
    starts = starting_points(inputs, targets, settings.n_rules, n_starts, settings.fuzziness, rng)
    best = _JointSearch(inputs, targets, settings).best(starts)
    return Found(best.antecedents, best.optimum.n_iter, best.optimum.converged, best.sets, settings.tied)
