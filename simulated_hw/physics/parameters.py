"""What a user may say about the simulated chamber, table and site: frozen dataclasses, checked when made.

Units are in the field names (`_degc`, `_k` for a temperature difference, `_j_k`, `_w_k`, `_dps`, `_ppm`, …). A field
named `…_sigma_…` is the standard deviation of a hidden value drawn once per seed; 0 switches it off.
Defaults are the typical values of the literature on such equipment; the reasons for departures stand beside them.
"""

from dataclasses import dataclass
from math import isfinite


def require(owner: object, condition: bool, field: str, allowed: str) -> None:
    """Raise ValueError naming the class, the field, its value and what is allowed, unless `condition` holds."""
    if not condition:
        raise ValueError(f"{type(owner).__name__}.{field} = {getattr(owner, field)!r}: must be {allowed}")


def require_positive(owner: object, *fields: str) -> None:
    """Each field must be a finite number above 0."""
    for field in fields:
        value = getattr(owner, field)
        require(owner, isfinite(value) and value > 0, field, "a finite number above 0")


def require_not_negative(owner: object, *fields: str) -> None:
    """Each field must be a finite number, 0 or more."""
    for field in fields:
        value = getattr(owner, field)
        require(owner, isfinite(value) and value >= 0, field, "a finite number, 0 or more")


def require_finite(owner: object, *fields: str) -> None:
    """Each field must be a finite number, or a tuple of them."""
    for field in fields:
        value = getattr(owner, field)
        numbers = value if isinstance(value, tuple) else (value,)
        require(owner, all(isfinite(number) for number in numbers), field, "finite")


@dataclass(frozen=True)
class ChamberParameters:
    """Temperature chamber: air, wall and load nodes, a lagging probe, a PI controller and a setpoint generator.

    Fields:
        room_degc: the room, and everything inside at power-on.
        min_setpoint_degc, max_setpoint_degc: setpoints the controller accepts. Reaching them is another matter.
        max_ramp_degc_min: the fastest the controller's setpoint generator moves; None lets the setpoint jump.
        air_capacity_j_k, wall_capacity_j_k, load_capacity_j_k: heat capacities; the load is the fixture with the DUTs.
        air_to_wall_w_k, air_to_load_w_k, wall_to_room_w_k: conductances between the nodes.
        heating_power_w: full heating power, the same at every temperature.
        cooling_power_w: full cooling power with the air at 25 °C. cooling_slope_w_k: what it loses per kelvin below.
            1.7 kW falling to 0.5 kW at -55 °C: a little more than usual, for it must hold 1 °C/min down to -30 °C.
        fan_power_w, dut_power_w: heat of the fan into the air and of the DUTs into the load.
        probe_lag_s, probe_noise_k, probe_offset_sigma_k: the control probe; its offset is hidden.
        controller_gain_w_k, controller_integral_s: PI gain and integral time, acting on the probe.
        controller_tracking_s: anti-windup; how fast the integral follows the power really delivered when saturated.
    """

    room_degc: float = 25.0
    min_setpoint_degc: float = -60.0
    max_setpoint_degc: float = 90.0
    max_ramp_degc_min: float | None = 4.0
    air_capacity_j_k: float = 3000.0
    wall_capacity_j_k: float = 30000.0
    load_capacity_j_k: float = 5000.0
    air_to_wall_w_k: float = 90.0
    air_to_load_w_k: float = 12.0
    wall_to_room_w_k: float = 2.0
    heating_power_w: float = 2000.0
    cooling_power_w: float = 1700.0
    cooling_slope_w_k: float = 15.0
    fan_power_w: float = 120.0
    dut_power_w: float = 10.0
    probe_lag_s: float = 15.0
    probe_noise_k: float = 0.02
    probe_offset_sigma_k: float = 0.1
    controller_gain_w_k: float = 200.0
    controller_integral_s: float = 240.0
    controller_tracking_s: float = 60.0

    def __post_init__(self) -> None:
        require_positive(self, "air_capacity_j_k", "wall_capacity_j_k", "load_capacity_j_k")
        require_positive(self, "air_to_wall_w_k", "air_to_load_w_k", "wall_to_room_w_k")
        require_positive(self, "probe_lag_s", "controller_gain_w_k", "controller_integral_s", "controller_tracking_s")
        require_not_negative(self, "heating_power_w", "cooling_power_w", "cooling_slope_w_k", "fan_power_w")
        require_not_negative(self, "dut_power_w", "probe_noise_k", "probe_offset_sigma_k")
        require_finite(self, "room_degc", "min_setpoint_degc", "max_setpoint_degc")
        require(self, self.min_setpoint_degc < self.max_setpoint_degc, "min_setpoint_degc", "below max_setpoint_degc")
        least = self.cooling_slope_w_k * (25.0 - self.room_degc)
        require(
            self, self.cooling_power_w >= least, "cooling_power_w", f"{least:g} or more, to be above 0 at room_degc"
        )
        if self.max_ramp_degc_min is not None:
            require_positive(self, "max_ramp_degc_min")


