"""Writes the recordings of the tutorial: a gyro with known errors, as a logger would have written it.

gyro.csv: 11 temperature dwells x 13 rates, each row a mean of a minute, on a rate table. drive.csv: half an hour in a
vehicle, once a second, colder than the table run in the beginning, with two values missing. rest.csv: ten hours at
rest while the temperature swings; the coil is a few minutes behind its thermometer.
"""

from pathlib import Path

import numpy as np

NOISE_DPS = 2e-4


def output(rate: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """What the gyro gives, in deg/s: scale factor and bias depend on temperature, and it saturates a little."""
    gain = 0.004 + 0.003 * np.tanh((temperature - 20.0) / 25.0)
    return (1.0 + gain) * rate - 2e-8 * rate**3 + 0.05 + 1.2e-3 * (temperature - 20.0)


def main(folder: Path) -> None:
    rng = np.random.default_rng(4)
    dwell = np.repeat(np.arange(11), 13)
    temperature = np.linspace(-30.0, 70.0, 11)[dwell] + 0.05 * rng.standard_normal(len(dwell))
    rate = np.tile(np.linspace(-180.0, 180.0, 13), 11)
    given = output(rate, temperature) + NOISE_DPS * rng.standard_normal(len(rate))
    lines = ["dwell,T_coil,omega,table"]
    lines += [f"{d},{t:.3f},{w:.5f},{r:g}" for d, t, w, r in zip(dwell, temperature, given, rate, strict=True)]
    (folder / "gyro.csv").write_text("\n".join(lines) + "\n")

    seconds = np.arange(1800)
    warm = 45.0 - 80.0 * np.exp(-seconds / 600.0)
    turning = 40.0 * np.sin(seconds / 90.0) * np.sin(seconds / 7.0)
    given = output(turning, warm) + 10.0 * NOISE_DPS * rng.standard_normal(len(seconds))
    lines = ["time_s,T_coil,omega"]
    lines += [f"{s},{t:.2f},{w:.4f}" for s, t, w in zip(seconds, warm, given, strict=True)]
    lines[701], lines[702] = "700,,0.1", "701,20.1,"
    (folder / "drive.csv").write_text("\n".join(lines) + "\n")

    seconds = np.arange(0, 36000, 60)
    swing = 20.0 - 25.0 * np.cos(seconds / 1500.0)
    slow = swing.copy()
    for k in range(1, len(slow)):
        slow[k] = slow[k - 1] + (swing[k] - slow[k - 1]) * (1.0 - np.exp(-60.0 / 400.0))
    given = output(np.zeros(len(swing)), swing) + 5e-4 * (swing - slow) + NOISE_DPS * rng.standard_normal(len(swing))
    lines = ["time_s,T_coil,omega"]
    lines += [f"{s},{t:.3f},{w:.6f}" for s, t, w in zip(seconds, swing, given, strict=True)]
    (folder / "rest.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(__file__).parent)
