"""Parameters are checked where they are made, and read from YAML under their names without units."""

import dataclasses
import re
from typing import get_type_hints

import pytest

from simulated_hw.physics import gyro_parameters, parameters
from simulated_hw.physics.gyro_classes import GYRO_CLASSES, gyro_class
from simulated_hw.physics.gyro_parameters import (
    CurveParameters,
    GyroParameters,
    NoiseParameters,
    SensorParameters,
    SurfaceParameters,
    ThermalParameters,
)
from simulated_hw.physics.parameters import ChamberParameters, SiteParameters, TableParameters

ALL = [
    value
    for module in (parameters, gyro_parameters)
    for value in vars(module).values()
    if dataclasses.is_dataclass(value) and value.__module__ == module.__name__
]
UNIT = re.compile(r"_(dph_sqrt_h|deg_sqrt_h|degc_min|arcsec|ppm_k|j_k|w_k|degc|dps2|dps|deg|dph|ppm|hz|s|w|k)$")


def test_every_class_of_parameters_is_found():
    assert {cls.__name__ for cls in ALL} >= {"ChamberParameters", "TableParameters", "SiteParameters", "GyroParameters"}


@pytest.mark.parametrize("cls", ALL, ids=lambda cls: cls.__name__)
def test_names_without_units_are_unique_and_every_field_is_documented(cls):
    names = [f.name for f in dataclasses.fields(cls)]
    keys = [UNIT.sub("", name) for name in names]
    assert len(set(keys)) == len(keys)
    assert all(re.search(rf"\b{name}\b", cls.__doc__) for name in names)
    assert set(get_type_hints(cls)) == set(names)
    assert cls() == cls()


@pytest.mark.parametrize(
    ("cls", "wrong", "message"),
    [
        (ChamberParameters, {"air_capacity_j_k": 0.0}, "ChamberParameters.air_capacity_j_k = 0.0: must be a finite"),
        (ChamberParameters, {"probe_noise_k": -1.0}, "probe_noise_k"),
        (ChamberParameters, {"min_setpoint_degc": 95.0}, "below max_setpoint_degc"),
        (ChamberParameters, {"max_ramp_degc_min": 0.0}, "max_ramp_degc_min"),
        (ChamberParameters, {"room_degc": float("nan")}, "room_degc"),
        (ChamberParameters, {"cooling_power_w": 10.0, "room_degc": 20.0}, "cooling_power_w = 10.0: must be 75 or more"),
        (TableParameters, {"acceleration_dps2": 900.0}, "at most max_acceleration 500"),
        (TableParameters, {"angle_error_arcsec": (1.0,)}, "as long as angle_error_orders"),
        (TableParameters, {"slew_rate_dps": 500.0}, "slew_rate_dps"),
        (SiteParameters, {"latitude_deg": 91.0}, "latitude_deg = 91.0: must be from -90 to 90"),
        (GyroParameters, {"model": "surface_b"}, "'surface_a', 'curves' or 'ring_laser'"),
        (GyroParameters, {"data_rate_hz": float("inf")}, "data_rate_hz"),
        (SurfaceParameters, {"w_k": 0.0}, "w_k"),
        (CurveParameters, {"scale_temperatures_degc": (0.0, 1.0)}, "scale_values_ppm"),
        (CurveParameters, {"bias_temperatures_degc": (1.0, 0.0), "bias_values_dph": (1.0, 2.0)}, "rising"),
        (
            CurveParameters,
            {"bias_temperatures_degc": (1.0,), "bias_values_dph": (1.0,), "bias_polynomial": (1.0,)},
            "empty when",
        ),
        (ThermalParameters, {"housing_s": -1.0}, "housing_s"),
        (SensorParameters, {"lsb_k": -0.1}, "lsb_k"),
        (NoiseParameters, {"arw_deg_sqrt_h": -0.1}, "arw_deg_sqrt_h"),
    ],
)
def test_a_wrong_value_is_refused_by_name(cls, wrong, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        cls(**wrong)


def test_classes_of_gyros_are_found_by_name_and_any_field_can_be_replaced():
    assert {"ts_a", "ts_b"} <= set(GYRO_CLASSES)
    assert gyro_class("ts_a") == GyroParameters()
    b = gyro_class("ts_b")
    assert b.surface.k1 != gyro_class("ts_a").surface.k1
    assert dataclasses.replace(b, max_rate_dps=300.0).surface == b.surface
    with pytest.raises(ValueError, match=r"no gyro class 'ts_c'; there are ts_a, ts_b"):
        gyro_class("ts_c")