@dataclass(frozen=True)
class TableParameters:
    """Single-axis rate table, continuous rotation, counter-clockwise positive.

    Fields:
        max_rate_dps, max_acceleration_dps2: what the axis can do; demands beyond it are refused.
        acceleration_dps2: acceleration limit at power-on; the host may set another.
        slew_rate_dps: rate limit of position moves.
        servo_hz, servo_damping: natural frequency and damping of the closed rate loop (second order).
        coast_s: time constant with which a released axis comes to rest.
        rate_gain_sigma_ppm: hidden error of the controller's time base: it turns that much too fast and cannot see it.
        angle_error_orders, angle_error_arcsec: angle error of bearing and encoder, Σ a sin(n θ + p): the orders n
            and amplitudes a (phases p are hidden). One spectrum gives the rate non-uniformity over every window.
        rate_noise_dps, rate_resolution_dps, position_noise_deg, position_resolution_deg: of the readbacks.
        readback_update_s: how often the controller renews its readback noise.
    """

    max_rate_dps: float = 400.0
    max_acceleration_dps2: float = 500.0
    acceleration_dps2: float = 100.0
    slew_rate_dps: float = 60.0
    servo_hz: float = 5.0
    servo_damping: float = 0.7
    coast_s: float = 3.0
    rate_gain_sigma_ppm: float = 20.0
    angle_error_orders: tuple[int, ...] = (1, 36)
    angle_error_arcsec: tuple[float, ...] = (3.0, 1.0)
    rate_noise_dps: float = 0.0005
    rate_resolution_dps: float = 0.0001
    position_noise_deg: float = 0.0001
    position_resolution_deg: float = 0.0001
    readback_update_s: float = 0.01

    def __post_init__(self) -> None:
        require_positive(self, "max_rate_dps", "max_acceleration_dps2", "acceleration_dps2", "slew_rate_dps")
        require_positive(self, "servo_hz", "servo_damping", "coast_s", "readback_update_s")
        require_not_negative(self, "rate_gain_sigma_ppm", "rate_noise_dps", "rate_resolution_dps")
        require_not_negative(self, "position_noise_deg", "position_resolution_deg")
        require_finite(self, "angle_error_orders", "angle_error_arcsec")
        highest = self.max_acceleration_dps2
        require(self, self.acceleration_dps2 <= highest, "acceleration_dps2", f"at most max_acceleration {highest:g}")
        require(self, self.slew_rate_dps <= self.max_rate_dps, "slew_rate_dps", "at most max_rate")
        same = len(self.angle_error_orders) == len(self.angle_error_arcsec)
        require(self, same, "angle_error_arcsec", "as long as angle_error_orders")
        require(self, all(n >= 1 for n in self.angle_error_orders), "angle_error_orders", "whole numbers from 1")


@dataclass(frozen=True)
class SiteParameters:
    """Where the bench stands.

    Fields:
        latitude_deg: geographic latitude, north positive; None leaves the earth's rotation out.
        azimuth_deg: where the x axis of a level DUT points when the table stands at 0, clockwise from north.
    """

    latitude_deg: float | None = None
    azimuth_deg: float | None = None

    def __post_init__(self) -> None:
        require(self, self.azimuth_deg is None or isfinite(self.azimuth_deg), "azimuth_deg", "finite")
        if self.latitude_deg is not None:
            require(self, -90.0 <= self.latitude_deg <= 90.0, "latitude_deg", "from -90 to 90")
