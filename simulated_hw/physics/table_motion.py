"""Motion of the table's axis in exact pieces, and the profiles that make them up.

Under power the rate follows its reference as a second-order servo, ω'' = ω_n² (ref - ω) - 2 ζ ω_n ω'; the reference
moves in straight lines limited by the acceleration. Once the servo's transient has died away the rate is constant, and
the mean rate of a frame has a closed form.
"""

from dataclasses import dataclass
from math import inf, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.linear import LinearSystem, Trajectory
from simulated_hw.physics.parameters import TableParameters

# A transient below this is called over: 1e-11 deg/s turns the table by 1 arcsec in a million years.
_OVER_DPS = 1e-11
_DEG = pi / 180.0
_ARCSEC_DEG = 1.0 / 3600.0


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight line of the rate reference: it starts at rate_dps and changes by slope_dps2 for duration_s."""

    duration_s: float
    rate_dps: float
    slope_dps2: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """From start_s on; without a trajectory the rate is constant, with one its columns are angle turned and rate.

    `reference` is the leg being followed (None when coasting), for the next command to start from.
    """

    start_s: float
    angle_deg: float
    rate_dps: float
    reference: Leg | None
    trajectory: Trajectory | None = None
    acceleration: Trajectory | None = None

    def state(self, now_s: float) -> tuple[float, float, float]:
        """Angle (not wrapped), rate and acceleration at one instant, deg, deg/s, deg/s²."""
        elapsed = now_s - self.start_s
        if self.trajectory is None:
            return self.angle_deg + self.rate_dps * elapsed, self.rate_dps, 0.0
        turned, rate = self.trajectory.state(elapsed).tolist()
        acceleration = 0.0 if self.acceleration is None else float(self.acceleration.state(elapsed)[0])
        return self.angle_deg + turned, rate, acceleration

    def turned_deg(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Angle turned since the start of this motion."""
        elapsed = times_s - self.start_s
        return elapsed * self.rate_dps if self.trajectory is None else self.trajectory.at(elapsed)[:, 0]


class AngleErrors:
    """Σ a_n sin(n θ + p_n): what bearing and encoder add to the angle, and hence to the rate."""

    def __init__(self, parameters: TableParameters, phases_rad: NDArray[np.float64]) -> None:
        present = [i for i, a in enumerate(parameters.angle_error_arcsec) if a]
        self.orders = np.array(parameters.angle_error_orders, dtype=np.float64)[present]
        self.amplitudes_deg = np.array(parameters.angle_error_arcsec)[present] * _ARCSEC_DEG
        self.phases_rad = phases_rad[present]

    def at(self, angle_deg: NDArray[np.float64]) -> NDArray[np.float64]:
        """The angle error, deg."""
        turn = np.mod(angle_deg, 360.0) * _DEG
        out = np.zeros_like(turn)
        for order, amplitude, phase in zip(self.orders, self.amplitudes_deg, self.phases_rad, strict=True):
            out += amplitude * np.sin(order * turn + phase)
        return out

    def mean_rates(self, angles_deg: NDArray[np.float64], rate_dps: float, dt_s: float, n: int) -> NDArray[np.float64]:
        """Mean rate over n intervals dt from each starting angle at a constant rate, shape (len(angles), n), deg/s.

        (sin(x + h) - sin(x - h)) = 2 cos x sin h, and cos(A + B) splits into a matrix product of rows A and columns B.
        """
        a = np.outer(np.mod(angles_deg, 360.0) * _DEG, self.orders) + self.phases_rad
        b = np.outer(self.orders, (np.arange(n) + 0.5) * (rate_dps * dt_s * _DEG))
        size = 2.0 * self.amplitudes_deg / dt_s * np.sin(self.orders * (0.5 * rate_dps * dt_s * _DEG))
        left = np.concatenate([size * np.cos(a), -size * np.sin(a), np.full((len(a), 1), rate_dps)], axis=1)
        return np.asarray(left @ np.concatenate([np.cos(b), np.sin(b), np.ones((1, n))], axis=0))


