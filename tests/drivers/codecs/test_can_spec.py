"""Messages of DBC files read as gyro frames."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.codecs.can_spec import CanSpec
from drivers.codecs.dbc import EXTENDED
from drivers.codecs.declared import FrameSpecError

DBC = """BU_: X
BO_ 290 Gyro: 7 X
 SG_ z : 0|16@1- (0.001,0) [0|0] "rad/s" X
 SG_ angle : 16|16@1- (0.001,0) [0|0] "" X
 SG_ t : 32|8@1+ (1,-50) [0|0] "C" X
 SG_ n : 40|4@1+ (1,0) [0|0] "" X
 SG_ state : 44|4@1+ (1,0) [0|0] "" X
 SG_ page m1 : 48|8@1+ (1,0) [0|0] "" X
 SG_ beyond : 50|8@1+ (1,0) [0|0] "rad/s" X
 SG_ above : 55|16@0- (1,0) [0|0] "rad/s" X
BO_ 291 Rich: 8 X
 SG_ x : 0|16@1- (0.001,0) [0|0] "rad/s" X
 SG_ y : 16|16@1- (0.001,0) [0|0] "rad/s" X
 SG_ case : 32|16@1- (0.1,0) [0|0] "\xc2\xb0F" X
 SG_ bare : 48|8@1+ (0.25,1) [0|0] "" X
 SG_ pull : 56|8@1- (0.1,0) [0|0] "m/s^2" X
BO_ 2364549760 Other: 8 X
 SG_ rate : 0|16@1- (0.5,1) [0|0] "\xc2\xb0/s" X
BO_ 3 Long: 64 X
 SG_ rate : 0|16@1- (1,0) [0|0] "deg/s" X
