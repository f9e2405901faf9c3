"""Declarations: what the packaged ones mean, overriding one key, and what a mistake is told."""

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from drivers.codecs.batch import Quantity
from drivers.codecs.declared import FrameSpecError
from drivers.codecs.frame_spec import FrameSpec

OWN: dict[str, Any] = {
    "name": "own",
    "length": 12,
    "byte_order": "little",
    "header": "AA 55",
    "fields": [
        {"name": "rate", "at": 2, "type": "i32"},
        {"name": "temp", "at": 6, "type": "i16"},
        {"name": "state", "at": 8, "type": "u8"},
        {"name": "count", "at": 9, "type": "u8"},
    ],
    "checksum": {"kind": "crc16-ccitt", "over": [2, 10], "at": 10},
    "counter": {"field": "count"},
    "rate": {"field": "rate", "kind": "rate", "unit": "deg", "scale": 1e-4},
    "temperature": {"field": "temp", "scale": 0.1, "offset": 20},
    "status": {"field": "state", "good_value": 0},
}


def changed(**changes: Any) -> dict[str, Any]:
    return {**OWN, **changes}


def test_kvh_by_vendor_default_is_an_increment_in_radians_and_whole_degrees() -> None:
    spec = FrameSpec.load("kvh_36")
    assert (spec.length, spec.header.hex(), spec.fields["temperature"].byte_order) == (36, "fe81ff55", "big")
    meaning = spec.meaning(1000.0)
    assert meaning.rate.scale == pytest.approx(1000.0 * 180.0 / math.pi, rel=1e-15)
    assert meaning.rate.unit == "deg/s"
    assert meaning.temperature is not None and meaning.temperature.scale == 1.0
    assert spec.counter is not None and spec.counter.modulo == 128


def test_one_key_of_a_packaged_frame_is_one_line() -> None:
    spec = FrameSpec.load({"base": "kvh_36", "rate": {"kind": "rate", "unit": "deg"}, "temperature": {"scale": 0.01}})
    meaning = spec.meaning(1000.0)
    assert meaning.rate.scale == 1.0
    assert meaning.temperature is not None and meaning.temperature.scale == 0.01
    assert spec.columns["rate"].at == 4
    c100 = FrameSpec.load("kvh_36_c100").meaning(100.0)
    assert c100.temperature is not None and c100.temperature.scale == 0.01


@pytest.mark.parametrize(("kind", "factor"), [("rate", 1.0), ("increment", 250.0)])
@pytest.mark.parametrize(("unit", "degrees"), [("deg", 1.0), ("rad", 180.0 / math.pi)])
def test_rate_or_increment_degrees_or_radians(kind: str, factor: float, unit: str, degrees: float) -> None:
    rate = {"field": "rate", "kind": kind, "unit": unit, "scale": 0.5}
    law = FrameSpec.from_mapping(changed(rate=rate)).meaning(250.0).rate
    assert law.scale == pytest.approx(0.5 * factor * degrees, rel=1e-14)


@pytest.mark.parametrize(("unit", "degc"), [("degC", 25.0), ("degF", (25.0 - 32.0) / 1.8), ("K", 25.0 - 273.15)])
def test_temperature_units(unit: str, degc: float) -> None:
    import numpy as np

    law = FrameSpec.from_mapping(changed(temperature={"field": "temp", "unit": unit, "scale": 0.1, "offset": 5}))
    assert law.temperature_law is not None
    assert law.temperature_law.value(np.array([200], np.int16)) == pytest.approx([degc], abs=1e-12)


def test_all_packaged_frames_can_be_read() -> None:
    import drivers.gyros

    folder = Path(drivers.gyros.__file__).parent / "frames"
    names = {file.stem for file in folder.glob("*.yaml")}
    assert names >= {"kvh_36", "kvh_36_c100", "stim300_rate_temperature", "example_eb90"}
    for name in names:
        assert FrameSpec.load(name).columns.keys() >= {"rate", "temperature", "counter", "status"}


def test_channels_have_a_field_and_a_law_each() -> None:
    fields = [*OWN["fields"], {"name": "own", "at": 10, "type": "u8"}]
    channels = {"case_degc": {"field": "own", "scale": 0.5, "offset": -40}}
    checksum = {"kind": "sum8", "over": [2, 11], "at": 11}
    spec = FrameSpec.from_mapping(changed(fields=fields, checksum=checksum, channels=channels))
    assert list(spec.columns) == ["rate", "temperature", "counter", "status", "case_degc"]
    assert spec.columns["case_degc"].name == "own"
    assert spec.meaning(400.0).channels == {"case_degc": Quantity(0.5, -40.0, "degC")}
    assert FrameSpec.from_mapping(OWN).channels == {}
    shared = FrameSpec.from_mapping(changed(channels={"case_degc": {"field": "temp", "scale": 0.1, "offset": 20}}))
    assert shared.columns["case_degc"] is shared.columns["temperature"]


