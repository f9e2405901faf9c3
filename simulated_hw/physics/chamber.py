"""Temperature chamber in exact pieces: between two events one linear law holds, its solution known for all times.

An event is a command, the end of a setpoint ramp, or the controller reaching or leaving full heating or cooling power.
The history is kept, so instants before the latest command can be asked for (a block of frames read late).
"""

from bisect import bisect_right
from dataclasses import dataclass, replace
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.chamber_laws import AIR, PROBE, STATES, ChamberLaws, Law
from simulated_hw.physics.linear import Trajectory
from simulated_hw.physics.parameters import ChamberParameters
from simulated_hw.physics.streams import ReadingNoise, Stream

# Events are looked for on a grid anchored to the start of a piece, never to the query, so that asking changes nothing.
# The fastest pole of a chamber is some ten seconds; 2 s cannot step over an excursion that matters.
_SCAN_STEP_S = 2.0
_SCAN_STEPS = 300
_SCAN = np.arange(_SCAN_STEPS + 1, dtype=np.float64) * _SCAN_STEP_S
# Root finding to 1 µs: 2 s halved 21 times.
_HALVINGS = 21
_PROBE_UPDATE_S = 0.5
# What a chamber that is switched off does not have.
_OFF = {"heating_power_w": 0.0, "cooling_power_w": 0.0, "cooling_slope_w_k": 0.0, "fan_power_w": 0.0}


@dataclass(frozen=True, slots=True, eq=False)
class ChamberPiece:
    """From start_s on one law of the machine's laws holds, the internal setpoint being setpoint + slope · elapsed."""

    start_s: float
    laws: ChamberLaws
    law: Law
    setpoint_degc: float
    slope_k_s: float
    ramp_end_s: float
    final_degc: float
    trajectory: Trajectory

    def setpoint_at(self, now_s: float) -> float:
        """The internal, ramped setpoint."""
        if now_s >= self.ramp_end_s:
            return self.final_degc
        return self.setpoint_degc + self.slope_k_s * (now_s - self.start_s)


