"""What a user may say about a simulated ring laser gyro, beyond what every gyro has."""

from dataclasses import dataclass

from simulated_hw.physics.parameters import require_finite, require_not_negative, require_positive


@dataclass(frozen=True)
class RingLaserParameters:
    """Three temperatures and the bias they make, in the terms of the `rlg` experiment:

    bias = D_T (T - reference) + D_∇ G + D_Ṫ dT/dt + D_TT (T - reference)² + D_T∇ (T - reference) G,
    T being the mean of anode and cathode, G anode minus cathode. The case follows the air, anode and cathode the case.

    Fields:
        reference_degc: where the two polynomials in T have their origin.
        temperature_dph_k, gradient_dph_k: D_T and D_∇, deg/h/K. slope_dph: D_Ṫ, deg/h per °C/min.
        curvature: D_TT, deg/h/K². cross: D_T∇, deg/h/K².
        case_s, anode_s, cathode_s: time constants. case_heating_k, anode_heating_k, cathode_heating_k: how much warmer
            each of the powered gyro ends up than what it follows.
    """

    reference_degc: float = 25.0
    temperature_dph_k: float = 2.9e-3
    gradient_dph_k: float = -8.0e-3
    slope_dph: float = 0.025
    curvature: float = 3.2e-5
    cross: float = -3.0e-4
    case_s: float = 1500.0
    anode_s: float = 420.0
    cathode_s: float = 900.0
    case_heating_k: float = 2.0
    anode_heating_k: float = 2.5
    cathode_heating_k: float = 1.5

    def __post_init__(self) -> None:
        require_finite(self, "reference_degc", "temperature_dph_k", "gradient_dph_k", "slope_dph", "curvature", "cross")
        require_positive(self, "case_s", "anode_s", "cathode_s")
        require_not_negative(self, "case_heating_k", "anode_heating_k", "cathode_heating_k")