"""


@pytest.fixture
def dbc(tmp_path: Path) -> str:
    path = tmp_path / "lab.dbc"
    path.write_text(DBC, encoding="latin-1")
    return str(path)


def gyro(dbc: str, **settings: Any) -> CanSpec:
    names = {"rate": "z", "temperature": "t", "counter": "n", "status": "state"}
    return CanSpec.from_settings({"dbc": dbc, "message": "Gyro", **names, **settings})


def test_the_packaged_gyro_needs_no_settings() -> None:
    spec = CanSpec.from_settings({})
    assert (spec.can_id, spec.counter_modulo, spec.good_mask, spec.name) == (
        0x1A0, 256, 0xFF, "CAN message GyroFrame (id 1A0)",
    )  # fmt: skip
    assert spec.raw_types["rate"].dtype == np.float32
    meaning = spec.meaning(100.0)
    assert meaning.rate.scale == 1.0
    assert meaning.temperature is not None and meaning.temperature.scale == 0.01


def test_units_come_from_the_dbc_and_can_be_overridden(dbc: str) -> None:
    assert gyro(dbc).meaning(100.0).rate.scale == pytest.approx(0.001 * 180 / math.pi, rel=1e-14)
    temperature = gyro(dbc).temperature_law
    assert temperature is not None and (temperature.scale, temperature.offset) == (1.0, -50.0)
    increment = gyro(dbc, rate="angle", rate_unit="deg")
    assert increment.meaning(250.0).rate.scale == pytest.approx(0.25, rel=1e-14)
    assert gyro(dbc, rate_unit="rad").meaning(10.0).rate.scale == pytest.approx(0.01 * 180 / math.pi, rel=1e-14)
    kelvin = gyro(dbc, temperature_unit="K").temperature_law
    assert kelvin is not None and kelvin.offset == pytest.approx(-50.0 - 273.15)
    degree_sign = gyro(dbc, message="Other", rate="rate", temperature=None, counter=None, status=None)
    assert (degree_sign.meaning(9.0).rate.scale, degree_sign.meaning(9.0).rate.offset) == (0.5, 1.0)


def test_identifiers(dbc: str) -> None:
    assert gyro(dbc).can_id == 290
    assert gyro(dbc, can_id=0x1A1).can_id == gyro(dbc, can_id="0x1A1").can_id == 0x1A1
    assert gyro(dbc, can_id=0x0CF02A80).can_id == 0x0CF02A80 | EXTENDED
    other = gyro(dbc, message="Other", rate="rate", temperature=None, counter=None, status=None)
    assert other.can_id == 0x0CF02A80 | EXTENDED
    assert other.name == "CAN message Other (id CF02A80)"


def test_what_a_gyro_does_not_send_is_left_out(dbc: str) -> None:
    spec = gyro(dbc, temperature=None, counter=None, status=None)
    assert spec.signals.keys() == {"rate"}
    assert (spec.temperature_law, spec.counter_modulo, spec.good_mask) == (None, None, 0)


def rich(dbc: str, **channels: str) -> CanSpec:
    names = dict.fromkeys(("temperature", "counter", "status"))
    return CanSpec.from_settings({"dbc": dbc, "message": "Rich", "rate": "x", **names, "channels": channels})


def test_channels_are_in_the_unit_of_their_name(dbc: str) -> None:
    spec = rich(dbc, rate_y_dps="y", case_degc="case", supply_v="bare", accel_x_g="pull")
    assert spec.signals.keys() == {"rate", "rate_y_dps", "case_degc", "supply_v", "accel_x_g"}
    laws = spec.meaning(100.0).channels
    raw = np.array([100], np.int16)
    assert laws["rate_y_dps"].value(raw) == pytest.approx([math.degrees(0.1)])
    assert laws["case_degc"].value(raw) == pytest.approx([(10.0 - 32.0) / 1.8])
    assert laws["supply_v"].value(raw) == pytest.approx([26.0])
    assert laws["accel_x_g"].value(raw) == pytest.approx([10.0 / 9.80665])


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"rate_y": "y"}, r"channels: 'rate_y' is no name of a channel\. Allowed: .*like anode_degc"),
        ({"rate_y_dps": "z"}, r"channels\.rate_y_dps: there is no signal 'z'; message Rich has: x, y, case"),
        ({"rate_y_dps": "case"}, r"channels\.rate_y_dps: signal case has the unit '.*F', but the name says deg/s"),
        ({"supply_v": "pull"}, r"channels\.supply_v: .*the unit 'm/s\^2', but the name says V.* Allowed in the DBC: V"),
    ],
)
def test_mistakes_in_channels(dbc: str, channels: dict[str, str], message: str) -> None:
    with pytest.raises(FrameSpecError, match=message):
        rich(dbc, **channels)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"dbc": "fog_gyr"},
            r"dbc 'fog_gyr' is neither a packaged one \(fog_gyro\) nor a file here\. Did you mean fog_gyro\?",
        ),
        ({"message": None}, "message: say which message is the gyro's. It has: Gyro, Rich, Other, Long"),
        ({"message": "gyro"}, "message: there is no message 'gyro'.*Did you mean Gyro"),
        ({"message": "Long", "rate": "rate"}, "message Long has 64 bytes; only classic CAN"),
        ({"rate": "y"}, "rate: there is no signal 'y'; message Gyro has: z, angle"),
        ({"temperature": "temp"}, "temperature: there is no signal 'temp'.* or null if it sends no temperature"),
        ({"counter": "z"}, "counter: signal z must be an unsigned integer"),
        ({"status": "page"}, "status: signal page is multiplexed"),
        ({"rate": "beyond"}, "rate: signal beyond reaches beyond the 7 bytes of Gyro"),
        ({"rate": "above"}, "rate: signal above reaches beyond the 7 bytes"),
        ({"rate": "angle"}, "rate: unit '' of signal angle is not known; set rate_unit to one of deg/s"),
        ({"counter_modulo": 17}, r"counter_modulo: 17 is not allowed\. Allowed: 2 to 16 \(4 bits\)"),
        ({"good_mask": 16}, r"good_mask: 16 is not allowed\. Allowed: 0 to 15"),
        ({"good_value": -1}, "good_value: -1 is not allowed"),
        ({"can_id": "1A0"}, "can_id: 1A0 is not allowed.*like 0x1A0"),
        ({"can_id": 1 << 29}, "can_id: 536870912 is not allowed. Allowed: 0 to 0x1fffffff"),
    ],
)
def test_mistakes(dbc: str, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(FrameSpecError, match=message):
        gyro(**{"dbc": dbc, **settings})
