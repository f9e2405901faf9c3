"""Recordings of gyros with known errors, as files."""

from pathlib import Path

import numpy as np

NOISE_DPS = 3e-4


def grid_file(path: Path, seed: int = 0, temperature_effect: bool = True, line: str | None = None) -> Path:
    """Ten dwells x nine rates: T_coil, omega, table, dwell. line: replaces line 5."""
    rng = np.random.default_rng(seed)
    dwell = np.repeat(np.arange(10), 9)
    temperature, rate = -30.0 + 10.0 * dwell, np.tile(np.linspace(-160.0, 160.0, 9), 10)
    effect = temperature if temperature_effect else np.zeros(len(temperature))
    output = rate * (1.0 + 0.01 * np.tanh((effect - 20.0) / 20.0)) + 0.1 + 0.002 * effect
    output += NOISE_DPS * rng.standard_normal(len(rate))
    rows = zip(temperature, output, rate, dwell, strict=True)
    lines = ["T_coil,omega,table,dwell", *(f"{t:.3f},{w:.6f},{r:g},d{d}" for t, w, r, d in rows)]
    if line is not None:
        lines[4] = line
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def bias_file(path: Path, slope_dps_per_k: float = 1e-4, rows: int = 400, sensors: int = 1) -> Path:
    """A gyro at rest while the temperature swings: t;T1;..;omega."""
    rng = np.random.default_rng(1)
    temperature = 20.0 + 30.0 * np.sin(np.arange(rows) / 60.0)
    output = 0.01 + slope_dps_per_k * temperature + NOISE_DPS * rng.standard_normal(rows)
    lines = ["t;" + "".join(f"T{k};" for k in range(1, sensors + 1)) + "omega"]
    for number in range(rows):
        sensed = "".join(f"{temperature[number] + 0.1 * k:.3f};" for k in range(sensors))
        lines.append(f"{number};{sensed}{output[number]:.7f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