class ChamberPlant:
    """A chamber with a PI controller and a setpoint generator, at room temperature at time 0.

    Times are seconds of the world's clock. Commands come in order of time; queries may be of any time from 0 on.
    """

    def __init__(self, parameters: ChamberParameters, seed: int) -> None:
        self.parameters = parameters
        self.laws = ChamberLaws(parameters)
        self._machine, self._on = parameters, True
        self.probe_offset_k = float(
            Stream(seed, "chamber", "probe offset").chunk(0).standard_normal() * parameters.probe_offset_sigma_k
        )
        self._probe_noise = ReadingNoise(Stream(seed, "chamber", "probe noise"), _PROBE_UPDATE_S)
        self.commands_s: list[float] = []
        self._excursions_s: list[float] = []
        self._directions = [0]
        start = self._piece(0.0, self.laws.at_rest(), parameters.room_degc, parameters.room_degc, inf)
        self._pieces, self._starts_s = [start], [0.0]
        self._scanned_s = 0.0

    @property
    def limits_degc(self) -> tuple[float, float]:
        """Lowest and highest setpoint accepted."""
        return self.parameters.min_setpoint_degc, self.parameters.max_setpoint_degc

    @property
    def final_setpoint_degc(self) -> float:
        """The setpoint last commanded, where the ramp ends."""
        return self._pieces[-1].final_degc

    def command(self, now_s: float, setpoint_degc: float, ramp_degc_min: float | None = None) -> None:
        """Move the setpoint from where it is now, at `ramp_degc_min` or the machine's own limit, whichever is slower.

        Raises ValueError for a setpoint outside the limits, a ramp that is not above 0, or a time before the last one.
        """
        low, high = self.limits_degc
        if not low <= setpoint_degc <= high:
            raise ValueError(f"chamber setpoint {setpoint_degc} °C is outside {low:g} … {high:g} °C")
        if ramp_degc_min is not None and not ramp_degc_min > 0:
            raise ValueError(f"chamber ramp {ramp_degc_min} °C/min: must be above 0, or None for as fast as it can")
        if not (isfinite(now_s) and now_s >= (self.commands_s[-1] if self.commands_s else 0.0)):
            raise ValueError(f"chamber command at {now_s} s lies before the last one")
        latest = self._cut(now_s)
        before_degc, final_degc = latest.setpoint_at(now_s), self.final_setpoint_degc
        state = latest.trajectory.state(now_s - latest.start_s)
        self._append(self._piece(now_s, state, before_degc, setpoint_degc, self._pace(ramp_degc_min)))
        self.commands_s.append(now_s)
        if setpoint_degc != final_degc:
            self._excursions_s.append(now_s)
            self._directions.append(1 if setpoint_degc > final_degc else -1)

    def alter(self, now_s: float, parameters: ChamberParameters) -> None:
        """From now on another machine in the same state: a door open, a compressor weak. `parameters` stays the healthy
        one's, whose limits and readings hold on.
        """
        self._machine = parameters
        latest = self._cut(now_s)
        state, setpoint = latest.trajectory.state(now_s - latest.start_s), latest.setpoint_at(now_s)
        self.laws = ChamberLaws(parameters if self._on else replace(parameters, **_OFF))
        pace = abs(latest.slope_k_s) if latest.slope_k_s else inf
        self._append(self._piece(now_s, state, setpoint, latest.final_degc, pace))
        self.commands_s.append(now_s)

    def switch(self, now_s: float, on: bool) -> None:
        """Switch conditioning: off, neither heater, compressor nor fan runs, and the setpoint waits."""
        if on != self._on:
            self._on = on
            self.alter(now_s, self._machine)

    def _pace(self, ramp_degc_min: float | None) -> float:
        own = self.parameters.max_ramp_degc_min
        return min(inf if ramp_degc_min is None else ramp_degc_min, inf if own is None else own) / 60.0

    def _cut(self, now_s: float) -> ChamberPiece:
        """Forget the future as it would have been; the piece that holds now."""
        self._extend(now_s)
        keep = bisect_right(self._starts_s, now_s)
        del self._pieces[keep:], self._starts_s[keep:]
        return self._pieces[-1]

    def _append(self, piece: ChamberPiece) -> None:
        self._pieces.append(piece)
        self._starts_s.append(piece.start_s)
        self._scanned_s = piece.start_s

    def _piece(
        self,
        start_s: float,
        state: NDArray[np.float64],
        setpoint_degc: float,
        final_degc: float,
        pace_k_s: float,
        law: Law | None = None,
    ) -> ChamberPiece:
        distance = final_degc - setpoint_degc
        if distance == 0.0 or pace_k_s == inf:
            setpoint_degc, slope, ramp_end_s = final_degc, 0.0, start_s
        else:
            slope, ramp_end_s = float(np.copysign(pace_k_s, distance)), start_s + abs(distance) / pace_k_s
        if law is None:
            law = self.laws.law_for(state, setpoint_degc)
        trajectory = self.laws.systems[law].solve(state, *self.laws.drive(law, setpoint_degc, slope))
        return ChamberPiece(start_s, self.laws, law, setpoint_degc, slope, ramp_end_s, final_degc, trajectory)

    def _extend(self, now_s: float) -> None:
        """Make sure that all pieces up to now are known."""
        while self._scanned_s <= now_s:
            last = self._pieces[-1]
            event_s, law = self._next_event(last, self._scanned_s)
            if event_s == inf:
                self._scanned_s += _SCAN[-1]
                continue
            state = last.trajectory.state(event_s - last.start_s)
            pace = abs(last.slope_k_s) if last.slope_k_s else inf
            self._append(self._piece(event_s, state, last.setpoint_at(event_s), last.final_degc, pace, law))

    def _next_event(self, piece: ChamberPiece, from_s: float) -> tuple[float, Law | None]:
        """The first change of law or end of ramp within the scan from from_s on; (inf, None) if there is none."""
        ramping = piece.slope_k_s != 0.0 and piece.ramp_end_s <= from_s + _SCAN[-1]
        event_s, law = (piece.ramp_end_s, None) if ramping else (inf, None)
        begin = from_s - piece.start_s
        elapsed = begin + _SCAN
        for row, gain, constant, following in self.laws.exits(piece.law):
            margin = piece.trajectory.project(row[:, None])
            margin.polynomial[0, 0] += gain * piece.setpoint_degc + constant
            margin.polynomial[1, 0] += gain * piece.slope_k_s
            crossing_s = piece.start_s + _first_rise(margin, elapsed)
            if crossing_s < event_s:
                event_s, law = crossing_s, following
        return event_s, law

    def pieces_until(self, now_s: float) -> list[ChamberPiece]:
        """All pieces from time 0 on, at least to now_s; what lies after the latest command may still change."""
        self._extend(now_s)
        return self._pieces

    def _at(self, now_s: float) -> tuple[ChamberPiece, float]:
        self._extend(now_s)
        piece = self._pieces[bisect_right(self._starts_s, now_s) - 1]
        return piece, now_s - piece.start_s

    def state(self, now_s: float) -> NDArray[np.float64]:
        """Air, wall, load and probe temperatures (°C) and the controller's integral (W)."""
        piece, elapsed = self._at(now_s)
        return piece.trajectory.state(elapsed)

    def states(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same at many instants, in any order, shape (n, 5)."""
        times = np.ascontiguousarray(times_s, dtype=np.float64)
        self._extend(float(times.max(initial=0.0)))
        which = np.searchsorted(np.array(self._starts_s), times, side="right") - 1
        out = np.empty((len(times), STATES))
        for index in np.unique(which):
            mine, piece = which == index, self._pieces[index]
            out[mine] = piece.trajectory.at(times[mine] - piece.start_s)
        return out

    def air_degc(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Air temperature at many instants, in any order."""
        return self.states(times_s)[:, AIR]

    def probe_degc(self, now_s: float) -> float:
        """A reading of the control probe: lagging, noisy, and off by its hidden offset."""
        noise = self._probe_noise.at(now_s) * self.parameters.probe_noise_k
        return float(self.state(now_s)[PROBE]) + self.probe_offset_k + noise

    def setpoint_degc(self, now_s: float) -> float:
        """The internal setpoint, on its way along the ramp."""
        return self._at(now_s)[0].setpoint_at(now_s)

    def commanded_degc(self, now_s: float) -> float:
        """The setpoint commanded, where the ramp under way ends."""
        return self._at(now_s)[0].final_degc

    def power_percent(self, now_s: float) -> float:
        """Controller output: +100 full heating, -100 full cooling."""
        if not self._on:
            return 0.0
        piece, elapsed = self._at(now_s)
        if piece.law is not Law.REGULATED:
            return 100.0 if piece.law is Law.HEATING else -100.0
        state = piece.trajectory.state(elapsed)
        demanded = piece.laws.demanded_w(state, piece.setpoint_at(now_s))
        full = self.parameters.heating_power_w if demanded > 0 else -piece.laws.coldest_w(float(state[AIR]))
        return 100.0 * demanded / full if full > 0 else 0.0

    def excursions(self, times_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """How many times the setpoint had been changed by then: the numbers of the thermal excursions."""
        return np.searchsorted(np.array(self._excursions_s), times_s, side="right").astype(np.int64)

    def direction(self, excursion: int) -> int:
        """+1 if that excursion went up, -1 if down, 0 before the first."""
        return self._directions[excursion]


def _first_rise(margin: Trajectory, elapsed: NDArray[np.float64]) -> float:
    """When the (n, 1) margin first rises above 0 within the elapsed times; inf if it does not."""
    # Rounding of a sum of terms of some kilowatts.
    above = np.flatnonzero(margin.at(elapsed)[1:, 0] > 1e-9)
    if not len(above):
        return inf
    low, high = float(elapsed[above[0]]), float(elapsed[above[0] + 1])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if margin.state(middle)[0] > 0.0:
            high = middle
        else:
            low = middle
    return high
