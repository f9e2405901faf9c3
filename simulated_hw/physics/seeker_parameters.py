"""What a user may say about a simulated north seeker, beyond what every gyro has."""

from dataclasses import dataclass, field
from math import isfinite

from simulated_hw.physics.parameters import require, require_finite, require_not_negative, require_positive


@dataclass(frozen=True)
class AccelerometerParameters:
    """A quartz accelerometer: output = K (1 + k_T (T - 25)) (a + bias(T) + K2 a² + noise), in whole quanta.

    The usual figures of quartz accelerometers after compensation.

    Fields:
        range_g: full scale, beyond which it is clipped.
        bias_sigma_ug, scale_sigma_ppm: hidden errors. bias_ug_k: bias per °C from 25 °C.
        scale_ppm_k: k_T. quadratic_ug_g2: K2.
        noise_ug_sqrt_hz: density of the white noise. instability_ug: B, the Allan floor / 0.664. lsb_ug: quantum, or 0.
    """

    range_g: float = 30.0
    bias_sigma_ug: float = 30.0
    scale_sigma_ppm: float = 50.0
    bias_ug_k: float = 1.0
    scale_ppm_k: float = 5.0
    quadratic_ug_g2: float = 10.0
    noise_ug_sqrt_hz: float = 3.0
    instability_ug: float = 2.0
    lsb_ug: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self, "range_g")
        require_not_negative(self, "bias_sigma_ug", "scale_sigma_ppm", "noise_ug_sqrt_hz", "instability_ug", "lsb_ug")
        require_finite(self, "bias_ug_k", "scale_ppm_k", "quadratic_ug_g2")


@dataclass(frozen=True)
class SeekerParameters:
    """Two gyros x and y and two accelerometers along them, level on the table; y is 90 deg to the left of x.

    Azimuths are clockwise from north, as surveyors have them; the table turns counter-clockwise, so that the azimuth of
    x is azimuth_deg less the table's angle.

    Fields:
        azimuth_deg: of the x axis when the table stands at 0; None: the site's. azimuth_sigma_deg: hidden error of it,
            drawn once.
        table_tilt_arcsec, table_tilt_azimuth_deg: how far the table's axis leans, and whereto.
        mount_x_arcsec, mount_y_arcsec: how far the two axes point up out of the table's plane; they turn with it, and
            leak the table's rate into the gyros while it turns.
        bias_y_dph: by how much the bias of gyro y is above that of x.
        accelerometer: of both axes. Their distance from the table's axis is 0: a turning table does not pull on them.
    """

    azimuth_deg: float | None = None
    azimuth_sigma_deg: float = 0.0
    table_tilt_arcsec: float = 20.0
    table_tilt_azimuth_deg: float = 70.0
    mount_x_arcsec: float = 60.0
    mount_y_arcsec: float = -40.0
    bias_y_dph: float = -0.06
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)

    def __post_init__(self) -> None:
        require_finite(self, "table_tilt_azimuth_deg", "bias_y_dph")
        require(self, self.azimuth_deg is None or isfinite(self.azimuth_deg), "azimuth_deg", "finite")
        require_not_negative(self, "azimuth_sigma_deg", "table_tilt_arcsec")
        for name in ("table_tilt_arcsec", "mount_x_arcsec", "mount_y_arcsec"):
            require(self, abs(getattr(self, name)) <= 36_000.0, name, "within 36000 arcsec (10 deg): it is level")
