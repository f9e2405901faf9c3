"""The three linear laws of a temperature chamber: controller in its range, heating or cooling at full power.

Watts and kelvin; three nodes, because overshoot and the slow creep after the air reads 'stable' come from the wall:

    C_a dT_a/dt = h_w (T_w - T_a) + h_l (T_l - T_a) + q + fan
    C_w dT_w/dt = h_w (T_a - T_w) + h_o (T_room - T_w)
    C_l dT_l/dt = h_l (T_a - T_l) + P_dut
    τ_p dT_p/dt = T_a - T_p                                     the control probe
    dI/dt       = K/τ_i (r - T_p) - (d - q)/τ_t,  d = K (r - T_p) + I

r is the ramped setpoint and d the power the PI controller demands. q = d inside the range, the full heating power, or
minus the full cooling power c_0 + c_1 T_a; back-calculation (the τ_t term) keeps the integral from winding up.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.linear import LinearSystem
from simulated_hw.physics.parameters import ChamberParameters

AIR, WALL, LOAD, PROBE, INTEGRAL = range(5)
STATES = 5
# Demands closer than this to a limit count as on it; watts.
_ON_LIMIT_W = 1e-6


class Law(IntEnum):
    """Which of the three laws holds."""

    REGULATED = 0
    HEATING = 1
    COOLING = 2


class ChamberLaws:
    """The matrices of the three laws, and the power demanded and possible."""

    def __init__(self, parameters: ChamberParameters) -> None:
        self._parameters = parameters
        p = parameters
        self.demand = np.zeros(STATES)  # d = demand @ x + gain * r
        self.demand[PROBE], self.demand[INTEGRAL] = -p.controller_gain_w_k, 1.0
        self._cooling_zero_w = p.cooling_power_w - 25.0 * p.cooling_slope_w_k
        self.matrices = {law: self._matrix(law) for law in Law}
        self.systems = {law: LinearSystem(matrix) for law, matrix in self.matrices.items()}

    def _matrix(self, law: Law) -> NDArray[np.float64]:
        p = self._parameters
        a = np.zeros((STATES, STATES))
        a[AIR, [AIR, WALL, LOAD]] = -(p.air_to_wall_w_k + p.air_to_load_w_k), p.air_to_wall_w_k, p.air_to_load_w_k
        a[AIR] += self._delivered(law)
        a[AIR] /= p.air_capacity_j_k
        a[WALL, [AIR, WALL]] = p.air_to_wall_w_k, -(p.air_to_wall_w_k + p.wall_to_room_w_k)
        a[WALL] /= p.wall_capacity_j_k
        a[LOAD, [AIR, LOAD]] = np.array([1.0, -1.0]) * p.air_to_load_w_k / p.load_capacity_j_k
        a[PROBE, [AIR, PROBE]] = np.array([1.0, -1.0]) / p.probe_lag_s
        a[INTEGRAL, PROBE] = -p.controller_gain_w_k / p.controller_integral_s
        a[INTEGRAL] -= (self.demand - self._delivered(law)) / p.controller_tracking_s
        return a

    def _delivered(self, law: Law) -> NDArray[np.float64]:
        """The part of the delivered power q that depends on the state, as a row."""
        if law is Law.REGULATED:
            return self.demand
        row = np.zeros(STATES)
        if law is Law.COOLING:
            row[AIR] = -self._parameters.cooling_slope_w_k
        return row

    def drive(
        self, law: Law, setpoint_degc: float, slope_k_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """b0 and b1 of x' = A x + b0 + b1 t under this law, the setpoint being setpoint + slope · t."""
        p = self._parameters
        gain = p.controller_gain_w_k
        own = np.zeros(STATES)
        own[AIR] = p.fan_power_w / p.air_capacity_j_k
        own[WALL] = p.wall_to_room_w_k * p.room_degc / p.wall_capacity_j_k
        own[LOAD] = p.dut_power_w / p.load_capacity_j_k
        per_kelvin = np.zeros(STATES)  # what one kelvin of setpoint adds
        per_kelvin[INTEGRAL] = gain / p.controller_integral_s
        if law is Law.REGULATED:
            per_kelvin[AIR] = gain / p.air_capacity_j_k
        else:
            limit = p.heating_power_w if law is Law.HEATING else -self._cooling_zero_w
            own[AIR] += limit / p.air_capacity_j_k
            own[INTEGRAL] += limit / p.controller_tracking_s
            per_kelvin[INTEGRAL] -= gain / p.controller_tracking_s
        return own + per_kelvin * setpoint_degc, per_kelvin * slope_k_s

    def at_rest(self) -> NDArray[np.float64]:
        """The state at power-on: everything at room temperature, the controller balancing the fan."""
        state = np.full(STATES, self._parameters.room_degc)
        state[INTEGRAL] = -self._parameters.fan_power_w
        return state

    def demanded_w(self, state: NDArray[np.float64], setpoint_degc: float) -> float:
        """The power the controller asks for, negative for cooling."""
        return float(self.demand @ state) + self._parameters.controller_gain_w_k * setpoint_degc

    def coldest_w(self, air_degc: float) -> float:
        """Full cooling power (negative) with the air at this temperature."""
        return -(self._cooling_zero_w + self._parameters.cooling_slope_w_k * air_degc)

    def law_for(self, state: NDArray[np.float64], setpoint_degc: float) -> Law:
        """The law that holds from this state on."""
        demanded = self.demanded_w(state, setpoint_degc)
        if demanded > self._parameters.heating_power_w + _ON_LIMIT_W:
            return Law.HEATING
        if demanded < self.coldest_w(float(state[AIR])) - _ON_LIMIT_W:
            return Law.COOLING
        return Law.REGULATED

    def exits(self, law: Law) -> list[tuple[NDArray[np.float64], float, float, Law]]:
        """How this law ends: rows (w, g, c, next) meaning 'when w @ x + g r + c rises above 0, next holds'."""
        gain, heat = self._parameters.controller_gain_w_k, self._parameters.heating_power_w
        above_cold = self.demand.copy()  # d - coldest
        above_cold[AIR] += self._parameters.cooling_slope_w_k
        if law is Law.HEATING:
            return [(-self.demand, -gain, heat, Law.REGULATED)]
        if law is Law.COOLING:
            return [(above_cold, gain, self._cooling_zero_w, Law.REGULATED)]
        return [
            (self.demand, gain, -heat, Law.HEATING),
            (-above_cold, -gain, -self._cooling_zero_w, Law.COOLING),
        ]
