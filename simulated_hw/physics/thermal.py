"""Thermal chain of one gyro in the chamber's air: housing, coil outer, coil inner, and its temperature sensor.

    dT_h/dt = (T_a + rise - T_h)/τ_h    dT_o/dt = (T_h - T_o)/τ_o    dT_i/dt = (T_o - T_i)/τ_i
    dT_s/dt = ((T_o + T_i)/2 - T_s)/τ_s

The chain is solved together with the chamber's law as one linear system, so it is as exact as the chamber, and it does
not act back on the chamber: a gyro never feels another one. (The DUTs' mass and heat are the chamber's load node.)
"""

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.chamber import ChamberPiece, ChamberPlant
from simulated_hw.physics.chamber_laws import AIR, STATES, ChamberLaws, Law
from simulated_hw.physics.gyro_parameters import SensorParameters, ThermalParameters
from simulated_hw.physics.linear import LinearSystem, Trajectory

HOUSING, OUTER, INNER, SENSOR = range(4)
_NODES = 4


class ThermalChain:
    """Temperatures inside one gyro; it starts at room temperature and is powered, hence warming up, from time 0."""

    def __init__(self, chamber: ChamberPlant, thermal: ThermalParameters, sensor: SensorParameters) -> None:
        self._chamber = chamber
        self._thermal = thermal
        self._matrix = _chain_matrix(thermal, sensor)
        self._systems: dict[tuple[ChamberLaws, Law], LinearSystem] = {}
        self._pieces: list[ChamberPiece] = []
        self._full: list[Trajectory] = []
        self._nodes: list[Trajectory] = []

    def _system(self, laws: ChamberLaws, law: Law) -> LinearSystem:
        if (laws, law) not in self._systems:
            self._systems[laws, law] = self._joined(laws, law)
        return self._systems[laws, law]

    def _joined(self, laws: ChamberLaws, law: Law) -> LinearSystem:
        joined = np.zeros((STATES + _NODES, STATES + _NODES))
        joined[:STATES, :STATES] = laws.matrices[law]
        joined[STATES:, STATES:] = self._matrix
        joined[STATES + HOUSING, AIR] = 1.0 / self._thermal.housing_s
        return LinearSystem(joined)

    def _follow(self, until_s: float) -> list[float]:
        """Solve the chain for every piece of the chamber's history; start times of the pieces."""
        pieces = self._chamber.pieces_until(until_s)
        same = 0
        while same < len(self._pieces) and same < len(pieces) and self._pieces[same] is pieces[same]:
            same += 1
        del self._pieces[same:], self._full[same:], self._nodes[same:]
        for piece in pieces[same:]:
            self._add(piece)
        return [piece.start_s for piece in self._pieces]

    def _add(self, piece: ChamberPiece) -> None:
        state = np.full(STATES + _NODES, self._chamber.parameters.room_degc)
        if self._pieces:
            state = self._full[-1].state(piece.start_s - self._pieces[-1].start_s)
        state[:STATES] = piece.trajectory.state(0.0)
        constant, slope = np.zeros(STATES + _NODES), np.zeros(STATES + _NODES)
        constant[:STATES], slope[:STATES] = piece.laws.drive(piece.law, piece.setpoint_degc, piece.slope_k_s)
        constant[STATES + HOUSING] = self._thermal.self_heating_k / self._thermal.housing_s
        full = self._system(piece.laws, piece.law).solve(state, constant, slope)
        self._pieces.append(piece)
        self._full.append(full)
        self._nodes.append(full.project(np.eye(STATES + _NODES)[:, STATES:]))

    def temperatures_degc(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Housing, coil outer, coil inner and sensor at rising times, shape (n, 4)."""
        starts = self._follow(float(times_s[-1]))
        out = np.empty((len(times_s), _NODES))
        first = max(bisect_right(starts, float(times_s[0])) - 1, 0)
        at = 0
        for index in range(first, len(starts)):
            end = len(times_s)
            if index + 1 < len(starts):
                end = int(np.searchsorted(times_s, starts[index + 1], side="left"))
            if end > at:
                out[at:end] = self._nodes[index].at(times_s[at:end] - starts[index])
                at = end
        return out

    def slopes_k_s(self, temperatures_degc: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """dT_o/dt and dT_i/dt at states as `temperatures_degc` returns them, K/s."""
        housing, outer, inner = temperatures_degc[:, HOUSING], temperatures_degc[:, OUTER], temperatures_degc[:, INNER]
        return (housing - outer) / self._thermal.coil_outer_s, (outer - inner) / self._thermal.coil_inner_s


def coil_degc(temperatures_degc: NDArray[np.float64]) -> NDArray[np.float64]:
    """The coil's temperature, to which scale factor and bias answer: the mean of its outside and inside."""
    return np.asarray(0.5 * (temperatures_degc[:, OUTER] + temperatures_degc[:, INNER]))


def _chain_matrix(thermal: ThermalParameters, sensor: SensorParameters) -> NDArray[np.float64]:
    chain = np.zeros((_NODES, _NODES))
    chain[HOUSING, HOUSING] = -1.0 / thermal.housing_s
    chain[OUTER, [HOUSING, OUTER]] = np.array([1.0, -1.0]) / thermal.coil_outer_s
    chain[INNER, [OUTER, INNER]] = np.array([1.0, -1.0]) / thermal.coil_inner_s
    chain[SENSOR, [OUTER, INNER, SENSOR]] = np.array([0.5, 0.5, -1.0]) / sensor.lag_s
    return chain
