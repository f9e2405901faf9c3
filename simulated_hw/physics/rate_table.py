"""Single-axis rate table: commands in, true angle and rate out, and what its controller reads back.

True rate = servo response to the demand, in the controller's time base (a few ppm off, which the controller cannot
see), plus the rate ripple that the angle error of bearing and encoder makes of it. The history of motions is kept, so
frames may be asked for after later commands.
"""

from bisect import bisect_right
from math import ceil, floor, inf, isfinite

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.parameters import TableParameters
from simulated_hw.physics.streams import ReadingNoise, Stream
from simulated_hw.physics.table_motion import AngleErrors, Motion, Servo, by_angle, to_rate

# A motion that starts within this part of a frame of the frame's edge starts at the edge: 10 ns at 100 Hz.
_EDGE = 1e-6


class TablePlant:
    """A rate table, at power-on released and at rest at angle 0.

    Times are seconds of the world's clock. Commands come in order of time; queries may be of any time from 0 on.
    Rates are counter-clockwise positive.
    """

    def __init__(self, parameters: TableParameters, seed: int) -> None:
        self.parameters = parameters
        draw = Stream(seed, "table", "hidden").chunk(0)
        self.rate_gain_ppm = float(draw.standard_normal() * parameters.rate_gain_sigma_ppm)
        self.angle_error_phases_rad = draw.uniform(0.0, 2.0 * np.pi, len(parameters.angle_error_orders))
        self.acceleration_dps2 = parameters.acceleration_dps2
        self.mode = "off"
        self.commands_s: list[float] = []
        self._gain = 1.0 + 1e-6 * self.rate_gain_ppm
        self._errors = AngleErrors(parameters, self.angle_error_phases_rad)
        self._servo = Servo(parameters)
        self._rate_noise = ReadingNoise(Stream(seed, "table", "rate readback"), parameters.readback_update_s)
        self._angle_noise = ReadingNoise(Stream(seed, "table", "angle readback"), parameters.readback_update_s)
        self._motions = [Motion(0.0, 0.0, 0.0, None)]
        self._starts_s = [0.0]

    @property
    def max_rate_dps(self) -> float:
        """Fastest rate the axis can do, in either sense."""
        return self.parameters.max_rate_dps

    @property
    def max_acceleration_dps2(self) -> float:
        """Highest acceleration limit that can be set."""
        return self.parameters.max_acceleration_dps2

    @property
    def energised(self) -> bool:
        """Whether the axis is under power: in 'rate' or 'position' mode, not 'off'."""
        return self.mode != "off"

    def energise(self, now_s: float) -> None:
        """Close the servo; an axis still coasting is brought to rest at the acceleration limit."""
        if not self.energised:
            self.mode = "rate"
            self._demand_rate(now_s, 0.0)

    def release(self, now_s: float) -> None:
        """Open the servo: the axis coasts to rest."""
        state = self._cut(now_s).state(now_s)
        self.mode = "off"
        self._append(now_s, self._servo.coast(now_s, state))

    def brake(self, now_s: float) -> None:
        """Open the servo and stop the axis with its brake, as hard as the axis may be accelerated."""
        state = self._cut(now_s).state(now_s)
        self.mode = "off"
        legs = to_rate(self._reference_dps(now_s), 0.0, self.parameters.max_acceleration_dps2)
        self._append(now_s, self._servo.follow(now_s, state, legs))

    def run_away(self, now_s: float, rate_dps: float) -> None:
        """Leave the demand for a rate that nobody asked for, which may be beyond the limit."""
        self._require_power()
        self._demand_rate(now_s, rate_dps)

    def command_rate(self, now_s: float, rate_dps: float) -> None:
        """Demand a rate. Raises ValueError beyond the limit, RuntimeError if the axis is not energised."""
        limit = self.parameters.max_rate_dps
        if not abs(rate_dps) <= limit:
            raise ValueError(f"table rate {rate_dps} deg/s is beyond ±{limit:g} deg/s")
        self._require_power()
        self.mode = "rate"
        self._demand_rate(now_s, rate_dps)

    def command_position(self, now_s: float, position_deg: float) -> None:
        """Move to an angle the shortest way. Raises ValueError if not finite, RuntimeError if not energised."""
        if not isfinite(position_deg):
            raise ValueError(f"table position {position_deg} deg is not a finite angle")
        self._require_power()
        angle, rate, acceleration = self._cut(now_s).state(now_s)
        reference = self._reference_dps(now_s)
        self.mode = "position"
        limit = self.acceleration_dps2
        braking = to_rate(reference, 0.0, limit)[:-1]
        stop = angle + reference * abs(reference) / (2.0 * limit) + self._servo.overrun_deg(rate, acceleration)
        way = (position_deg - stop + 180.0) % 360.0 - 180.0
        legs = [*braking, *by_angle(way, self.parameters.slew_rate_dps, limit)]
        self._append(now_s, self._servo.follow(now_s, (angle, rate, acceleration), legs))

    def set_acceleration(self, acceleration_dps2: float) -> None:
        """Set the acceleration limit of later commands. Raises ValueError outside (0, max]."""
        highest = self.parameters.max_acceleration_dps2
        if not 0.0 < acceleration_dps2 <= highest:
            raise ValueError(f"table acceleration {acceleration_dps2} deg/s²: must be above 0, at most {highest:g}")
        self.acceleration_dps2 = acceleration_dps2

    def _require_power(self) -> None:
        if not self.energised:
            raise RuntimeError("the table's axis is released; energise it before commanding motion")

    def _demand_rate(self, now_s: float, rate_dps: float) -> None:
        state = self._cut(now_s).state(now_s)
        legs = to_rate(self._reference_dps(now_s), rate_dps * self._gain, self.acceleration_dps2)
        self._append(now_s, self._servo.follow(now_s, state, legs))

    def _reference_dps(self, now_s: float) -> float:
        motion = self._motions[-1]
        leg = motion.reference
        if leg is None:  # coasting: the servo takes over at the rate it finds
            return motion.state(now_s)[1]
        return leg.rate_dps + leg.slope_dps2 * (now_s - motion.start_s)

    def _cut(self, now_s: float) -> Motion:
        """Forget the future as it would have been; the motion that holds now."""
        if not (isfinite(now_s) and now_s >= (self.commands_s[-1] if self.commands_s else 0.0)):
            raise ValueError(f"table command at {now_s} s lies before the last one")
        keep = bisect_right(self._starts_s, now_s)
        del self._motions[keep:], self._starts_s[keep:]
        return self._motions[-1]

    def _append(self, now_s: float, motions: list[Motion]) -> None:
        self._motions.extend(motions)
        self._starts_s.extend(motion.start_s for motion in motions)
        self.commands_s.append(now_s)

    def _at(self, now_s: float) -> Motion:
        return self._motions[bisect_right(self._starts_s, now_s) - 1]

    def rate_dps(self, now_s: float) -> float:
        """Readback of the rate, in the controller's time base, with its noise and resolution."""
        p = self.parameters
        rate = self._at(now_s).state(now_s)[1] / self._gain + self._rate_noise.at(now_s) * p.rate_noise_dps
        return _rounded(rate, p.rate_resolution_dps)

    def position_deg(self, now_s: float) -> float:
        """Readback of the angle in [0, 360), with its noise and resolution."""
        p = self.parameters
        angle = self._at(now_s).state(now_s)[0] + self._angle_noise.at(now_s) * p.position_noise_deg
        return _rounded(angle % 360.0, p.position_resolution_deg) % 360.0

    def true_rate_dps(self, now_s: float) -> float:
        """The servo's rate without ripple, for the truth log."""
        return self._at(now_s).state(now_s)[1]

    def angles_deg(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """True angle, bearing error included, at rising times; whole turns are left out now and then."""
        times = np.ascontiguousarray(times_s, dtype=np.float64)
        out = np.empty_like(times)
        which = np.searchsorted(np.array(self._starts_s), times, side="right") - 1
        for index in np.unique(which).tolist():
            motion, mine = self._motions[index], which == index
            out[mine] = motion.angle_deg + motion.turned_deg(times[mine])
        return out + self._errors.at(out)

    def mean_rate_dps(self, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """True mean rate between rising edges, shape (len(edges) - 1,): angle difference over time difference."""
        edges = np.ascontiguousarray(edges_s, dtype=np.float64)
        first = max(bisect_right(self._starts_s, float(edges[0])) - 1, 0)
        turned, angle = np.empty_like(edges), np.empty_like(edges)
        total = 0.0
        at = 0
        for index in range(first, len(self._motions)):
            motion = self._motions[index]
            ends_s = self._starts_s[index + 1] if index + 1 < len(self._motions) else np.inf
            end = int(np.searchsorted(edges, ends_s, side="left"))
            if end > at:
                own = motion.turned_deg(edges[at:end])
                turned[at:end], angle[at:end] = total + own, motion.angle_deg + own
                at = end
            if at == len(edges):
                break
            total += motion.state(ends_s)[0] - motion.angle_deg
        return np.diff(turned + self._errors.at(angle)) / np.diff(edges)

    def mean_rate_of_frames(self, first: int, rows: int, columns: int, frame_s: float) -> NDArray[np.float64]:
        """True mean rate of frames first … first + rows·columns - 1, frame k lasting from k frame_s to (k + 1) frame_s.

        Fast where the rate is constant. Each frame's value depends on the motions it spans only, not on what else is
        asked for, provided rows start on the same grid: shape (rows · columns,).
        """
        count = rows * columns
        out = np.empty(count)
        index = max(bisect_right(self._starts_s, first * frame_s) - 1, 0)
        starts = [start_s / frame_s - first for start_s in self._starts_s[index:]]
        for motion, start, end in zip(self._motions[index:], starts, [*starts[1:], inf], strict=True):
            if start >= count:
                break
            a, b = max(ceil(start - _EDGE), 0), min(floor(min(end, count) + _EDGE), count)
            if b - a == count:
                return self._within(motion, first, (rows, columns), frame_s, a, b)
            if b > a:
                out[a:b] = self._within(motion, first, (rows, columns), frame_s, a, b)
            if start > 0.0 and abs(start - round(start)) > _EDGE:
                out[floor(start)] = self._across(first + floor(start), frame_s)
        return out

    def _within(
        self, motion: Motion, first: int, shape: tuple[int, int], frame_s: float, a: int, b: int
    ) -> NDArray[np.float64]:
        """Frames first + a … first + b - 1, all inside one motion."""
        if motion.trajectory is not None:
            turned = motion.turned_deg(np.arange(first + a, first + b + 1, dtype=np.float64) * frame_s)
            return np.diff(turned + self._errors.at(motion.angle_deg + turned)) / frame_s
        if motion.rate_dps == 0.0:
            return np.zeros(b - a)
        rows, columns = shape
        starts_s = (first + np.arange(rows, dtype=np.float64) * columns) * frame_s
        angles = motion.angle_deg + motion.rate_dps * (starts_s - motion.start_s)
        return self._errors.mean_rates(angles, motion.rate_dps, frame_s, columns).reshape(-1)[a:b]

    def _across(self, frame: int, frame_s: float) -> float:
        """One frame during which the motion changes."""
        return float(self.mean_rate_dps(np.array([frame, frame + 1]) * frame_s)[0])


def _rounded(value: float, step: float) -> float:
    return round(value / step) * step if step else value
