"""A north seeker: a second gyro and two accelerometers beside the first, all level and turning with the table."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.accelerometer import Accelerometer, rows_of_block
from simulated_hw.physics.axes import LevelAxis, earth_rate_dps, tilt_of
from simulated_hw.physics.chamber import ChamberPlant
from simulated_hw.physics.gyro import GyroUnit
from simulated_hw.physics.gyro_parameters import GyroParameters
from simulated_hw.physics.gyro_rows import Rows
from simulated_hw.physics.parameters import SiteParameters
from simulated_hw.physics.power import PowerHistory
from simulated_hw.physics.rate_table import TablePlant
from simulated_hw.physics.streams import Stream

Floats = NDArray[np.float64]


@dataclass
class SeekerCompanion:
    """What a north seeker has beside gyro x: gyro y, and the accelerometers along both axes."""

    gyro_y: GyroUnit
    axes: tuple[LevelAxis, LevelAxis]
    accelerometers: tuple[Accelerometer, Accelerometer]
    truth_names: tuple[str, ...] = ("azimuth_deg", "input_rate_y_dps")

    def block(self, number: int, stop: int, rows: Rows) -> tuple[dict[str, Floats], NDArray[np.bool_]]:
        """See `simulated_hw.physics.gyro.Companion`."""
        y = self.gyro_y
        rows_per_block, columns = y.grid
        chunk, mine = rows_of_block(number, rows_per_block)
        frames = number * rows_per_block * columns, rows_per_block, columns, y.frame_s
        other = y.whole(number, stop)
        channels = {"rate_y_dps": other.rate_dps}
        for name, axis, sensor in zip(("accel_x_g", "accel_y_g"), self.axes, self.accelerometers, strict=True):
            pull_g = axis.mean_pull_of_frames(*frames)
            channels[name] = sensor.output_g(number, pull_g, rows.body_degc[mine], chunk, mine)
        return channels, other.good

    def truth(self, times_s: Floats) -> dict[str, Floats]:
        """The true azimuth of x, clockwise from north, and the true rate along y."""
        return {"azimuth_deg": self.axes[0].azimuth_deg(times_s), "input_rate_y_dps": self.axes[1].rate_dps(times_s)}

    def hidden(self) -> dict[str, object]:
        """Hidden errors of the accelerometers, and the turn-on bias of gyro y."""
        x, y = self.accelerometers
        return {
            "turn_on_bias_y_dph": self.gyro_y.rows.turn_on_bias_dph,
            "accelerometer_bias_ug": [x.bias_ug, y.bias_ug],
            "accelerometer_scale_ppm": [x.scale_ppm, y.scale_ppm],
        }


def gyro_unit(
    parameters: GyroParameters,
    chamber: ChamberPlant,
    table: TablePlant,
    *,
    seed: int,
    serial: str,
    site: SiteParameters,
    power: PowerHistory | None = None,
) -> GyroUnit:
    """The DUT that the parameters describe."""
    latitude_deg = site.latitude_deg
    if parameters.kind == "single_axis":
        earth_dps = earth_rate_dps(latitude_deg)
        return GyroUnit(parameters, chamber, table, seed=seed, serial=serial, earth_dps=earth_dps, power=power)
    s = parameters.seeker
    off_deg = float(Stream(seed, serial, "azimuth").chunk(0).standard_normal()) * s.azimuth_sigma_deg
    azimuth_deg = (site.azimuth_deg or 0.0 if s.azimuth_deg is None else s.azimuth_deg) + off_deg
    tilt = tilt_of(s.table_tilt_arcsec, s.table_tilt_azimuth_deg)
    axis_x = LevelAxis(table, latitude_deg, azimuth_deg, s.mount_x_arcsec, tilt)
    axis_y = LevelAxis(table, latitude_deg, azimuth_deg - 90.0, s.mount_y_arcsec, tilt)
    x = GyroUnit(parameters, chamber, table, seed=seed, serial=serial, axis=axis_x, power=power)
    second = _with_bias(parameters, s.bias_y_dph)
    y = GyroUnit(second, chamber, table, seed=seed, serial=f"{serial}/y", axis=axis_y, power=power)
    row_s = x.grid[1] * x.frame_s
    sensors = [
        Accelerometer(s.accelerometer, seed, serial, name, x.frame_s, row_s)
        for name in ("accelerometer x", "accelerometer y")
    ]
    x.companion = SeekerCompanion(y, (axis_x, axis_y), (sensors[0], sensors[1]))
    return x


def _with_bias(parameters: GyroParameters, bias_dph: float) -> GyroParameters:
    """The same gyro with so much more bias; its error surface is in deg/s, its curves are in deg/h."""
    if parameters.model == "surface_a":
        surface = replace(parameters.surface, b0_dps=parameters.surface.b0_dps + bias_dph / 3600.0)
        return replace(parameters, surface=surface)
    c = parameters.curves
    if c.bias_values_dph:
        return replace(parameters, curves=replace(c, bias_values_dph=tuple(b + bias_dph for b in c.bias_values_dph)))
    constant, *rest = c.bias_polynomial or (0.0,)
    return replace(parameters, curves=replace(c, bias_polynomial=(constant + bias_dph, *rest)))
