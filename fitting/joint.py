"""Takagi-Sugeno antecedents optimised together with their consequents, by variable projection.

Unknowns p = (v_jk, log sigma_jk). The consequents theta(p) are solved at every step, so that only p is searched
(Golub and Pereyra, 1973). With h_j = w_j (g_j - y): dy/dv_jk = h_j (x_k - v_jk) / sigma_jk^2 and
dy/dlog sigma_jk = h_j ((x_k - v_jk) / sigma_jk)^2, projected on the complement of the regressors (Kaufman, 1975).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

from fitting.levenberg_marquardt import Optimum, Walk
from fitting.rules import Antecedents, firing_strengths

# Fitting notes, section 3, in z-scores: |v| <= 4, 0.08 <= sigma <= 20.
_CENTRE_LIMIT = 4.0
_WIDTH_LIMITS = (0.08, 20.0)


@dataclass(frozen=True)
class ProjectedFit:
    """The reduced problem at one p. Arrays run over rules c, inputs d, rows n, regressors q = c (d + 1)."""

    cost: float
    residual: NDArray[np.float64]  # (n,)
    deviations: NDArray[np.float64]  # (x - v) / sigma, (c, d, n)
    inverse_widths: NDArray[np.float64]  # (c, d)
    regressors: NDArray[np.float64]  # (q, n), fewer where slopes are shared
    factor: NDArray[np.float64]  # Cholesky factor of the regressors' Gram matrix, (q, q)
    theta: NDArray[np.float64]  # (q,)
    slopes: NDArray[np.float64]  # h_j, (c, n)


def shared_slopes(n_rules: int, n_inputs: int, common: tuple[int, ...]) -> NDArray[np.float64]:
    """S with theta = S (free consequents): the slopes of the common inputs are the same in all rules.

    theta runs over rules and, within a rule, over constant and slopes; shape (n_rules (n_inputs + 1), free).
    """
    every = np.eye(n_rules * (n_inputs + 1)).reshape(n_rules, n_inputs + 1, -1)
    columns: list[NDArray[np.float64]] = []
    for k in range(n_inputs + 1):
        columns += [every[:, k].sum(axis=0)] if k - 1 in common else [*every[:, k]]
    return np.array(columns).T


class VariableProjection:
    """min over theta of |y - Phi(p) theta|^2 + ridge |theta|^2, as a function of p.

    inputs: (n, d) z-scores; targets: (n,) z-scores; common: inputs whose slope all rules share (`shared_slopes`).
    The ridge bounds the condition of the Gram matrix by n / ridge, below 1e12 for a grid campaign: Cholesky then leaves
    the residual exact to 1e-10, in a third of the time of QR.
    The final consequents are computed by QR all the same (`consequents.batch`).
    """

    def __init__(
        self,
        inputs: NDArray[np.float64],
        targets: NDArray[np.float64],
        n_rules: int,
        ridge: float,
        common: tuple[int, ...] = (),
    ) -> None:
        self._slopes = shared_slopes(n_rules, inputs.shape[1], common) if common else None
        self._inputs = np.ascontiguousarray(inputs.T)
        self._extended = np.vstack([np.ones(len(targets)), self._inputs])
        self._targets = targets
        self._shape = (n_rules, inputs.shape[1])
        self.ridge = max(ridge, 16.0 * np.finfo(np.float64).eps * float(np.sum(self._extended**2)))

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper limits of p, both of shape (2 c d,)."""
        size = self._shape[0] * self._shape[1]
        low, high = np.log(_WIDTH_LIMITS)
        lower = np.repeat([-_CENTRE_LIMIT, low], size)
        return lower, np.repeat([_CENTRE_LIMIT, high], size)

    def pack(self, antecedents: Antecedents) -> NDArray[np.float64]:
        """Antecedents in z-scores as p, inside the bounds."""
        widths = np.clip(antecedents.widths, *_WIDTH_LIMITS)
        packed = np.concatenate([antecedents.centres.ravel(), np.log(widths).ravel()])
        return np.asarray(np.clip(packed, *self.bounds))

    def unpack(self, parameters: NDArray[np.float64]) -> Antecedents:
        """p as antecedents in z-scores."""
        centres, logarithms = parameters.reshape(2, *self._shape)
        return Antecedents(centres, np.exp(logarithms))

    def evaluate(self, parameters: NDArray[np.float64]) -> ProjectedFit:
        """Solve the consequents at p; the cost is infinite where the Gram matrix cannot be factorised."""
        centres, logarithms = parameters.reshape(2, *self._shape)
        inverse_widths = np.exp(-logarithms)
        deviations = self._inputs - centres[:, :, np.newaxis]
        deviations *= inverse_widths[:, :, np.newaxis]
        firing = firing_strengths(np.einsum("cdn,cdn->cn", deviations, deviations))
        regressors = (firing[:, np.newaxis, :] * self._extended).reshape(-1, firing.shape[1])
        if self._slopes is not None:
            regressors = self._slopes.T @ regressors
        gram = regressors @ regressors.T
        gram.flat[:: len(gram) + 1] += self.ridge
        factor, failed = dpotrf(gram, lower=1)
        theta, _ = dpotrs(factor, regressors @ self._targets, lower=1)
        output = theta @ regressors
        residual = self._targets - output
        cost = float(residual @ residual + self.ridge * theta @ theta)
        if failed or not np.isfinite(cost):
            cost = np.inf
        consequents = theta if self._slopes is None else self._slopes @ theta
        slopes = consequents.reshape(self._shape[0], -1) @ self._extended
        slopes -= output
        slopes *= firing
        return ProjectedFit(cost, residual, deviations, inverse_widths, regressors, factor, theta, slopes)

    def jacobian(self, fit: ProjectedFit) -> NDArray[np.float64]:
        """dy/dp with theta held, shape (2 c d, n), before projection."""
        jacobian = np.empty((2, *fit.deviations.shape))
        weighted = np.multiply(fit.slopes[:, np.newaxis, :], fit.deviations, out=jacobian[1])
        np.multiply(weighted, fit.inverse_widths[:, :, np.newaxis], out=jacobian[0])
        weighted *= fit.deviations
        return jacobian.reshape(-1, jacobian.shape[-1])

    def normal_equations(self, fit: ProjectedFit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """J'(I - H)J and J'r, with H the hat matrix of the regressors (its ridge included)."""
        jacobian = self.jacobian(fit)
        inside, _ = dtrtrs(fit.factor, fit.regressors @ jacobian.T, lower=1)
        return jacobian @ jacobian.T - inside.T @ inside, jacobian @ fit.residual


class SharedSets:
    """The same problem with fuzzy sets shared between rules, as the paper states its rules: low and high temperature
    times low and high rate. p = B q with q the centres, then log widths, of the sets of each input: 8 unknowns
    instead of 16 for 2 x 2 rules. With errors common to a dwell it generalises better; it cannot follow every surface.
    equal_widths: the sets of an input have one width, so that two of them are a logistic transition and neither comes
    back beyond the other.
    """

    def __init__(self, problem: VariableProjection, sets: tuple[int, ...], equal_widths: bool = False) -> None:
        self._problem = problem
        first = np.concatenate([[0], np.cumsum(sets)[:-1]])
        members = np.array(list(product(*[range(count) for count in sets]))) + first  # set of rule j on input k
        incidence = np.eye(sum(sets))[members.ravel()]
        inputs = np.tile(np.arange(len(sets)), len(members))
        widths = np.eye(len(sets))[inputs] if equal_widths else incidence
        self._spread = block_diag(incidence, widths)
        self._gather = (self._spread / self._spread.sum(axis=0)).T
        lower, upper = problem.bounds
        self.bounds = (self._gather @ lower, self._gather @ upper)

    def pack(self, antecedents: Antecedents) -> NDArray[np.float64]:
        """Antecedents on a grid as q."""
        packed: NDArray[np.float64] = self._gather @ self._problem.pack(antecedents)
        return packed

    def unpack(self, parameters: NDArray[np.float64]) -> Antecedents:
        """q as antecedents in z-scores."""
        return self._problem.unpack(self._spread @ parameters)

    def evaluate(self, parameters: NDArray[np.float64]) -> ProjectedFit:
        """As `VariableProjection.evaluate`, at q."""
        return self._problem.evaluate(self._spread @ parameters)

    def normal_equations(self, fit: ProjectedFit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As `VariableProjection.normal_equations`, for q: B'AB and B'g."""
        curvature, downhill = self._problem.normal_equations(fit)
        return self._spread.T @ curvature @ self._spread, self._spread.T @ downhill


def common_inputs(n_inputs: int) -> tuple[int, ...]:
    """The inputs whose slope tied rules share: all but the last, which is the rate."""
    return tuple(range(n_inputs - 1))


@dataclass(frozen=True)
class Candidate:
    """Antecedents in z-scores and how the walk to them ended; sets: of each input, where rules share them."""

    antecedents: Antecedents
    sets: tuple[int, ...] | None
    optimum: Optimum


class JointWalk:
    """Improves antecedents on z-scored inputs (n, d) and targets (n,); deterministic, never worse than its start.

    sets: fuzzy sets per input; the start is then a grid of rules, last input fastest, and stays one. tied: the sets of
    an input have one width, and the slopes of all inputs but the last are shared by all rules (`common_inputs`).
    """

    def __init__(
        self,
        inputs: NDArray[np.float64],
        targets: NDArray[np.float64],
        start: Antecedents,
        *,
        ridge: float,
        sets: tuple[int, ...] | None = None,
        tied: bool = False,
    ) -> None:
        common = common_inputs(inputs.shape[1]) if tied else ()
        whole = VariableProjection(inputs, targets, len(start.centres), ridge, common)
        self._problem = whole if sets is None else SharedSets(whole, sets, equal_widths=tied)
        self._sets = sets
        self._walk = Walk(self._problem, self._problem.pack(start), self._problem.bounds)

    def advance(self, max_iter: int) -> Candidate:
        """Go on until max_iter steps have been made in all, or until the walk converges."""
        optimum = self._walk.advance(max_iter)
        return Candidate(self._problem.unpack(optimum.parameters), self._sets, optimum)