def test_a_file_of_ones_own_and_one_built_on_it(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(OWN))
    (tmp_path / "faster.yaml").write_text(f"base: {tmp_path / 'own.yaml'}\ncounter: null\nstatus: null\n")
    assert FrameSpec.load(str(tmp_path / "own.yaml")).name == "own"
    spec = FrameSpec.load(str(tmp_path / "faster.yaml"))
    assert (spec.counter, spec.status, spec.length) == (None, None, 12)


def test_fields_are_overridden_by_name() -> None:
    spec = FrameSpec.load({"base": "kvh_36", "fields": [{"name": "temperature", "type": "u16"}]})
    assert spec.fields["temperature"].type == "u16" and len(spec.fields) == 9


def test_own_crc_and_numbers_written_in_hex() -> None:
    checksum = {
        "kind": "crc",
        "width": 16,
        "polynomial": "0x8005",
        "start": 0xFFFF,
        "reflected": True,
        "over": [2, 10],
        "at": 10,
    }
    spec = FrameSpec.from_mapping(changed(checksum=checksum))
    assert spec.checksum is not None and spec.checksum.algorithm.of(b"123456789") == 0x4B37


def kvh(**changes: Any) -> dict[str, Any]:
    return {"base": "kvh_36", **changes}


def extra(at: int, kind: str) -> list[dict[str, Any]]:
    return [{"name": "extra", "at": at, "type": kind}]


@pytest.mark.parametrize(
    ("declaration", "message"),
    [
        ("kvh36", r"frame 'kvh36' is neither a packaged one \(.*kvh_36, .*\) nor a file here\. Did you mean kvh_36\?"),
        (kvh(rate={"knd": "rate"}), r"rate\.knd: unknown key\. Allowed: field, kind, .*Did you mean kind\?"),
        (kvh(rate={"kind": "delta"}), r"rate\.kind: 'delta' is not allowed\. Allowed: rate, increment"),
        (kvh(rate={"unit": "degrees"}), r"rate\.unit: 'degrees' .*Allowed: deg, rad.* Did you mean deg\?"),
        (kvh(rate={"field": "x_rotaton"}), r"rate\.field: .*Did you mean x_rotation\?"),
        (kvh(rate={"scale": 0}), r"rate\.scale: 0 is not allowed"),
        (kvh(rate={"scale": math.nan}), r"rate\.scale: nan is not allowed.*finite"),
        (kvh(ratee={}), r"frame 'KVH 36-byte frame': ratee: unknown key\. .* Did you mean rate\?"),
        (kvh(length=32), r"ends at byte 36, but the frame has 32|must lie inside|whole number"),
        (kvh(counter={"modulo": 300}), r"counter\.modulo: 300 .* 2 to 256"),
        (kvh(counter={"step": 3}), r"counter\.step: 3 does not divide the modulo 128"),
        (kvh(counter={"field": "x_rotation"}), r"counter\.field: x_rotation is f32; .* unsigned integer"),
        (kvh(status={"good_mask": "0x1FF"}), r"status\.good_mask: '?(511|0x1FF)'? .* 0 to 255"),
        (kvh(header="FE 8"), r"header: 'FE 8' is not allowed\. Write 1 to 8 bytes in hex"),
        (kvh(header=94), r"header: 94 is not allowed.*in quotes"),
        (kvh(checksum=None), r"checksum: is missing; if the frame has none, say so: \{kind: none\}"),
        (kvh(checksum={"kind": "crc32"}), r"checksum\.kind: 'crc32' .*Did you mean crc32-mpeg2\?"),
        (kvh(checksum={"over": [0, 36]}), r"checksum\.over: \[0, 36\] must lie inside .* not cover the checksum"),
        (kvh(checksum={"over": "all"}), r"checksum\.over: 'all' is not allowed"),
        (kvh(rate=None), r"rate: is missing"),
        (kvh(rate=3), r"rate: 3 is not a mapping"),
        (kvh(temperature={"unit": "C"}), r"temperature\.unit: 'C' .* degC, degF, K"),
        (kvh(fields=extra(2, "u8")), r"fields\[9\]\.at: byte 2 belongs to header"),
        (kvh(fields=extra(30, "u8")), r"fields\[9\]\.at: byte 30 belongs to field temperature"),
        (kvh(fields=extra(35, "u16")), r"fields\[9\]\.at: field extra ends at byte 37"),
        (kvh(fields=extra(1, "int")), r"fields\[9\]\.type: 'int' is not allowed\. Allowed: u8"),
        (kvh(fields={"rate": 1}), r"fields: must be a list of mappings"),
        ({"name": "x"}, r"frame 'x': length: is missing; it gives the bytes of one frame"),
        ({"name": "x", "lenght": 3}, r"lenght: unknown key\. .*Did you mean length\?"),
        ({"name": "x", "header": "AA"}, r"length: is missing"),
        (kvh(checksum={"width": 16}), r"checksum\.width: unknown key"),
        (kvh(checksum={"kind": "crc", "width": 12, "polynomial": 3}), r"checksum\.width: 12 .* 8, 16, 24, 32"),
        (kvh(channels={"rate_y": {}}), r"channels\.rate_y: 'rate_y' is no name .*ending in the unit \(.*_dps"),
        (kvh(channels={"Rate_dps": {}}), r"channels\.Rate_dps: 'Rate_dps' is no name of a channel"),
        (kvh(channels={"rate_dps": {}}), r"channels\.rate_dps: .* is a column every frame has"),
        (
            kvh(channels={"rate_y_dps": {"fild": 1}}),
            r"channels\.rate_y_dps\.fild: unknown key\. .*Did you mean field\?",
        ),
        (kvh(channels={"rate_y_dps": {"field": "y_rot"}}), r"rate_y_dps\.field: .*Did you mean y_rotation\?"),
        (kvh(channels={"rate_y_dps": {"field": "y_rotation", "scale": 0}}), r"rate_y_dps\.scale: 0 is not allowed"),
        (kvh(channels={"rate_y_dps": 3}), r"channels\.rate_y_dps: 3 is not a mapping"),
        (kvh(channels=["rate_y_dps"]), r"channels: .*is not a mapping"),
        ({}, r"name: is missing"),
        (7, r"frame: 7 is neither a name, a path nor a mapping"),
        ({"base": ["kvh_36"]}, r"neither a name, a path nor a mapping"),
    ],
)
def test_mistakes_name_the_key_what_is_allowed_and_what_to_do(declaration: Any, message: str) -> None:
    with pytest.raises(FrameSpecError, match=message):
        FrameSpec.load(declaration)


