"""Random errors of a gyro's rate, by generators that are exact in discrete time whatever the interval.

White noise (angle random walk) is drawn frame by frame. Flicker, rate random walk and ramp are drawn as exact means
over one row of frames (about a second) and held within the row: below a second white noise is above them by orders of
magnitude (0.05 deg/sqrt(h) is 3 deg/h at 1 s, against a floor of some tenths), so the steps cannot be seen, and every
average over whole rows has exactly the right statistics. Rows come in chunks of 1024 on one absolute grid; the state at
each chunk's start is kept, so a chunk is the same whoever asks for it, in whatever order.
"""

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.gyro_parameters import NoiseParameters
from simulated_hw.physics.streams import Stream

ROWS_PER_CHUNK = 1024
# Allan floor of flicker noise: sqrt(2 ln 2 / π) B.
FLOOR_PER_B = sqrt(2.0 * log(2.0) / np.pi)
# One process per decade gives the floor within 1 %; the band must reach 30 times below the shortest averaging time
# looked at (3 s) and 10 times beyond the longest record (weeks).
_BAND_S = 10.0 ** np.arange(-1.0, 8.0)
_RATIO = 10.0
_DPH = 1.0 / 3600.0


def white_sigma_dps(noise: NoiseParameters, interval_s: float) -> float:
    """Standard deviation of the mean over an interval: N sqrt(1/Δt), N in deg/sqrt(h) = 60 N deg/h sqrt(s)."""
    return 60.0 * noise.arw_deg_sqrt_h / sqrt(interval_s) * _DPH


class FlickerBank:
    """Gauss–Markov processes of equal variance with correlation times a decade apart; block means over dt, exact.

    Over one interval the state x moves to a x + w and its mean is (T (1 - a) x + v)/dt, with r = dt/T, a = e^-r and
    (w, v) jointly normal: var w = s² (1 - a²), var v = s² T² (2r - 3 + 4a - a²), cov = s² T (1 - a)². The part of v
    independent of w has no memory, so one draw serves all processes: `own_dph` is the deviation of their sum.
    """

    def __init__(self, floor_dph: float, interval_s: float) -> None:
        tc = _BAND_S[:, None]
        r = interval_s / tc
        variance = floor_dph**2 * log(_RATIO) / (2.0 * log(2.0))
        lost = -np.expm1(-r)  # 1 - a
        # The closed form loses all digits for small r; its series does not.
        v2 = np.where(r < 1e-3, 2.0 * r**3 / 3.0 - r**4 / 2.0, 2.0 * r - 3.0 + 4.0 * np.exp(-r) - np.exp(-2.0 * r))
        w2 = -np.expm1(-2.0 * r)
        self.sigma_dph = sqrt(variance)
        self._r = r
        self._w = self.sigma_dph * np.sqrt(w2)
        self._mean_x = (tc * lost / interval_s)[:, 0]
        self._mean_w = (self.sigma_dph * tc / interval_s * lost**2 / np.sqrt(w2))[:, 0]
        own = self.sigma_dph * tc / interval_s * np.sqrt(np.maximum(v2 - lost**4 / w2, 0.0))
        self.own_dph = float(np.sqrt(np.sum(own**2)))

    def advance(
        self, state: NDArray[np.float64], g: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """From state (9,) and normals g (9, n): the n interval means but for their own part, and the state after."""
        path = np.concatenate([state[:, None], self._w * g], axis=1)
        shift = 1
        while shift < path.shape[1]:  # x_k = a x_(k-1) + w_k as a prefix sum, by doubling
            path[:, shift:] += np.exp(-self._r * shift) * path[:, :-shift]
            shift *= 2
        return self._mean_x @ path[:, :-1] + self._mean_w @ g, path[:, -1].copy()


class SlowNoise:
    """Flicker, rate random walk and rate ramp of one gyro, as means over rows of frames."""

    def __init__(self, noise: NoiseParameters, row_s: float, stream: Stream) -> None:
        self._noise, self._row_s, self._stream = noise, row_s, stream
        self._bank = FlickerBank(FLOOR_PER_B * noise.bias_instability_dph, row_s)
        start = stream.chunk(0).standard_normal(len(_BAND_S)) * self._bank.sigma_dph
        self._states = [np.append(start, 0.0)]  # at the start of each chunk: the bank, and the random walk

    def means_dps(self, chunk: int) -> NDArray[np.float64]:
        """The row means of one chunk, shape (1024,)."""
        while len(self._states) <= chunk:
            self._advance(len(self._states) - 1)
        return self._advance(chunk)

    def _advance(self, chunk: int) -> NDArray[np.float64]:
        n = len(_BAND_S)
        g = self._stream.chunk(chunk + 1).standard_normal((n + 2, ROWS_PER_CHUNK))
        state = self._states[chunk]
        flicker, bank = self._bank.advance(state[:n], g[:n])
        # Random walk: the mean over a row is its start + half the increment + an independent part of variance step²/12.
        step = self._noise.rrw_dph_sqrt_h / 60.0 * sqrt(self._row_s)
        walk = state[n] + np.concatenate([[0.0], np.cumsum(step * g[n])])
        own = sqrt(self._bank.own_dph**2 + step**2 / 12.0) * g[n + 1]
        hours = (chunk * ROWS_PER_CHUNK + np.arange(ROWS_PER_CHUNK) + 0.5) * self._row_s / 3600.0
        if len(self._states) == chunk + 1:
            self._states.append(np.append(bank, walk[-1]))
        return np.asarray((flicker + 0.5 * (walk[:-1] + walk[1:]) + own + self._noise.rate_ramp_dph_h * hours) * _DPH)
