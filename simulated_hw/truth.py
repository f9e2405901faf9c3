"""The truth log of a simulated bench: what the product under test must find out, written where it cannot read it.

truth.json holds every parameter and hidden draw; truth.csv one row a virtual minute (the setpoint commanded, and where
its ramp is; air, wall, load; the true rate of the table; the truth of each DUT). The plants remember their past, so
the log wakes once an hour and asks for sixty rows at once; asking changes nothing in the world. On a live bench, which
others watch, a row is written when it is due.
"""

import json
from collections.abc import Generator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import simpy
from numpy.typing import NDArray

from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.chamber_laws import AIR, LOAD, WALL
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.rate_table import TablePlant

_PERIOD_S = 60.0
_ROWS_PER_WRITE = 60
_COMMON = ("t_s", "commanded_degc", "setpoint_degc", "air_degc", "wall_degc", "load_degc", "table_rate_dps")
_PER_DUT = ("coil_degc", "input_rate_dps", "scale_ppm", "bias_dph", "sensor_k")


class TruthLog:
    """Writes truth.json at once and truth.csv as a process of the simpy world, in large pieces."""

    def __init__(
        self,
        folder: Path,
        env: simpy.Environment,
        chamber: ChamberPlant,
        table: TablePlant,
        gyros: Mapping[str, GyroUnit],
        seed: int,
        live_period_s: float | None = None,
    ) -> None:
        """live_period_s: a row this often, written at once. Raises OSError if the folder cannot be made or written."""
        self._period_s, self._rows_per_write = (live_period_s, 1) if live_period_s else (_PERIOD_S, _ROWS_PER_WRITE)
        self._env, self._chamber, self._table, self._gyros = env, chamber, table, gyros
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self._hidden(seed), indent=2, ensure_ascii=False)
        (folder / "truth.json").write_text(text + "\n", encoding="utf-8")
        self._file: TextIO = (folder / "truth.csv").open("w", encoding="utf-8", newline="\n")
        columns = [*_COMMON, *(f"{name}:{serial}" for serial, gyro in gyros.items() for name in _names(gyro))]
        self._file.write(",".join(columns) + "\n")
        self._rows = int(np.ceil(env.now / self._period_s))
        env.process(self._run())

    def _hidden(self, seed: int) -> dict[str, Any]:
        chamber, table = self._chamber, self._table
        return {
            "seed": seed,
            "chamber": {"probe_offset_k": chamber.probe_offset_k, "parameters": asdict(chamber.parameters)},
            "rate_table": {
                "rate_gain_ppm": table.rate_gain_ppm,
                "angle_error_phases_rad": table.angle_error_phases_rad.tolist(),
                "parameters": asdict(table.parameters),
            },
            "duts": {
                serial: {
                    "turn_on_bias_dph": gyro.rows.turn_on_bias_dph,
                    "sensor_offset_k": gyro.rows.sensor_offset_k,
                    "earth_rate_dps": gyro.earth_dps,
                    "parameters": asdict(gyro.parameters),
                    **(gyro.companion.hidden() if gyro.companion else {}),
                }
                for serial, gyro in self._gyros.items()
            },
        }

    def _run(self) -> Generator[simpy.Event, Any, None]:
        while not self._file.closed:
            yield self._env.timeout(self._period_s * self._rows_per_write)
            self._write()

    def _write(self) -> None:
        """Write all rows up to now that are not written yet."""
        if self._file.closed:
            return
        end = int(self._env.now / self._period_s) + 1
        times_s = np.arange(self._rows, end, dtype=np.float64) * self._period_s
        self._rows = end
        if len(times_s):
            table = np.stack([*self._common(times_s), *self._of_duts(times_s)], axis=1)
            self._file.writelines(",".join(f"{value:.9g}" for value in row) + "\n" for row in table.tolist())
            self._file.flush()

    def _common(self, times_s: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        states = self._chamber.states(times_s)
        setpoint = np.array([self._chamber.setpoint_degc(t) for t in times_s.tolist()])
        commanded = np.array([self._chamber.commanded_degc(t) for t in times_s.tolist()])
        rate = np.array([self._table.true_rate_dps(t) for t in times_s.tolist()])
        return [times_s, commanded, setpoint, states[:, AIR], states[:, WALL], states[:, LOAD], rate]

    def _of_duts(self, times_s: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        columns: list[NDArray[np.float64]] = []
        for gyro in self._gyros.values():
            truth = gyro.truth(times_s)
            columns += [truth[name] for name in _names(gyro)]
        return columns

    def close(self) -> None:
        """Write what is left; closing twice is harmless."""
        self._write()
        self._file.close()


def _names(gyro: GyroUnit) -> tuple[str, ...]:
    """The columns of one DUT."""
    return (*_PER_DUT, *gyro.truth_names, *(gyro.companion.truth_names if gyro.companion else ()))