class Servo:
    """Turns legs of the reference into motions, exactly."""

    def __init__(self, parameters: TableParameters) -> None:
        self._natural = 2.0 * pi * parameters.servo_hz
        self._damping = parameters.servo_damping
        natural, damping = self._natural, self._damping
        self._closed = LinearSystem(
            np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(natural**2), -2.0 * damping * natural]])
        )
        self._coasting = LinearSystem(np.array([[0.0, 1.0], [0.0, -1.0 / parameters.coast_s]]))
        self._coast_s = parameters.coast_s
        self._decay = natural * (damping - sqrt(damping**2 - 1.0) if damping > 1.0 else damping)

    def follow(self, start_s: float, state: tuple[float, float, float], legs: list[Leg]) -> list[Motion]:
        """The motions from (angle, rate, acceleration) along the legs; the last leg is for ever, its rate constant."""
        motions: list[Motion] = []
        forcing, pick = np.array([0.0, 0.0, self._natural**2]), np.eye(3)
        for leg in legs:
            angle, rate, acceleration = state
            last = leg.duration_s == inf
            duration = self._settle_s(rate - leg.rate_dps, acceleration) if last else leg.duration_s
            if duration > 0.0:
                start = np.array([0.0, rate, acceleration])
                full = self._closed.solve(start, forcing * leg.rate_dps, forcing * leg.slope_dps2)
                turn, push = full.project(pick[:, :2]), full.project(pick[:, 2:])
                motions.append(Motion(start_s, angle % 360.0, rate, leg, turn, push))
                start_s += duration
                state = motions[-1].state(start_s)
        settled = legs[-1]
        return [*motions, Motion(start_s, state[0] % 360.0, settled.rate_dps, settled)]

    def _settle_s(self, off_dps: float, acceleration_dps2: float) -> float:
        size = abs(off_dps) + abs(acceleration_dps2) / self._natural
        # The envelope of a nearly critically damped pair grows to some times its start before it falls: hence the 100.
        return log(max(100.0 * size / _OVER_DPS, 1.0)) / self._decay

    def coast(self, start_s: float, state: tuple[float, float, float]) -> list[Motion]:
        """The motions of a released axis: friction brings it to rest with one time constant."""
        angle, rate, _ = state
        running = self._coasting.solve(np.array([0.0, rate]), np.zeros(2))
        stop_s = start_s + self._coast_s * log(max(abs(rate) / _OVER_DPS, 1.0))
        motions = [Motion(start_s, angle % 360.0, rate, None, running)]
        rest = motions[0].state(stop_s)[0] % 360.0
        return [*motions, Motion(stop_s, rest, 0.0, None)]

    def overrun_deg(self, rate_dps: float, acceleration_dps2: float) -> float:
        """How much further than its reference the axis turns until both rest: the integral of the servo's equation."""
        return (acceleration_dps2 + 2.0 * self._damping * self._natural * rate_dps) / self._natural**2


def to_rate(reference_dps: float, rate_dps: float, acceleration_dps2: float) -> list[Leg]:
    """Legs from one rate to another at an acceleration, then that rate for ever."""
    change = rate_dps - reference_dps
    legs = [Leg(inf, rate_dps)]
    if change:
        slope = acceleration_dps2 if change > 0 else -acceleration_dps2
        legs.insert(0, Leg(abs(change) / acceleration_dps2, reference_dps, slope))
    return legs


def by_angle(angle_deg: float, slew_dps: float, acceleration_dps2: float) -> list[Leg]:
    """Legs from rest that turn the axis by an angle: up, cruise if it is far enough, down, rest."""
    if not angle_deg:
        return [Leg(inf, 0.0)]
    sense = 1.0 if angle_deg > 0 else -1.0
    peak = min(slew_dps, sqrt(abs(angle_deg) * acceleration_dps2))
    ramp_s = peak / acceleration_dps2
    cruise_s = abs(angle_deg) / peak - ramp_s
    legs = [Leg(ramp_s, 0.0, sense * acceleration_dps2), Leg(ramp_s, sense * peak, -sense * acceleration_dps2)]
    if cruise_s > 0.0:
        legs.insert(1, Leg(cruise_s, sense * peak))
    return [*legs, Leg(inf, 0.0)]
