"""Small worlds with faults, and drivers on their ports."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import serial

from drivers.can_ports import open_can_source
from drivers.chambers.watlow_f4 import WatlowF4, WatlowF4Settings
from drivers.gyros.can_dbc import CanGyro, CanGyroSettings
from drivers.gyros.serial_frames import SerialGyro, SerialGyroSettings
from drivers.ports import open_byte_source
from drivers.rate_tables.acutronic_acl import AcutronicAcl, AcutronicAclSettings
from simulated_hw.faults.kinds import FAULTS, FaultSpec
from simulated_hw.faults.log import DISCARD, FILE
from simulated_hw.world import InstrumentSpec, World, WorldSpec, gyro_class

CHAMBER = InstrumentSpec("watlow_f4", "sim://chamber", {"baud": 19200, "address": 1})
TABLE = InstrumentSpec("acutronic_acl", "sim://table", {"baud": 9600, "axis": 1})
SERIAL = InstrumentSpec("serial_frames", "sim://s", {"frame": "kvh_36_c100", "baud": 921600, "data_rate_hz": 100.0})
CAN = InstrumentSpec("can_dbc", "can:c", {**vars(CanGyroSettings())})
COUNTED = ("lost", "duplicates", "bad_checksum", "skipped_bytes", "resyncs")


def fault(name: str, on: str, **settings: Any) -> FaultSpec:
    return FaultSpec(name, on, FAULTS[name](**settings))


def world(
    *faults: FaultSpec, seed: int = 1, truth: Path | None = None, start_s: float = 0.0, frame: Any = "kvh_36_c100"
) -> World:
    duts = {"S": replace(SERIAL, settings={**SERIAL.settings, "frame": frame}), "C": CAN}
    gyros = {name: gyro_class("tactical") for name in duts}
    spec = WorldSpec(seed, chamber=CHAMBER, rate_table=TABLE, duts=duts, gyro_parameters=gyros, faults=tuple(faults))
    return World(spec, truth, start_s)


def serial_gyro(open_world: World) -> SerialGyro:
    port = serial.serial_for_url("sim://s", baudrate=921600, timeout=0)
    return SerialGyro(open_byte_source(port, lambda: open_world.env.now), SerialGyroSettings(frame="kvh_36_c100"))


def can_gyro(open_world: World) -> CanGyro:
    bus = can.Bus(interface="fogsim", channel="c")
    return CanGyro(open_can_source(bus, lambda: open_world.env.now), CanGyroSettings())


def table() -> AcutronicAcl:
    return AcutronicAcl(serial.serial_for_url("sim://table", baudrate=9600), AcutronicAclSettings())


def chamber() -> WatlowF4:
    return WatlowF4(serial.serial_for_url("sim://chamber", baudrate=19200), WatlowF4Settings())


def wait(open_world: World, until_s: float) -> None:
    if until_s > open_world.env.now:
        open_world.env.run(until=until_s)


def truth_of(folder: Path) -> list[dict[str, Any]]:
    """The records of the log, without the frames that were thrown away unread."""
    lines = (folder / FILE).read_text().splitlines()
    return [record for record in map(json.loads, lines) if record["fault"] != DISCARD]


def sums(records: list[dict[str, Any]]) -> dict[str, int]:
    total: Counter[str] = Counter()
    for record in records:
        total.update({name: record.get(name, 0) for name in COUNTED})
    return {name: total[name] for name in COUNTED}
