"""What the temperatures inside a gyro do to its output, for the two kinds of gyro there are.

Each kind has a thermal network and turns states of it into gain, bias, and what its temperature sensors feel.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulated_hw.physics.gyro_errors import DPH_PER_DPS, ErrorModel
from simulated_hw.physics.gyro_parameters import GyroParameters
from simulated_hw.physics.ring_laser_parameters import RingLaserParameters
from simulated_hw.physics.thermal import (
    INNER,
    OUTER,
    SENSOR,
    ThermalNetwork,
    coil_degc,
    coil_slopes_k_s,
    fog_network,
)

Floats = NDArray[np.float64]

CASE, ANODE, CATHODE = range(3)
# The ring laser's sensors, in the order of the nodes they sit on.
RING_PROBES = ("case_degc", "anode_degc", "cathode_degc")


@dataclass(frozen=True, slots=True)
class ThermalErrors:
    """Of n states, shape (n,) each.

    Fields: scale, bias_dps: S(T) and B(T). scale_after, bias_after_dps: the same a row of frames later, by the slopes.
    extra_dph: bias that is held within the row. body_degc: the temperature that scale factor and bias answer to.
    probes_degc: what the gyro's sensors feel, by channel name; the one named '' is the frame's own temperature.
    """

    scale: Floats
    scale_after: Floats
    bias_dps: Floats
    bias_after_dps: Floats
    extra_dph: Floats
    body_degc: Floats
    probes_degc: Mapping[str, Floats]


class ThermalModel(Protocol):
    """A kind of gyro."""

    network: ThermalNetwork
    # The channel that is the frame's own temperature too, if there is one.
    main_probe: str | None

    def errors(self, nodes_degc: Floats, row_s: float) -> ThermalErrors:
        """At states of the network, shape (n, nodes), for rows of frames of this length."""
        ...

    def body_degc(self, nodes_degc: Floats) -> Floats:
        """The temperature that scale factor and bias answer to."""
        ...


@dataclass
class FogThermal:
    """A coil of fibre: its bias follows its temperature and (Shupe) rate of temperature and gradient."""

    parameters: GyroParameters
    model: ErrorModel
    main_probe: str | None = None
    network: ThermalNetwork = field(init=False)

    def __post_init__(self) -> None:
        self.network = fog_network(self.parameters.thermal, self.parameters.sensor)

    def errors(self, nodes_degc: Floats, row_s: float) -> ThermalErrors:
        """See ThermalModel."""
        t = self.parameters.thermal
        outer_slope, inner_slope = coil_slopes_k_s(t, nodes_degc)
        coil = coil_degc(nodes_degc)
        after = coil + 0.5 * (outer_slope + inner_slope) * row_s
        extra_dph = t.shupe_c1 * 60.0 * outer_slope + t.shupe_c2 * 60.0 * (outer_slope - inner_slope)
        extra_dph += t.shupe_c3 * (nodes_degc[:, OUTER] - nodes_degc[:, INNER])
        scale, bias = self.model.scale, self.model.bias_dps
        probes = {"": nodes_degc[:, SENSOR]}
        return ThermalErrors(scale(coil), scale(after), bias(coil), bias(after), extra_dph, coil, probes)

    def body_degc(self, nodes_degc: Floats) -> Floats:
        """The coil's temperature."""
        return coil_degc(nodes_degc)


@dataclass
class RingThermal:
    """A ring laser: three temperatures, and bias by temperature, gradient and rate of temperature."""

    parameters: GyroParameters
    model: ErrorModel
    main_probe: str | None = RING_PROBES[CASE]
    network: ThermalNetwork = field(init=False)

    def __post_init__(self) -> None:
        self.network = ring_network(self.parameters.ring_laser, self.parameters.sensor.lag_s)

    def errors(self, nodes_degc: Floats, row_s: float) -> ThermalErrors:
        """See ThermalModel. The case is held within the row: its change moves dT/dt by a ten thousandth."""
        case, anode, cathode = nodes_degc[:, CASE], nodes_degc[:, ANODE], nodes_degc[:, CATHODE]
        anode_slope, cathode_slope = self._slopes_k_s(case, anode, cathode)
        anode_after, cathode_after = anode + anode_slope * row_s, cathode + cathode_slope * row_s
        body, body_after = 0.5 * (anode + cathode), 0.5 * (anode_after + cathode_after)
        feeling = {name: nodes_degc[:, len(RING_PROBES) + at] for at, name in enumerate(RING_PROBES)}
        probes = {"": feeling.pop(RING_PROBES[CASE]), **feeling}
        return ThermalErrors(
            self.model.scale(body),
            self.model.scale(body_after),
            self._bias_dps(case, anode, cathode),
            self._bias_dps(case, anode_after, cathode_after),
            np.zeros(len(body)),
            body,
            probes,
        )

    def body_degc(self, nodes_degc: Floats) -> Floats:
        """The mean of anode and cathode."""
        return np.asarray(0.5 * (nodes_degc[:, ANODE] + nodes_degc[:, CATHODE]))

    def _bias_dps(self, case: Floats, anode: Floats, cathode: Floats) -> Floats:
        r = self.parameters.ring_laser
        body, gradient = 0.5 * (anode + cathode), anode - cathode
        warmer = body - r.reference_degc
        anode_slope, cathode_slope = self._slopes_k_s(case, anode, cathode)
        bias_dph = (r.temperature_dph_k + r.curvature * warmer) * warmer
        bias_dph += (r.gradient_dph_k + r.cross * warmer) * gradient
        bias_dph += r.slope_dph * 30.0 * (anode_slope + cathode_slope)
        return np.asarray(self.model.bias_dps(body) + bias_dph / DPH_PER_DPS)

    def _slopes_k_s(self, case: Floats, anode: Floats, cathode: Floats) -> tuple[Floats, Floats]:
        """dT/dt of anode and cathode of a powered gyro."""
        r = self.parameters.ring_laser
        return (case + r.anode_heating_k - anode) / r.anode_s, (case + r.cathode_heating_k - cathode) / r.cathode_s


def ring_network(r: RingLaserParameters, lag_s: float) -> ThermalNetwork:
    """Case, anode, cathode, and a sensor lagging behind each."""
    count = len(RING_PROBES)
    matrix, from_air, heating = np.zeros((2 * count, 2 * count)), np.zeros(2 * count), np.zeros(2 * count)
    matrix[CASE, CASE], from_air[CASE] = -1.0 / r.case_s, 1.0 / r.case_s
    heating[CASE] = r.case_heating_k / r.case_s
    for node, constant_s, warmer_k in (
        (ANODE, r.anode_s, r.anode_heating_k),
        (CATHODE, r.cathode_s, r.cathode_heating_k),
    ):
        matrix[node, [CASE, node]] = np.array([1.0, -1.0]) / constant_s
        heating[node] = warmer_k / constant_s
    for node in range(count):
        matrix[count + node, [node, count + node]] = np.array([1.0, -1.0]) / lag_s
    return ThermalNetwork(matrix, from_air, heating)


def thermal_model(parameters: GyroParameters, model: ErrorModel) -> ThermalModel:
    """The kind of gyro that the parameters describe."""
    return RingThermal(parameters, model) if parameters.model == "ring_laser" else FogThermal(parameters, model)