def test_numbers_in_a_file_are_what_they_look_like(tmp_path: Path) -> None:
    """YAML 1.1 reads 1e-6 as text, 010 as eight and 1:30 as ninety, and keeps the last of two equal keys."""
    file = tmp_path / "it.yaml"
    text = "base: kvh_36\nheader: 94\nrate: {scale: 1e-6}\nstatus: {good_mask: 0x70, good_value: 112}\ntemperature: ~\n"
    file.write_text(text)
    spec = FrameSpec.load(str(file))
    assert (spec.header, spec.good_mask, spec.good_value, spec.temperature) == (b"\x94", 0x70, 0x70, None)
    assert spec.rate_law.scale == pytest.approx(1e-6 * 180 / math.pi)
    for line, message in (
        ("counter: {modulo: 010}", r"counter\.modulo: '010' is not allowed"),
        ("counter: {modulo: 1:30}", r"counter\.modulo: '1:30' is not allowed"),
        ("rate: {scale: on}", r"rate\.scale: 'on' is not allowed"),
        ("rate: {kind: rate, kind: increment}", r"(?s)it\.yaml: cannot be read.*the key 'kind' stands twice.*line 2"),
        ("checksum: {over: [0, x]}", r"checksum\.over: \['0', 'x'\] is not allowed"),
        ("checksum: {kind: crc, width: 8, polynomial: 7, reflected: maybe}", r"reflected: 'maybe' .* true, false"),
    ):
        file.write_text(f"base: kvh_36\n{line}\n")
        with pytest.raises(FrameSpecError, match=message):
            FrameSpec.load(str(file))


def test_files_that_are_no_declarations(tmp_path: Path) -> None:
    for text, message in (
        ("[1, 2]", "must hold a mapping"),
        ("a: [", "cannot be read as YAML"),
        ("x" * 70_000, "at most 65536"),
    ):
        (tmp_path / "it.yaml").write_text(text)
        with pytest.raises(FrameSpecError, match=message):
            FrameSpec.load(str(tmp_path / "it.yaml"))
    (tmp_path / "it.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FrameSpecError, match="cannot be read as text"):
        FrameSpec.load(str(tmp_path / "it.yaml"))
    (tmp_path / "it.yaml").write_text(f"base: {tmp_path / 'it.yaml'}")
    with pytest.raises(FrameSpecError, match="in a circle"):
        FrameSpec.load(str(tmp_path / "it.yaml"))
