"""Thermal network of one gyro in the chamber's air. The fibre-optic one: housing, coil outer, coil inner, sensor.

    dT_h/dt = (T_a + rise - T_h)/τ_h    dT_o/dt = (T_h - T_o)/τ_o    dT_i/dt = (T_o - T_i)/τ_i
    dT_s/dt = ((T_o + T_i)/2 - T_s)/τ_s

The network is solved together with the chamber's law as one linear system, so it is as exact as the chamber, and it
does not act back on the chamber: a gyro never feels another one. (The DUTs' mass and heat are the chamber's load node.)
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.chamber import ChamberPiece, ChamberPlant
from simulated_hw.physics.chamber_laws import AIR, STATES, ChamberLaws, Law
from simulated_hw.physics.gyro_parameters import SensorParameters, ThermalParameters
from simulated_hw.physics.linear import LinearSystem, Trajectory
from simulated_hw.physics.power import PowerHistory

HOUSING, OUTER, INNER, SENSOR = range(4)
_NODES = 4


@dataclass(frozen=True, eq=False)
class ThermalNetwork:
    """x' = matrix x + from_air T_air + heating, the latter while powered; x (n,) in °C, matrix and from_air in 1/s,
    heating in K/s.
    """

    matrix: NDArray[np.float64]
    from_air: NDArray[np.float64]
    heating_k_s: NDArray[np.float64]


def fog_network(thermal: ThermalParameters, sensor: SensorParameters) -> ThermalNetwork:
    """Housing, coil outer, coil inner and sensor of a fibre-optic gyro."""
    from_air, heating = np.zeros(_NODES), np.zeros(_NODES)
    from_air[HOUSING] = 1.0 / thermal.housing_s
    heating[HOUSING] = thermal.self_heating_k / thermal.housing_s
    return ThermalNetwork(_chain_matrix(thermal, sensor), from_air, heating)


@dataclass(frozen=True, slots=True, eq=False)
class _Segment:
    """Part of a chamber's piece during which the gyro is powered, or is not."""

    piece: ChamberPiece
    start_s: float
    powered: bool

    def same(self, other: "_Segment") -> bool:
        return self.piece is other.piece and self.start_s == other.start_s and self.powered == other.powered


class ThermalChain:
    """Temperatures inside one gyro; it starts at room temperature and warms up while powered."""

    def __init__(self, chamber: ChamberPlant, network: ThermalNetwork, power: PowerHistory | None = None) -> None:
        self._chamber = chamber
        self._network = network
        self._power = power or PowerHistory()
        self._size = STATES + len(network.matrix)
        self._systems: dict[tuple[ChamberLaws, Law], LinearSystem] = {}
        self._segments: list[_Segment] = []
        self._starts_s: list[float] = []
        self._full: list[Trajectory] = []
        self._nodes: list[Trajectory] = []

    def _system(self, laws: ChamberLaws, law: Law) -> LinearSystem:
        if (laws, law) not in self._systems:
            self._systems[laws, law] = self._joined(laws, law)
        return self._systems[laws, law]

    def _joined(self, laws: ChamberLaws, law: Law) -> LinearSystem:
        joined = np.zeros((self._size, self._size))
        joined[:STATES, :STATES] = laws.matrices[law]
        joined[STATES:, STATES:] = self._network.matrix
        joined[STATES:, AIR] = self._network.from_air
        return LinearSystem(joined)

    def _follow(self, until_s: float) -> list[float]:
        """Solve the network for all of the chamber's history and the gyro's power; start times of the segments."""
        segments = self._cut(self._chamber.pieces_until(until_s))
        same = 0
        while same < len(self._segments) and same < len(segments) and self._segments[same].same(segments[same]):
            same += 1
        del self._segments[same:], self._starts_s[same:], self._full[same:], self._nodes[same:]
        for segment in segments[same:]:
            self._add(segment)
        return self._starts_s

    def _cut(self, pieces: list[ChamberPiece]) -> list[_Segment]:
        """The chamber's pieces, cut where the gyro was switched on or off."""
        power, segments = self._power, []
        for number, piece in enumerate(pieces):
            end_s = pieces[number + 1].start_s if number + 1 < len(pieces) else np.inf
            cuts = power.switched_between(piece.start_s, end_s) if power.commands_s else []
            segments += [_Segment(piece, at_s, power.is_on(at_s)) for at_s in (piece.start_s, *cuts)]
        return segments

    def _add(self, segment: _Segment) -> None:
        piece, elapsed_s = segment.piece, segment.start_s - segment.piece.start_s
        state = np.full(self._size, self._chamber.parameters.room_degc)
        if self._segments:
            state = self._full[-1].state(segment.start_s - self._starts_s[-1])
        state[:STATES] = piece.trajectory.state(elapsed_s)
        constant, slope = np.zeros(self._size), np.zeros(self._size)
        setpoint_degc = piece.setpoint_degc + piece.slope_k_s * elapsed_s
        constant[:STATES], slope[:STATES] = piece.laws.drive(piece.law, setpoint_degc, piece.slope_k_s)
        if segment.powered:
            constant[STATES:] = self._network.heating_k_s
        full = self._system(piece.laws, piece.law).solve(state, constant, slope)
        self._segments.append(segment)
        self._starts_s.append(segment.start_s)
        self._full.append(full)
        self._nodes.append(full.project(np.eye(self._size)[:, STATES:]))

    def temperatures_degc(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The network's nodes at rising times, shape (n, nodes)."""
        starts = self._follow(float(times_s[-1]))
        out = np.empty((len(times_s), self._size - STATES))
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


def coil_slopes_k_s(
    thermal: ThermalParameters, temperatures_degc: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """dT_o/dt and dT_i/dt of a fibre-optic gyro's coil at states of its network, shape (n, 4), in K/s."""
    housing, outer, inner = temperatures_degc[:, HOUSING], temperatures_degc[:, OUTER], temperatures_degc[:, INNER]
    return (housing - outer) / thermal.coil_outer_s, (outer - inner) / thermal.coil_inner_s


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
