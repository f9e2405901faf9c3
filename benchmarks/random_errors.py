"""Allan deviation, AR(2) and Kalman filter beside allantools, statsmodels and filterpy on the same data in one run.

    python -m benchmarks.random_errors       # from the repository's root; about half a minute
    python3 do.py bench random_errors        # the same

One BLAS thread for everybody. A ratio is the peer's time over ours; `agreement` is the largest relative difference.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

if not __package__:  # run as a file: this folder would hide the package `fitting` behind this script
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != Path(__file__).resolve().parent]

import allantools
import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from scipy.linalg import block_diag
from statsmodels.tsa.ar_model import AutoReg

from fitting.blas import one_thread
from fitting.random_errors.allan import allan_curve, allan_variances
from fitting.random_errors.allan_fit import fit_allan
from fitting.random_errors.autoregression import Autoregression, fit_ar2
from fitting.random_errors.kalman import SmoothingModel, smooth

Array = NDArray[np.float64]
RECORD, TAUS = 10_000_000, 60
SAMPLES, SENSORS, MANY = 3000, 4, 400  # 30 s at 100 Hz, as reference experiment `north` fits them
STEPS = 3000


def timed(work: Callable[[], Any], repetitions: int) -> tuple[float, Any]:
    """Seconds of the quickest of several runs, and the result."""
    best, result = float("inf"), None
    for _ in range(repetitions):
        started = perf_counter()
        result = work()
        best = min(best, perf_counter() - started)
    return best, result


def say(what: str, ours_s: float, theirs_s: float, peer: str, agreement: float) -> None:
    """One line of the table."""
    times = f"{1e3 * ours_s:11.3f} ms{1e3 * theirs_s:12.2f} ms"
    print(f"{what:46}{times} {peer:12}{theirs_s / ours_s:8.1f} x{agreement:12.1e}")


def allan() -> None:
    """1e7 points, 60 averaging times to a ninth of the record."""
    rate = 15.0 + 0.3 * np.random.default_rng(0).standard_normal(RECORD)
    count = TAUS
    while len(factors := np.unique(np.geomspace(1, RECORD // 9, count).round().astype(np.int64))) < TAUS:
        count += 1
    ours_s, (variances, _) = timed(lambda: allan_variances(rate, factors), 2)
    theirs_s, theirs = timed(lambda: allantools.oadev(rate, data_type="freq", taus=factors.astype(float)), 1)
    agreement = float(np.abs(np.sqrt(variances) / theirs[1] - 1.0).max())
    say(f"overlapping Allan, {RECORD:.0e} points, {len(factors)} taus", ours_s, theirs_s, "allantools", agreement)
    hours_12 = allan_curve(rate[:43_200], 1.0)
    fit_s, _ = timed(lambda: fit_allan(hours_12), 3)
    print(f"{'Q N B K R with limits, 12 h at 1 Hz':46}{1e3 * fit_s:11.3f} ms")


def autoregression() -> None:
    """AR(2) with constant and its standard errors: one record, four, and 400 at once."""
    records = 10.0 + np.cumsum(np.random.default_rng(1).standard_normal((MANY, SAMPLES)), axis=1) * 0.01
    records += 0.3 * np.random.default_rng(2).standard_normal((MANY, SAMPLES))

    def peer(rows: Array) -> list[Any]:
        return [(fitted.params, fitted.bse) for fitted in (AutoReg(row, 2, trend="c").fit() for row in rows)]

    for count, repetitions in ((1, 50), (SENSORS, 20), (MANY, 2)):
        rows = records[:count]
        ours_s, found = timed(lambda rows=rows: fit_ar2(rows), repetitions)
        theirs_s, theirs = timed(lambda rows=rows: peer(rows), repetitions)
        say(f"AR(2) + constant, {count} x {SAMPLES}", ours_s, theirs_s, "statsmodels", ar_difference(found, theirs))


def ar_difference(found: Autoregression, theirs: list[Any]) -> float:
    ours = np.stack([found.constant, found.phi1, found.phi2, found.constant_u, found.phi1_u, found.phi2_u], axis=1)
    return float(np.abs(ours / np.array([np.concatenate(pair) for pair in theirs]) - 1.0).max())


def filterpy(z: Array, model: SmoothingModel, sensors: list[int]) -> Array:
    """The same filter for several sensors in one state, as published: states (n - 1, 3 s)."""
    phi1, phi2, constant, process, noise, of_constant = (np.asarray(values)[sensors] for values in vars(model).values())
    peer = KalmanFilter(dim_x=3 * len(sensors), dim_z=len(sensors))
    peer.F = block_diag(*([[a, b, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] for a, b in zip(phi1, phi2, strict=True)))
    peer.H = block_diag(*([[1.0, 0.0, 0.0]] for _ in sensors))
    peer.Q = block_diag(*(np.diag([q, 0.0, 0.0]) for q in process))
    peer.R = np.diag(noise)
    peer.P = block_diag(*(np.diag([r, r, c]) for r, c in zip(noise, of_constant, strict=True)))
    peer.x = np.stack([z[1, sensors], z[0, sensors], constant], axis=1).reshape(-1, 1)
    states = [peer.x[:, 0]]
    for row in z[2:, sensors]:
        peer.predict()
        peer.update(row[:, np.newaxis])
        states.append(peer.x[:, 0])
    return np.array(states)


def kalman() -> None:
    """One sensor, four sensors as the published 12-state filter, and 20 runs of four sensors."""
    rng = np.random.default_rng(3)
    z = (
        10.0
        + 0.3 * rng.standard_normal((STEPS, 20, SENSORS))
        + 0.01 * np.cumsum(rng.standard_normal((STEPS, 20, 4)), 0)
    )
    fitted = fit_ar2(z[:, 0].T)
    model = SmoothingModel(
        fitted.phi1, fitted.phi2, fitted.constant, fitted.noise_variance, np.full(SENSORS, 0.09), fitted.constant_u**2
    )
    first = SmoothingModel(*(np.asarray(values)[0] for values in vars(model).values()))
    one_s, alone = timed(lambda: filterpy(z[:, 0], model, [0]), 2)
    ours_s, found = timed(lambda: smooth(z[:, 0, 0], first), 5)
    say(f"Kalman, 1 sensor x {STEPS} steps", ours_s, one_s, "filterpy", difference(found.state, alone))
    twelve_s, together = timed(lambda: filterpy(z[:, 0], model, [0, 1, 2, 3]), 2)
    ours_s, found = timed(lambda: smooth(z[:, 0], model), 5)
    ours = found.state.transpose(0, 2, 1).reshape(len(together), -1)
    say(f"Kalman, 4 sensors x {STEPS}, 12 states", ours_s, twelve_s, "filterpy", difference(ours, together))
    say(f"Kalman, 4 sensors x {STEPS}, 3 states each", ours_s, 4.0 * one_s, "filterpy", difference(ours, together))
    ours_s, found = timed(lambda: smooth(z, model), 3)
    ours = found.state[:, :, 0].transpose(0, 2, 1).reshape(len(together), -1)
    say(f"Kalman, 20 runs x 4 sensors x {STEPS}", ours_s, 80.0 * one_s, "filterpy", difference(ours, together))


def difference(ours: Array, theirs: Array) -> float:
    return float((np.abs(ours - theirs) / np.abs(theirs)).max())


def main() -> None:
    """Print the table."""
    with one_thread():
        print(f"{'':46}{'ours':>14}{'peer':>15}{'':13}{'ratio':>10}{'agreement':>12}")
        allan()
        autoregression()
        kalman()


if __name__ == "__main__":
    main()
